//! What is known of a capture's surfaces before anything is learned.

use crate::geometry::photos::KnownSurface;
use glam::{DVec3, DVec4, Vec4Swizzles};
use impasto_scene::{Camera, Scene};

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
