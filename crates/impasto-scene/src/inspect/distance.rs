//! How far from the cameras a capture's surfaces are.

use super::neighbours::{self, Seen};
use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::scene::{Scene, Split};
use crate::statistics::median;

/// The typical depth of what the training photos show, scene units: half of the photos look further.
/// A photo's own is that of its sparse points or, without any, of what all cameras look at; without
/// training photos 0.
pub fn surface_distance(scene: &Scene) -> f64 {
    let cameras: Vec<Camera> = scene.photos.iter().map(|photo| photo.camera).collect();
    let geometry = CameraGeometry::of(&cameras);
    let seen = neighbours::seen(scene);
    let depths = scene.photos.iter().zip(&seen).filter_map(|(photo, seen)| {
        let learned = photo.split == Split::Train;
        learned.then(|| typical_depth(scene, &photo.camera, seen, &geometry))
    });
    median(depths).unwrap_or_default()
}

/// How far away a photo's sparse points are, or what all cameras look at.
pub(super) fn typical_depth(
    scene: &Scene,
    camera: &Camera,
    seen: &Seen,
    geometry: &CameraGeometry,
) -> f64 {
    let known = seen.iter().filter_map(|(point, _)| {
        let (_, depth) = camera.project(scene.points[*point].position)?;
        Some(depth)
    });
    let aimed = || geometry.target.distance(camera.centre());
    median(known).unwrap_or_else(aimed)
}
