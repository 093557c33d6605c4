//! What is known of a capture's surfaces before anything is learned.

use crate::geometry::photos::{KnownSurface, TargetRays};
use glam::{DVec3, DVec4, Vec4Swizzles};
use impasto_field::{Samples, contracted_distance};
use impasto_scene::{Camera, Scene};
use std::sync::Arc;

/// Replaces the samples' depths by their distance from the surface that is known on their ray, or
/// by zero: the composite's expected depth becomes the expected distance from that surface.
pub(crate) fn measure_from_surfaces(samples: &mut Samples, targets: &TargetRays) {
    let layout = Arc::make_mut(&mut samples.layout);
    layout.depths.fill(0.0);
    for (span, distance) in layout.rays.iter().zip(&targets.distances) {
        let Some(distance) = distance else { continue };
        let surface = contracted_distance(*distance);
        for i in span.inner.clone().chain(span.outer.clone()) {
            layout.depths[i] = (layout.distances[i] - surface).abs();
        }
    }
}

/// Whether a point, given as `(x', y', z', 1/r)`-like homogeneous coordinates, is in any view.
pub(crate) fn seen_by_any(cameras: &[Camera], point: [f32; 4]) -> bool {
    let p = DVec4::from(point.map(f64::from));
    // Towards infinity the direction is all that counts.
    let position: DVec3 = p.xyz() / p.w.max(1e-4);
    cameras.iter().any(|camera| {
        camera.project(position).is_some_and(|(pixel, _)| {
            let k = &camera.intrinsics;
            // A margin of a tenth of the image: cells are larger than their centres.
            let margin = 0.1 * f64::from(k.width.max(k.height));
            pixel.x > -margin
                && pixel.y > -margin
                && pixel.x < f64::from(k.width) + margin
                && pixel.y < f64::from(k.height) + margin
        })
    })
}

/// Sparse points as pixels of the training photos with known distance. Points that fewer than
/// three photos agree on, or that reproject badly, are not trusted.
pub(crate) fn known_surfaces(scene: &Scene) -> Vec<KnownSurface> {
    let mut index = vec![None; scene.photos.len()];
    for (position, (i, _)) in scene.train().enumerate() {
        index[i] = Some(position);
    }
    let mut surfaces = Vec::new();
    for point in scene.points.iter().filter(|p| p.error < 2.0) {
        // Held-out photos must not vouch for a point either.
        let witnesses = point.seen_by.iter().filter(|s| index[s.photo].is_some());
        if witnesses.count() < 3 {
            continue;
        }
        for seen in &point.seen_by {
            let Some(photo) = index[seen.photo] else {
                continue;
            };
            let camera = &scene.photos[seen.photo].camera;
            let k = &camera.intrinsics;
            let (x, y) = (seen.pixel.x.floor(), seen.pixel.y.floor());
            if x >= 0.0 && y >= 0.0 && x < f64::from(k.width) && y < f64::from(k.height) {
                let pixel = y as usize * k.width as usize + x as usize;
                if !scene.photos[seen.photo].is_used(pixel) {
                    continue;
                }
                surfaces.push(KnownSurface {
                    photo,
                    pixel,
                    distance: point.position.distance(camera.centre()) as f32,
                });
            }
        }
    }
    surfaces
}
