//! How many photos look at what a photo shows: what one photo alone sees, nothing can be known about
//! but its colour.

use glam::DVec2;
use rayon::prelude::*;
use serde::Serialize;

use super::distance::typical_depth;
use super::neighbours::Seen;
use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::scene::{Scene, Split};
use crate::statistics::{median, quantile};

/// Places looked at along each side of a photo.
const PLACES: usize = 6;
/// Two that look at a place from directions further apart than this (cosine, 75°) rarely see the
/// same of it.
const LEAST_ALIGNMENT: f64 = 0.25;

/// By how many of the photos to learn from a place in one of them is seen, itself included.
/// Whatever stands between a camera and the place is not known and hides nothing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// Half of all places are seen by so many or more.
    pub median: usize,
    /// A tenth of them by so many or fewer.
    pub worst_tenth: usize,
    /// The photos whose places are seen by fewest, the worst first; at most three, and none that are
    /// seen as well as most.
    pub least: Vec<String>,
}

/// Most photos that are named.
const NAMED: usize = 3;

pub(super) fn coverage(scene: &Scene, geometry: &CameraGeometry, seen: &[Seen]) -> Coverage {
    let train: Vec<(usize, &Camera)> = scene
        .photos
        .iter()
        .enumerate()
        .filter(|(_, photo)| photo.split == Split::Train)
        .map(|(i, photo)| (i, &photo.camera))
        .collect();
    let counts: Vec<Vec<f64>> = train
        .par_iter()
        .map(|(i, camera)| {
            let depth = typical_depth(scene, camera, &seen[*i], geometry);
            let places = places(camera);
            let counts = places.map(|pixel| witnesses(camera, pixel, depth, &train) as f64);
            counts.collect()
        })
        .collect();
    let all = || counts.iter().flatten().copied();
    let usual = median(all()).unwrap_or_default();
    let mut means: Vec<(f64, usize)> = counts
        .iter()
        .zip(&train)
        .map(|(own, (photo, _))| (own.iter().sum::<f64>() / own.len().max(1) as f64, *photo))
        .filter(|(mean, _)| *mean < 0.75 * usual)
        .collect();
    means.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = means.iter().take(NAMED);
    Coverage {
        median: usual as usize,
        worst_tenth: quantile(all(), 0.1).unwrap_or_default() as usize,
        least: least.map(|(_, i)| scene.photos[*i].name.clone()).collect(),
    }
}

/// Middles of equal parts of a picture.
fn places(camera: &Camera) -> impl Iterator<Item = DVec2> + use<> {
    let size = DVec2::new(
        camera.intrinsics.width.into(),
        camera.intrinsics.height.into(),
    );
    let at = |i: usize| (i as f64 + 0.5) / PLACES as f64;
    (0..PLACES * PLACES).map(move |i| size * DVec2::new(at(i % PLACES), at(i / PLACES)))
}

/// Cameras that see the place at a depth behind a pixel of one of them, from about there.
fn witnesses(camera: &Camera, pixel: DVec2, depth: f64, all: &[(usize, &Camera)]) -> usize {
    let ray = camera.ray(pixel.x, pixel.y);
    let place = ray.origin + ray.direction * depth;
    let view = ray.direction.normalize_or_zero();
    let sees = |other: &Camera| {
        let k = &other.intrinsics;
        let towards = (place - other.centre()).normalize_or_zero();
        towards.dot(view) > LEAST_ALIGNMENT
            && other.project(place).is_some_and(|(at, _)| {
                at.cmpge(DVec2::ZERO).all()
                    && at.cmple(DVec2::new(k.width.into(), k.height.into())).all()
            })
    };
    all.iter().filter(|(_, other)| sees(other)).count()
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DQuat, DVec3};
    use image::RgbImage;

    use super::*;
    use crate::camera::Intrinsics;
    use crate::format::Format;
    use crate::inspect::surface_distance;
    use crate::normalise::Normalisation;
    use crate::scene::{Observation, Photo, SparsePoint};

    fn scene(cameras: &[(f64, f64)]) -> Scene {
        let photos = cameras.iter().enumerate().map(|(i, (x, yaw))| Photo {
            name: format!("{i}.png"),
            path: "x".into(),
            camera: Camera {
                camera_to_world: DMat4::from_rotation_translation(
                    DQuat::from_rotation_y(*yaw),
                    DVec3::new(*x, 0.0, 0.0),
                ),
                intrinsics: Intrinsics {
                    width: 60,
                    height: 40,
                    fl_x: 60.0,
                    fl_y: 60.0,
                    cx: 30.0,
                    cy: 20.0,
                    distortion: crate::Distortion::default(),
                },
            },
            split: Split::Train,
            pixels: RgbImage::new(60, 40),
            mask: None,
        });
        Scene {
            name: "s".into(),
            format: Format::Transforms,
            photos: photos.collect(),
            points: Vec::new(),
            normalisation: Normalisation::IDENTITY,
            synthetic: false,
            warnings: Vec::new(),
        }
    }

    fn found(cameras: &[(f64, f64)]) -> Coverage {
        let scene = scene(cameras);
        let all: Vec<Camera> = scene.photos.iter().map(|p| p.camera).collect();
        let seen = vec![Seen::new(); all.len()];
        coverage(&scene, &CameraGeometry::of(&all), &seen)
    }

    #[test]
    fn a_photo_that_looks_away_is_the_only_one_to_see_what_it_shows() {
        // Seven side by side that look at one thing, one that looks back.
        let mut cameras: Vec<(f64, f64)> = (0..7)
            .map(|i| {
                let x = 0.05 * f64::from(i) - 0.15;
                (x, (-x).atan2(2.0))
            })
            .collect();
        let together = found(&cameras);
        assert!(
            together.median == 7 && together.worst_tenth >= 6,
            "{together:?}"
        );
        assert!(together.least.is_empty());
        cameras.push((0.0, 3.1));
        let alone = found(&cameras);
        assert_eq!((alone.median, alone.worst_tenth), (7, 1));
        assert_eq!(alone.least, ["7.png"]);
    }

    #[test]
    fn surfaces_are_where_cameras_aim_or_where_points_are() {
        let cameras: Vec<(f64, f64)> = (0..7)
            .map(|i| {
                let x = 0.05 * f64::from(i) - 0.15;
                (x, (-x).atan2(2.0))
            })
            .collect();
        let mut scene = scene(&cameras);
        let aimed = surface_distance(&scene);
        // Drawn a little towards the cameras, as their common target is.
        assert!((aimed - 2.0).abs() < 0.15, "{aimed}");
        let seen = |photo| Observation {
            photo,
            pixel: DVec2::splat(20.0),
        };
        scene.points = vec![SparsePoint {
            position: DVec3::new(0.0, 0.0, 3.0),
            colour: [0; 3],
            seen_by: (0..7).map(seen).collect(),
            error: 0.5,
        }];
        let known = surface_distance(&scene);
        assert!((known - 3.0).abs() < 0.02, "{known}");
    }
}
