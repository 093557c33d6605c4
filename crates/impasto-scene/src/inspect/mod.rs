//! What a capture is like: lenses, how cameras stand, and photo by photo what may be wrong.

mod compare;
mod layout;
mod look;
mod neighbours;
mod problems;

use serde::Serialize;

use crate::camera::Camera;
use crate::paths::shape::Shape;
use crate::scene::{Scene, Split};
use compare::{Comparison, PointLooks};
pub use layout::{Layout, Lens, Walk};
use look::WholeLook;
use neighbours::{Neighbour, Seen};
pub use problems::{Problem, ProblemKind};

/// What was found about a capture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Lenses, those with most photos first.
    pub lenses: Vec<Lens>,
    /// Where cameras stand.
    pub cameras: Layout,
    /// Photo by photo, in the scene's order.
    pub per_photo: Vec<PhotoFacts>,
    /// What is wrong with single photos, the worst first.
    pub problems: Vec<Problem>,
}

/// What was measured of one photo.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhotoFacts {
    /// Name within the capture.
    pub photo: String,
    /// What it is used for.
    pub split: Split,
    /// Fine detail as a share of what neighbouring photos have of the same things: 1 is alike, small
    /// is blurred. `None` where there are fewer than three neighbours.
    pub sharpness: Option<f64>,
    /// Mean luma of the stored values, 0 to 1.
    pub brightness: f64,
    /// Stops brighter than neighbouring photos, of the same things.
    pub stops: Option<f64>,
    /// Share of the photo, 0 to 1, that its second-best neighbour shows as well: of its sparse
    /// points, or of its view where the capture has none.
    pub overlap: f64,
    /// Photos that show most of the same, at most three.
    pub neighbours: Vec<String>,
    /// Sparse points that it sees.
    pub points: Option<usize>,
    /// Of those, how many its second-best neighbour sees.
    pub shared_points: Option<usize>,
    /// Median distance, in pixels, of those from where its camera projects them.
    pub reprojection_error: Option<f64>,
}

/// Everything measured, for the judges.
struct Measured<'a> {
    scene: &'a Scene,
    cameras: &'a [Camera],
    shape: &'a Shape,
    layout: &'a Layout,
    facts: &'a [PhotoFacts],
    compared: &'a [Option<Comparison>],
    looks: &'a [(WholeLook, PointLooks)],
}

/// Looks at every photo and camera of a capture. Runs on all of rayon's threads; takes about a
/// second for a hundred photos of ten megapixels.
pub fn inspect(scene: &Scene) -> Inspection {
    let cameras: Vec<Camera> = scene.photos.iter().map(|photo| photo.camera).collect();
    let shape = Shape::of(&cameras);
    let seen = neighbours::seen(scene);
    let has_points = seen.iter().any(|points| !points.is_empty());
    let near = if has_points {
        neighbours::by_points(scene, &seen)
    } else {
        neighbours::by_views(&cameras, &shape)
    };
    let looks = compare::looks(&scene.photos, &seen);
    let compared = compare::compare(&looks, &near);
    let facts = |i: usize| PhotoFacts {
        sharpness: compared[i].map(|c| c.detail.exp()),
        stops: compared[i].map(|c| c.stops),
        brightness: looks[i].0.look.brightness / 255.0,
        ..linked(scene, i, &near[i], has_points.then(|| &seen[i]))
    };
    let facts: Vec<PhotoFacts> = (0..cameras.len()).map(facts).collect();
    let layout = layout::layout(scene, &cameras, &shape);
    let problems = problems::found(&Measured {
        scene,
        cameras: &cameras,
        shape: &shape,
        layout: &layout,
        facts: &facts,
        compared: &compared,
        looks: &looks,
    });
    Inspection {
        lenses: layout::lenses(scene),
        cameras: layout,
        per_photo: facts,
        problems,
    }
}

/// What a photo has in common with others.
fn linked(scene: &Scene, index: usize, near: &[Neighbour], seen: Option<&Seen>) -> PhotoFacts {
    let photo = &scene.photos[index];
    let error = |(point, pixel): &(usize, glam::DVec2)| {
        let projected = photo.camera.project(scene.points[*point].position);
        projected.map_or(f64::INFINITY, |(at, _)| at.distance(*pixel))
    };
    // By what they show, which is not always the order of the most alike.
    let mut overlaps: Vec<f64> = near.iter().map(|n| n.overlap).collect();
    overlaps.sort_by(|a, b| b.total_cmp(a));
    PhotoFacts {
        photo: photo.name.clone(),
        split: photo.split,
        sharpness: None,
        brightness: 0.0,
        stops: None,
        overlap: overlaps.get(1).copied().unwrap_or(0.0),
        neighbours: near
            .iter()
            .take(3)
            .map(|n| scene.photos[n.photo].name.clone())
            .collect(),
        points: seen.map(Vec::len),
        shared_points: seen.map(|_| near.get(1).map_or(0, |n| n.shared)),
        reprojection_error: seen.and_then(|seen| median(seen.iter().map(error))),
    }
}

/// The middle value; `None` of nothing.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
