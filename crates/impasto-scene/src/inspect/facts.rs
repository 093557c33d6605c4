//! What is measured of single photos.

use glam::DVec2;
use serde::Serialize;

use super::compare::Comparison;
use super::neighbours::{Neighbour, Seen};
use super::quality::PhotoQuality;
use crate::scene::{Scene, Split};
use crate::statistics::median;

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

impl PhotoFacts {
    /// What was measured of the photo `index`; `seen` where the capture has points.
    pub(super) fn of(
        scene: &Scene,
        index: usize,
        near: &[Neighbour],
        seen: Option<&Seen>,
        quality: &PhotoQuality,
        compared: Option<Comparison>,
    ) -> Self {
        let photo = &scene.photos[index];
        let error = |(point, pixel): &(usize, DVec2)| {
            let projected = photo.camera.project(scene.points[*point].position);
            projected.map_or(f64::INFINITY, |(at, _)| at.distance(*pixel))
        };
        // By what they show, which is not always the order of the most alike.
        let mut overlaps: Vec<f64> = near.iter().map(|n| n.overlap).collect();
        overlaps.sort_by(|a, b| b.total_cmp(a));
        let alike = near.iter().take(3);
        Self {
            photo: photo.name.clone(),
            split: photo.split,
            sharpness: compared.map(|c| c.detail.exp()),
            brightness: quality.whole.brightness / 255.0,
            stops: compared.map(|c| c.stops),
            overlap: overlaps.get(1).copied().unwrap_or(0.0),
            neighbours: alike.map(|n| scene.photos[n.photo].name.clone()).collect(),
            points: seen.map(Vec::len),
            shared_points: seen.map(|_| near.get(1).map_or(0, |n| n.shared)),
            reprojection_error: seen.and_then(|seen| median(seen.iter().map(error))),
        }
    }
}
