//! A walk through a scene: frames along a path, and which of their pixels show the same.

use crate::consistency::{Pairs, RANGES};
use crate::flow::{Correspondence, Geometry};
use image::RgbImage;
use impasto_scene::Camera;
use impasto_train::{Look, Model};

/// A walk's correspondences, at short and at long range.
pub(crate) struct Walk {
    pub(crate) pairs: [Pairs; 2],
}

/// Renders a walk with every look; geometry is computed once. Frames come look by look. `tick`
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
    let pairs = RANGES.map(|range| {
        Pairs::new(path.len(), range, |first, second| {
            Correspondence::exact(&geometry(first), &geometry(second))
        })
    });
    (Walk { pairs }, frames)
}
