//! A trajectory through a scene: frames along a path, and which of their pixels show the same.

use crate::consistency::{Consistency, Pairs, RANGES, Worst};
use crate::estimate::estimated;
use crate::flow::{Correspondence, FrameGeometry};
use crate::sharpness::gradient_energy;
use crate::true_depth::{depth_error, depths};
use image::RgbImage;
use impasto_model::Model;
use impasto_scene::Camera;
use impasto_style::{Perceptual, StyleError};

/// Unstylised frames along a path and their correspondences, the latter at short and at long range.
pub(crate) struct Trajectory {
    /// Unstylised.
    pub(crate) frames: Vec<RgbImage>,
    /// By the model's depth and poses.
    exact: [Pairs; 2],
    /// By true depth and poses, on the built-in scene.
    true_depth: Option<[Pairs; 2]>,
    /// How far the model's depth is from the true one, see [`depth_error`].
    pub(crate) depth_error: Option<f64>,
    /// By flow estimated from the unstylised frames.
    pub(crate) estimated: [Pairs; 2],
    /// Gradient energy of the unstylised frames.
    energy: f64,
}

/// Measures of a method's frames along a trajectory in one style.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TrajectoryMetrics {
    pub(crate) exact: [Consistency; 2],
    pub(crate) true_depth: Option<[Consistency; 2]>,
    pub(crate) estimated: [Consistency; 2],
    pub(crate) sharpness: f64,
}

impl Trajectory {
    /// Renders the unstylised frames with `supersampling²` rays a pixel. `tick` hears of every
    /// finished frame.
    pub(crate) fn new(
        model: &Model,
        supersampling: u32,
        path: &[Camera],
        tick: &mut dyn FnMut(),
    ) -> Self {
        let photo = model.photo_appearance();
        let (mut frames, mut rendered) = (Vec::new(), Vec::new());
        for camera in path {
            let view = model.render_smooth(camera, &[&photo], supersampling);
            frames.push(view.image(0));
            rendered.push(view.depth);
            tick();
        }
        let true_depth = depths(&model.file.scene, path);
        Self::of_frames(path, frames, &rendered, true_depth.as_deref())
    }

    /// From unstylised frames along a path with their depth, and with the true one where that is
    /// known.
    pub(crate) fn of_frames(
        path: &[Camera],
        frames: Vec<RgbImage>,
        rendered: &[Vec<f32>],
        true_depth: Option<&[Vec<f32>]>,
    ) -> Self {
        Self {
            energy: frames.iter().map(gradient_energy).sum(),
            estimated: RANGES.map(|range| by_estimate(&frames, range)),
            frames,
            exact: by_depth(path, rendered),
            depth_error: true_depth.map(|depth| depth_error(rendered, depth)),
            true_depth: true_depth.map(|depth| by_depth(path, depth)),
        }
    }

    /// Measures a method's frames; `None` if the path has none.
    pub(crate) fn measure(
        &self,
        frames: &[RgbImage],
        vgg: &Perceptual,
    ) -> Result<Option<TrajectoryMetrics>, StyleError> {
        if frames.is_empty() {
            return Ok(None);
        }
        let both = |pairs: &[Pairs; 2], vgg: Option<&Perceptual>| {
            let [short, long] = pairs.each_ref().map(|p| p.consistency(frames, vgg));
            Ok::<_, StyleError>([short?, long?])
        };
        let energy: f64 = frames.iter().map(gradient_energy).sum();
        let true_depth = self.true_depth.as_ref().map(|pairs| both(pairs, None));
        Ok(Some(TrajectoryMetrics {
            exact: both(&self.exact, Some(vgg))?,
            true_depth: true_depth.transpose()?,
            estimated: both(&self.estimated, None)?,
            sharpness: energy / self.energy.max(f64::MIN_POSITIVE),
        }))
    }

    /// The pairs by exact flow of largest E, at short and at long range.
    pub(crate) fn worst(&self, frames: &[RgbImage]) -> [Option<Worst<'_>>; 2] {
        self.exact.each_ref().map(|pairs| pairs.worst(frames))
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

/// How the frames of a path correspond, by one depth map each.
fn by_depth(path: &[Camera], depths: &[Vec<f32>]) -> [Pairs; 2] {
    let geometry = |i: usize| FrameGeometry {
        camera: &path[i],
        depth: &depths[i],
    };
    RANGES.map(|range| {
        Pairs::new(path.len(), range, |first, second| {
            Correspondence::exact(&geometry(first), &geometry(second))
        })
    })
}
