//! A walk through a scene: frames along a path, and which of their pixels show the same.

use crate::consistency::{Pairs, RANGES};
use crate::estimate::estimated;
use crate::flow::{Correspondence, Geometry};
use crate::methods::temporal;
use image::RgbImage;
use impasto_scene::Camera;
use impasto_train::{Look, Model};

/// A walk's correspondences, each at short and at long range.
pub(crate) struct Walk {
    /// By the model's depth and poses.
    pub(crate) exact: [Pairs; 2],
    /// By flow estimated from the frames of the first look.
    pub(crate) estimated: [Pairs; 2],
}

impl Walk {
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

/// Renders a walk with every look, of which the first is the unstylised one; geometry is computed
/// once. Frames come look by look. `tick`
/// hears of every finished frame.
pub(crate) fn walk(
    model: &Model,
    path: &[Camera],
    looks: &[&Look],
    tick: &mut dyn FnMut(usize),
) -> (Walk, Vec<Vec<RgbImage>>) {
    let mut frames = vec![Vec::with_capacity(path.len()); looks.len()];
    let mut depths = Vec::with_capacity(path.len());
    for (i, camera) in path.iter().enumerate() {
        let view = model.render(camera, looks);
        for (look, frames) in frames.iter_mut().enumerate() {
            frames.push(view.image(look));
        }
        depths.push(view.depth);
        tick(i + 1);
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
    let plain = &frames[0];
    let estimated = RANGES.map(|range| {
        Pairs::new(path.len(), range, |first, second| {
            let [there, back] = [[first, second], [second, first]]
                .map(|[from, to]| estimated(&plain[from], &plain[to]));
            Correspondence::of_flows(there, &back)
        })
    });
    (Walk { exact, estimated }, frames)
}
