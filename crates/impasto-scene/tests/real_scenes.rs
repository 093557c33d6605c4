//! The real captures beside the repository load, and their points lie where the photos show them.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use common::shared;
use glam::DVec3;
use impasto_scene::{Camera, LoadOptions, MaskUse, Scene, Split, load, paths};

fn scene(name: &str) -> Option<Scene> {
    let path = shared(&format!("data/scenes/{name}"))?;
    let options = LoadOptions {
        downscale: 8,
        format: None,
        masks: MaskUse::Ignore,
        train_photos: None,
    };
    Some(load(&path, &options).unwrap_or_else(|e| panic!("{e}")))
}

fn check_common(scene: &Scene, photos: usize) {
    assert_eq!(scene.photos.len(), photos);
    assert_eq!(scene.test().count(), photos.div_ceil(8));
    let centres: Vec<DVec3> = scene.photos.iter().map(|p| p.camera.centre()).collect();
    let farthest = centres.iter().map(|c| c.length()).fold(0.0, f64::max);
    assert!((farthest - 1.0 / 1.1).abs() < 1e-9);
    for photo in &scene.photos {
        let k = &photo.camera.intrinsics;
        assert_eq!(photo.pixels.dimensions(), (k.width, k.height));
        assert!(k.fl_x > 0.3 * f64::from(k.width));
    }
}

/// Every camera of the orbit is near some photo's camera, and they turn by small steps.
fn check_orbit(scene: &Scene, nearness: f64) {
    let cameras = scene.cameras(Split::Train);
    let orbit = paths::orbit(&cameras, 120, (160, 90)).unwrap();
    assert_eq!(orbit.len(), 120);
    let nearest = |c: &Camera| {
        let distances = cameras.iter().map(|p| p.centre().distance(c.centre()));
        distances.fold(f64::INFINITY, f64::min)
    };
    let worst = orbit.iter().map(nearest).fold(0.0, f64::max);
    assert!(
        worst < nearness,
        "{}: {worst} from the nearest photo",
        scene.name
    );
    for (a, b) in orbit.iter().zip(orbit.iter().cycle().skip(1)) {
        assert!(a.centre().distance(b.centre()) < 0.2);
        assert!(a.forward().dot(b.forward()) > 0.99);
    }
}

fn check_colmap(name: &str, photos: usize, points: usize, nearness: f64) {
    let Some(scene) = scene(name) else { return };
    check_common(&scene, photos);
    assert_eq!(scene.points.len(), points);
    let mut sum = 0.0;
    let mut count = 0;
    for point in &scene.points {
        for seen in &point.seen_by {
            let camera = &scene.photos[seen.photo].camera;
            let (pixel, _) = camera.project(point.position).expect("in front");
            let error = pixel.distance(seen.pixel);
            assert!(error < 1.0, "{name}: {error} pixels off");
            sum += error;
            count += 1;
        }
    }
    assert!(count > 10_000);
    let mean = sum / f64::from(count);
    assert!(mean < 0.1);
    check_orbit(&scene, nearness);
}

#[test]
fn castle_p30() {
    check_colmap("castle_p30", 30, 9440, 0.5);
}

#[test]
fn herzjesu_p25() {
    check_colmap("herzjesu_p25", 25, 6232, 0.5);
}

#[test]
fn sakharov_statue() {
    check_colmap("sakharov_statue", 32, 7761, 0.5);
}

#[test]
fn south_building() {
    check_colmap("south_building", 128, 23_839, 0.5);
}

#[test]
fn fox() {
    let Some(scene) = scene("fox") else { return };
    check_common(&scene, 50);
    for photo in &scene.photos {
        let k = photo.camera.intrinsics;
        assert_eq!((k.width, k.height), (68, 120));
        assert!(k.distortion.k1 > 0.05 && k.distortion.k2 < -0.08);
    }
    check_orbit(&scene, 0.6);
}
