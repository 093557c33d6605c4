//! A walk through a scene: frames along a path, and which of their pixels show the same.

use crate::consistency::{Consistency, Pairs, RANGES};
use crate::estimate::estimated;
use crate::flow::{Correspondence, Geometry};
use crate::methods::temporal;
use crate::sharpness::gradient_energy;
use image::RgbImage;
use impasto_scene::Camera;
use impasto_style::{Perceptual, StyleError};
use impasto_train::{Look, Model};

/// A walk's unstylised frames and correspondences, the latter at short and at long range.
pub(crate) struct Walk {
    /// Unstylised.
    pub(crate) frames: Vec<RgbImage>,
    /// By the model's depth and poses.
    exact: [Pairs; 2],
    /// By flow estimated from the unstylised frames.
    estimated: [Pairs; 2],
    /// Gradient energy of the unstylised frames.
    energy: f64,
}

/// What a method's frames of a walk come to in one style.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walked {
    pub(crate) exact: [Consistency; 2],
    pub(crate) estimated: [Consistency; 2],
    pub(crate) sharpness: f64,
}

impl Walk {
    /// Renders the unstylised walk. `tick` hears of every finished frame.
    pub(crate) fn new(model: &Model, path: &[Camera], tick: &mut dyn FnMut()) -> Self {
        let photo = model.photo_look();
        let (mut frames, mut depths) = (Vec::new(), Vec::new());
        for camera in path {
            let view = model.render(camera, &[&photo]);
            frames.push(view.image(0));
            depths.push(view.depth);
            tick();
        }
        let geometry = |i: usize| Geometry {
            camera: &path[i],
            depth: &depths[i],
        };
        let exact = RANGES.map(|range| {
            Pairs::new(path.len(), range, |first, second| {
                Correspondence::exact(&geometry(first), &geometry(second))
            })
        });
        let estimated = RANGES.map(|range| {
            Pairs::new(path.len(), range, |first, second| {
                let [there, back] = [[first, second], [second, first]]
                    .map(|[from, to]| estimated(&frames[from], &frames[to]));
                Correspondence::of_flows(there, &back)
            })
        });
        Self {
            energy: frames.iter().map(gradient_energy).sum(),
            frames,
            exact,
            estimated,
        }
    }

    /// Measures a method's frames; `None` if there is no walk.
    pub(crate) fn measure(
        &self,
        frames: &[RgbImage],
        vgg: &Perceptual,
    ) -> Result<Option<Walked>, StyleError> {
        if frames.is_empty() {
            return Ok(None);
        }
        let both = |pairs: &[Pairs; 2], vgg: Option<&Perceptual>| {
            let [short, long] = pairs.each_ref().map(|p| p.consistency(frames, vgg));
            Ok::<_, StyleError>([short?, long?])
        };
        let energy: f64 = frames.iter().map(gradient_energy).sum();
        Ok(Some(Walked {
            exact: both(&self.exact, Some(vgg))?,
            estimated: both(&self.estimated, None)?,
            sharpness: energy / self.energy.max(f64::MIN_POSITIVE),
        }))
    }

    /// Frames that were stylised one by one, as a video: by estimated flow, because a method of
    /// pictures knows no geometry.
    pub(crate) fn video(&self, frames: &[RgbImage]) -> Vec<RgbImage> {
        let mut links = vec![None; frames.len()];
        for ([t, _], link) in self.estimated[0].links() {
            links[t] = Some(link);
        }
        temporal(frames, &links)
    }
}

/// Views of cameras with every look, look by look; geometry is computed once. `tick` hears of every
/// camera.
pub(crate) fn views(
    model: &Model,
    cameras: &[Camera],
    looks: &[&Look],
    tick: &mut dyn FnMut(),
) -> Vec<Vec<RgbImage>> {
    let mut views = vec![Vec::with_capacity(cameras.len()); looks.len()];
    for camera in cameras {
        let view = model.render(camera, looks);
        for (look, views) in views.iter_mut().enumerate() {
            views.push(view.image(look));
        }
        tick();
    }
    views
}
