//! The real COLMAP on a dozen real photos, beside the poses that they were published with.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![allow(clippy::print_stdout, reason = "a skipped test says so")]

use std::fs;
use std::path::Path;
use std::process::Command;

use glam::{DMat3, DVec3};
use impasto_prepare::{Cameras, Matching, PrepareOptions, prepare};
use impasto_scene::{LoadOptions, Photo, Scene, load, read_rgb};
use nalgebra::{Matrix3, Vector3};

const PHOTOS: usize = 12;
/// The photos are made about this wide, for speed.
const WIDTH: u32 = 640;

/// Rotation, scale and translation that bring `from` closest to `to` in the sense of least squares.
fn similarity(from: &[DVec3], to: &[DVec3]) -> (DMat3, f64, DVec3) {
    let count = from.len() as f64;
    let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / count;
    let (from_mean, to_mean) = (mean(from), mean(to));
    let vector = |v: DVec3| Vector3::new(v.x, v.y, v.z);
    let mut covariance = Matrix3::zeros();
    for (a, b) in from.iter().zip(to) {
        covariance += vector(b - to_mean) * vector(a - from_mean).transpose() / count;
    }
    let variance = from
        .iter()
        .map(|a| a.distance_squared(from_mean))
        .sum::<f64>()
        / count;
    let svd = covariance.svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
    let rotation = u * sign * v;
    let scale = (Matrix3::from_diagonal(&svd.singular_values) * sign).trace() / variance;
    let columns: [f64; 9] = rotation.as_slice().try_into().unwrap();
    let rotation = DMat3::from_cols_array(&columns);
    (rotation, scale, to_mean - rotation * from_mean * scale)
}

/// Largest errors after alignment: of centres as a share of the cameras' extent, and of rotations
/// in degrees.
fn errors(found: &Scene, given: &Scene) -> (f64, f64) {
    let twin = |photo: &Photo| {
        let named = |p: &&Photo| p.name == photo.name;
        given.photos.iter().find(named).unwrap().camera
    };
    let pairs: Vec<_> = found.photos.iter().map(|p| (p.camera, twin(p))).collect();
    let (from, to): (Vec<DVec3>, Vec<DVec3>) =
        pairs.iter().map(|(a, b)| (a.centre(), b.centre())).unzip();
    let (rotation, scale, shift) = similarity(&from, &to);
    let extent = to
        .iter()
        .flat_map(|a| to.iter().map(|b| a.distance(*b)))
        .fold(0.0, f64::max);
    let (mut centre, mut angle) = (0.0f64, 0.0f64);
    for (a, b) in &pairs {
        let moved = rotation * a.centre() * scale + shift;
        centre = centre.max(moved.distance(b.centre()) / extent);
        let turned = rotation * DMat3::from_mat4(a.camera_to_world);
        let between = turned.transpose() * DMat3::from_mat4(b.camera_to_world);
        let trace = between.x_axis.x + between.y_axis.y + between.z_axis.z;
        angle = angle.max(((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees());
    }
    (centre, angle)
}

#[test]
fn a_dozen_photos_of_the_castle_get_their_poses_back() {
    let castle =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/scenes/castle_p30");
    if !castle.is_dir() {
        println!("skipped: {} is not there", castle.display());
        return;
    }
    if Command::new("colmap").arg("-h").output().is_err() {
        println!("skipped: COLMAP is not installed");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    fs::create_dir(&photos).unwrap();
    for number in 0..PHOTOS {
        let name = format!("{number:04}.jpg");
        let photo = read_rgb(&castle.join("images").join(&name)).unwrap();
        let small = image::imageops::resize(
            &photo,
            WIDTH,
            photo.height() * WIDTH / photo.width(),
            image::imageops::FilterType::CatmullRom,
        );
        let file = fs::File::create(photos.join(&name)).unwrap();
        image::codecs::jpeg::JpegEncoder::new_with_quality(file, 95)
            .encode_image(&small)
            .unwrap();
    }
    let options = PrepareOptions {
        input: photos,
        scene: folder.path().join("scene"),
        frames: PHOTOS,
        matching: Matching::Auto,
        cameras: Cameras::Auto,
        colmap: "colmap".into(),
        ffmpeg: "ffmpeg".into(),
    };
    let summary = prepare(&options, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"));
    assert!(summary.photos.registered >= PHOTOS - 1, "{summary:?}");
    assert!(summary.reprojection_error < 0.6, "{summary:?}");
    // 919.8 pixels at 1024 of width.
    let focal = summary.lenses[0].fl_x;
    assert!((focal / 574.9 - 1.0).abs() < 0.02, "{focal}");

    let small = LoadOptions {
        downscale: 8,
        ..LoadOptions::default()
    };
    let found = load(&options.scene, &small).unwrap();
    let (centre, angle) = errors(&found, &load(&castle, &small).unwrap());
    println!(
        "largest errors: centres {:.3} % of the extent, rotations {angle:.3}°",
        100.0 * centre
    );
    // Twice what is measured, or a little more: 0.2 % and 0.6°.
    assert!(centre < 0.005, "{centre}");
    // Most of it is one turn of all cameras against a principal point that a dozen photos leave
    // uncertain by some pixels.
    assert!(angle < 1.25, "{angle}");
}
