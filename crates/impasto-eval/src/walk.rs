//! A walk through a scene: frames along a path, and which of their pixels show the same.

use crate::consistency::{Consistency, Pairs, RANGES, Worst};
use crate::estimate::estimated;
use crate::flow::{Correspondence, Geometry};
use crate::methods::temporal;
use crate::sharpness::gradient_energy;
use crate::truth::{depth_error, depths};
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
    /// By true depth and poses, on the built-in scene.
    truth: Option<[Pairs; 2]>,
    /// How far the model's depth is from the true one, see [`depth_error`].
    pub(crate) depth_error: Option<f64>,
    /// By flow estimated from the unstylised frames.
    estimated: [Pairs; 2],
    /// Gradient energy of the unstylised frames.
    energy: f64,
}

/// What a method's frames of a walk come to in one style.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walked {
    pub(crate) exact: [Consistency; 2],
    pub(crate) truth: Option<[Consistency; 2]>,
    pub(crate) estimated: [Consistency; 2],
    pub(crate) sharpness: f64,
}

impl Walk {
    /// Renders the unstylised walk with `side × side` rays a pixel. `tick` hears of every finished frame.
    pub(crate) fn new(
        (model, side): (&Model, u32),
        path: &[Camera],
        tick: &mut dyn FnMut(),
    ) -> Self {
        let photo = model.photo_look();
        let (mut frames, mut rendered) = (Vec::new(), Vec::new());
        for camera in path {
            let view = model.render_smooth(camera, &[&photo], side);
            frames.push(view.image(0));
            rendered.push(view.depth);
            tick();
        }
        let truth = depths(&model.file.scene, path);
        Self::of_frames(path, frames, &rendered, truth.as_deref())
    }

    /// From unstylised frames along a path with their depth, and with the true one where that is
    /// known.
    pub(crate) fn of_frames(
        path: &[Camera],
        frames: Vec<RgbImage>,
        rendered: &[Vec<f32>],
        truth: Option<&[Vec<f32>]>,
    ) -> Self {
        Self {
            energy: frames.iter().map(gradient_energy).sum(),
            estimated: RANGES.map(|range| by_estimate(&frames, range)),
            frames,
            exact: by_depth(path, rendered),
            depth_error: truth.map(|truth| depth_error(rendered, truth)),
            truth: truth.map(|truth| by_depth(path, truth)),
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
            truth: self.truth.as_ref().map(|t| both(t, None)).transpose()?,
            estimated: both(&self.estimated, None)?,
            sharpness: energy / self.energy.max(f64::MIN_POSITIVE),
        }))
    }

    /// The pairs by exact flow of largest E, at short and at long range.
    pub(crate) fn worst(&self, frames: &[RgbImage]) -> [Option<Worst<'_>>; 2] {
        self.exact.each_ref().map(|pairs| pairs.worst(frames))
    }

    /// Frames that were stylised one by one, as a video: by estimated flow, because a method of
    /// pictures knows no geometry.
    pub(crate) fn video(&self, frames: &[RgbImage]) -> Vec<RgbImage> {
        video(frames, &self.estimated[0])
    }
}

/// How unstylised frames that are `range` apart correspond, by flow estimated from them.
pub(crate) fn by_estimate(frames: &[RgbImage], range: usize) -> Pairs {
    Pairs::new(frames.len(), range, |first, second| {
        let [there, back] = [[first, second], [second, first]]
            .map(|[from, to]| estimated(&frames[from], &frames[to]));
        Correspondence::of_flows(there, &back)
    })
}

/// Frames that were stylised one by one, as a video, by how neighbours correspond.
pub(crate) fn video(frames: &[RgbImage], neighbours: &Pairs) -> Vec<RgbImage> {
    let mut links = vec![None; frames.len()];
    for ([t, _], link) in neighbours.links() {
        links[t] = Some(link);
    }
    temporal(frames, &links)
}

/// How the frames of a path correspond, by one depth map each.
fn by_depth(path: &[Camera], depths: &[Vec<f32>]) -> [Pairs; 2] {
    let geometry = |i: usize| Geometry {
        camera: &path[i],
        depth: &depths[i],
    };
    RANGES.map(|range| {
        Pairs::new(path.len(), range, |first, second| {
            Correspondence::exact(&geometry(first), &geometry(second))
        })
    })
}

/// Views of cameras with every look, look by look, with `side × side` rays a pixel; geometry is
/// computed once. `tick` hears of every
/// camera.
pub(crate) fn views(
    (model, side): (&Model, u32),
    cameras: &[Camera],
    looks: &[&Look],
    tick: &mut dyn FnMut(),
) -> Vec<Vec<RgbImage>> {
    let mut views = vec![Vec::with_capacity(cameras.len()); looks.len()];
    for camera in cameras {
        let view = model.render_smooth(camera, looks, side);
        for (look, views) in views.iter_mut().enumerate() {
            views.push(view.image(look));
        }
        tick();
    }
    views
}
