//! Which photos show the same part of a place.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::scene::Scene;

/// Another photo that shows part of what a photo shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Neighbour {
    /// Index into the scene's photos.
    pub(super) photo: usize,
    /// Sparse points that both see; 0 for captures without points.
    pub(super) shared: usize,
    /// Share of the photo's points, or of its view, that the other sees, 0 to 1.
    pub(super) overlap: f64,
}

/// What a photo sees of the sparse points: their indices with where they are, by index.
pub(super) type Seen = Vec<(usize, DVec2)>;

/// Per photo, the sparse points that it sees.
pub(super) fn seen(scene: &Scene) -> Vec<Seen> {
    let mut seen: Vec<Seen> = vec![Vec::new(); scene.photos.len()];
    for (index, point) in scene.points.iter().enumerate() {
        for observation in &point.seen_by {
            seen[observation.photo].push((index, observation.pixel));
        }
    }
    seen
}

/// Most pairs of observations that are counted, so that tracks of thousands of photos take no
/// longer than a second.
const MOST_PAIRS: usize = 50_000_000;

/// Per photo its neighbours, those that share most points first.
pub(super) fn by_points(scene: &Scene, seen: &[Seen]) -> Vec<Vec<Neighbour>> {
    let pairs: usize = scene.points.iter().map(|p| p.seen_by.len().pow(2)).sum();
    let step = pairs / MOST_PAIRS + 1;
    let mut shared: Vec<HashMap<usize, usize>> = vec![HashMap::new(); scene.photos.len()];
    for point in scene.points.iter().step_by(step) {
        for one in &point.seen_by {
            for other in point.seen_by.iter().filter(|o| o.photo != one.photo) {
                *shared[one.photo].entry(other.photo).or_default() += step;
            }
        }
    }
    let neighbours = |(counts, seen): (HashMap<usize, usize>, &Seen)| {
        let of = counts.into_iter().map(|(photo, shared)| Neighbour {
            photo,
            shared,
            overlap: (shared as f64 / seen.len().max(1) as f64).min(1.0),
        });
        let mut all: Vec<Neighbour> = of.collect();
        all.sort_by_key(|n| (std::cmp::Reverse(n.shared), n.photo));
        all
    };
    shared.into_iter().zip(seen).map(neighbours).collect()
}

/// Points across and down a view that stand for all of it.
const GRID: usize = 5;
/// Depths at which they lie, in parts of the assumed one.
const DEPTHS: [f64; 3] = [0.7, 1.0, 1.6];
/// Photos of one thing from directions farther apart than this (60°) look too different to share
/// anything: features are not found again, and exposure differs for good reasons.
const LEAST_ALIGNMENT: f64 = 0.5;
/// Photos that are compared with each.
const CANDIDATES: usize = 32;

/// Per photo its neighbours by cameras alone, the most similar views first. The place is assumed at
/// about the distance of what the cameras look at.
pub(super) fn by_views(cameras: &[Camera], geometry: &CameraGeometry) -> Vec<Vec<Neighbour>> {
    (0..cameras.len())
        .into_par_iter()
        .map(|index| {
            let camera = &cameras[index];
            let depth = assumed_depth(camera, geometry);
            let view = view(camera, depth);
            let others = candidates(cameras, index, depth).into_iter().map(|photo| {
                let visible = view.iter().filter(|p| sees(&cameras[photo], **p)).count();
                Neighbour {
                    photo,
                    shared: 0,
                    overlap: visible as f64 / view.len() as f64,
                }
            });
            others.filter(|n| n.overlap > 0.0).collect()
        })
        .collect()
}

/// Other cameras that look the same way, in the order of how much the view moves from one to the
/// other: by its step, as an angle from `depth` away, and by its turn.
fn candidates(cameras: &[Camera], index: usize, depth: f64) -> Vec<usize> {
    let own = &cameras[index];
    let mut others: Vec<(f64, usize)> = Vec::new();
    for (i, other) in cameras.iter().enumerate() {
        let alignment = other.forward().dot(own.forward());
        if i != index && alignment > LEAST_ALIGNMENT {
            let step = other.centre().distance(own.centre()) / depth.max(1e-12);
            others.push((step + alignment.min(1.0).acos(), i));
        }
    }
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    others
        .into_iter()
        .take(CANDIDATES)
        .map(|(_, i)| i)
        .collect()
}

/// How far away a camera's subject may be: what all look at, where it lies ahead.
fn assumed_depth(camera: &Camera, geometry: &CameraGeometry) -> f64 {
    let ahead = (geometry.target - camera.centre()).dot(camera.forward());
    if ahead > 0.3 * geometry.extent {
        ahead
    } else {
        3.0 * geometry.extent
    }
}

/// Points all over a camera's view, about `depth` away.
fn view(camera: &Camera, depth: f64) -> Vec<DVec3> {
    let k = &camera.intrinsics;
    let along = |i: usize, side: u32| (i as f64 + 0.5) / GRID as f64 * f64::from(side);
    let ray = |i: usize| camera.ray(along(i % GRID, k.width), along(i / GRID, k.height));
    let rays = (0..GRID * GRID).map(ray);
    rays.flat_map(|ray| DEPTHS.map(|part| ray.origin + ray.direction * (part * depth)))
        .collect()
}

fn sees(camera: &Camera, point: DVec3) -> bool {
    let k = &camera.intrinsics;
    camera.project(point).is_some_and(|(pixel, _)| {
        let inside = DVec2::new(f64::from(k.width), f64::from(k.height));
        pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(inside).all()
    })
}
