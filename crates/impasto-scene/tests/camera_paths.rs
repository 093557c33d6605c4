//! Camera paths follow the photos they are fitted to and the files they are read from.

mod common;

use std::f64::consts::{PI, TAU};

use common::{camera, ring};
use glam::{DMat3, DMat4, DVec3};
use impasto_scene::paths::{KeyframeOptions, PathError, keyframes, orbit, spiral};
use impasto_scene::{Camera, Normalisation};
use serde_json::json;

const SIZE: (u32, u32) = (60, 40);
const TARGET: DVec3 = DVec3::new(0.1, 0.2, -0.1);

fn azimuth(camera: &Camera) -> f64 {
    let arm = camera.centre() - TARGET;
    arm.z.atan2(arm.x)
}

fn assert_rigid(cameras: &[Camera]) {
    for camera in cameras {
        let r = DMat3::from_mat4(camera.camera_to_world);
        assert!((r.transpose() * r).abs_diff_eq(DMat3::IDENTITY, 1e-9));
        assert!((r.determinant() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn an_orbit_of_a_full_ring_is_that_ring() {
    let photos = ring(24, TAU, TARGET);
    let path = orbit(&photos, 48, SIZE).unwrap();
    assert_rigid(&path);
    for camera in &path {
        let arm = camera.centre() - TARGET;
        assert!((arm.x.hypot(arm.z) - 3.0).abs() < 1e-3, "{arm}");
        assert!((arm.y + 1.0).abs() < 1e-3, "{arm}");
        assert!(camera.forward().dot(-arm.normalize_or_zero()) > 0.9999);
        // The horizon is level and upright: y of the world is down.
        assert!(camera.camera_to_world.x_axis.y.abs() < 1e-6);
        assert!(camera.camera_to_world.y_axis.y > 0.9);
        assert!(camera.intrinsics.distortion.is_none());
        assert!((camera.intrinsics.fl_x - 51.0).abs() < 1e-9);
    }
    let mut azimuths: Vec<f64> = path.iter().map(azimuth).collect();
    azimuths.sort_by(f64::total_cmp);
    for pair in azimuths.windows(2) {
        assert!((pair[1] - pair[0] - TAU / 48.0).abs() < 1e-3);
    }
}

#[test]
fn an_orbit_of_an_arc_stays_in_the_arc_and_swings() {
    let photos = ring(20, PI, TARGET);
    let path = orbit(&photos, 60, SIZE).unwrap();
    assert_rigid(&path);
    let last = PI * 19.0 / 20.0;
    for camera in &path {
        let azimuth = azimuth(camera);
        assert!((-1e-3..last + 1e-3).contains(&azimuth), "{azimuth}");
    }
    assert!((azimuth(&path[30]) - last).abs() < 1e-2 || azimuth(&path[30]).abs() < 1e-2);
    assert!(path[10].centre().distance(path[50].centre()) < 1e-9);
}

#[test]
fn an_orbit_of_a_capture_that_looks_outwards_looks_outwards() {
    let mut photos = ring(16, TAU, TARGET);
    for photo in &mut photos {
        let away = photo.centre() * 2.0 - TARGET;
        *photo = camera(photo.centre(), away, SIZE);
    }
    for camera in orbit(&photos, 20, SIZE).unwrap() {
        assert!(camera.forward().dot(camera.centre() - TARGET) > 0.0);
    }
}

#[test]
fn a_photo_of_something_else_does_not_move_the_orbit() {
    let mut photos = ring(24, TAU, TARGET);
    photos[5] = camera(photos[5].centre(), TARGET + DVec3::new(9.0, 0.0, 2.0), SIZE);
    for camera in orbit(&photos, 30, SIZE).unwrap() {
        let arm = camera.centre() - TARGET;
        assert!((arm.x.hypot(arm.z) - 3.0).abs() < 0.05, "{arm}");
    }
}

/// Cameras on a wall of 4×3 that look along z.
fn wall() -> Vec<Camera> {
    let mut photos = Vec::new();
    for i in 0..4 {
        for j in 0..3 {
            let centre = DVec3::new(f64::from(i) - 1.5, 0.5 * f64::from(j) - 0.5, 0.0);
            photos.push(camera(
                centre,
                centre * 0.9 + DVec3::new(0.0, 0.0, 10.0),
                SIZE,
            ));
        }
    }
    photos
}

#[test]
fn forward_facing_captures_get_a_spiral_among_their_cameras() {
    let photos = wall();
    let path = orbit(&photos, 40, SIZE).unwrap();
    assert_eq!(path, spiral(&photos, 40, SIZE).unwrap());
    assert_rigid(&path);
    for camera in &path {
        let c = camera.centre();
        assert!(c.x.abs() < 1.5 && c.y.abs() < 0.5, "{c}");
        assert!(camera.forward().z > 0.95);
    }
    let width = path.iter().map(|c| c.centre().x).fold(0.0, f64::max);
    assert!(width > 0.5, "the path moves: {width}");
}

#[test]
fn a_path_of_another_shape_shows_no_more_than_the_photos() {
    let photos = ring(12, TAU, TARGET);
    for size in [(40, 60), (160, 40), (60, 40)] {
        let k = orbit(&photos, 1, size).unwrap()[0].intrinsics;
        assert!(f64::from(size.0) / k.fl_x <= 60.0 / 50.0 + 1e-9);
        assert!(f64::from(size.1) / k.fl_y <= 40.0 / 51.0 + 1e-9);
    }
}

#[test]
fn impossible_requests_are_refused() {
    let photos = ring(12, TAU, TARGET);
    assert!(matches!(
        orbit(&photos, 0, SIZE),
        Err(PathError::Empty { .. })
    ));
    assert!(matches!(
        spiral(&photos, 5, (0, 4)),
        Err(PathError::Empty { .. })
    ));
    assert!(matches!(
        orbit(&[], 5, SIZE),
        Err(PathError::TooFewCameras { .. })
    ));
    for (frames, size) in [(usize::MAX, SIZE), (5, (u32::MAX, u32::MAX))] {
        assert!(matches!(
            orbit(&photos, frames, size),
            Err(PathError::TooLarge { .. })
        ));
    }
    // One camera, or many at one place, still make a film.
    for few in [&photos[..1], &[photos[0]; 3]] {
        let path = orbit(few, 5, SIZE).unwrap();
        assert_rigid(&path);
        assert!(path.iter().all(|c| c.centre().is_finite()));
    }
}

fn options<'a>(cameras: &'a [Camera], normalisation: &'a Normalisation) -> KeyframeOptions<'a> {
    KeyframeOptions {
        cameras,
        normalisation,
        frames: None,
        size: None,
    }
}

#[test]
fn our_own_cameras_come_back_as_they_were() {
    let mut photos = ring(7, TAU, TARGET);
    photos[2].intrinsics.distortion.k1 = 0.1;
    let text = json!({ "frames": photos }).to_string();
    let read = keyframes(&text, &options(&[], &Normalisation::IDENTITY)).unwrap();
    assert_eq!(read.len(), 7);
    for (a, b) in read.iter().zip(&photos) {
        assert_eq!(a.intrinsics, b.intrinsics);
        assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-12));
    }
}

#[test]
fn interpolation_meets_the_keys_and_moves_smoothly_between_them() {
    let keys = ring(9, TAU, TARGET);
    let text = json!({ "frames": keys }).to_string();
    let mut options = options(&[], &Normalisation::IDENTITY);
    options.frames = Some(8 * 20 + 1);
    let path = keyframes(&text, &options).unwrap();
    assert_rigid(&path);
    for (key, camera) in keys.iter().zip(path.iter().step_by(20)) {
        assert!(
            camera
                .camera_to_world
                .abs_diff_eq(key.camera_to_world, 1e-9)
        );
    }
    // Without keys at its ends the curve cannot know the circle: leave the first and last span.
    for camera in &path[20..140] {
        assert!(
            (camera.centre() - TARGET).length() > 3.0,
            "{}",
            camera.centre()
        );
    }
    for three in path.windows(3) {
        let bend = three[0].centre() - 2.0 * three[1].centre() + three[2].centre();
        assert!(bend.length() < 0.02, "{bend}");
    }
}

#[test]
fn nerfstudio_paths_are_capture_coordinates_in_opengl_axes() {
    let normalisation = Normalisation {
        centre: DVec3::new(10.0, -4.0, 3.0),
        scale: 0.2,
    };
    let expected = ring(4, PI, TARGET);
    let key = |camera: &Camera| -> Vec<f64> {
        let capture = normalisation.pose_to_capture(camera.camera_to_world);
        let opengl = capture * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        opengl.transpose().to_cols_array().to_vec()
    };
    let list: Vec<_> = expected
        .iter()
        .map(|c| json!({ "camera_to_world": key(c), "fov": 60.0 }))
        .collect();
    let text =
        json!({ "render_width": 200, "render_height": 100.0, "camera_path": list }).to_string();
    let read = keyframes(&text, &options(&expected, &normalisation)).unwrap();
    for (a, b) in read.iter().zip(&expected) {
        assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-9));
        assert_eq!((a.intrinsics.width, a.intrinsics.height), (200, 100));
        assert!((a.intrinsics.fl_y - 50.0 / 30f64.to_radians().tan()).abs() < 1e-9);
    }
    let list: Vec<_> = expected
        .iter()
        .map(|c| json!({ "matrix": key(c) }))
        .collect();
    let text =
        json!({ "keyframes": list, "fps": 24, "seconds": 2.0, "is_cycle": true }).to_string();
    let read = keyframes(&text, &options(&expected, &normalisation)).unwrap();
    assert_eq!(read.len(), 48);
    assert!(
        read[12]
            .camera_to_world
            .abs_diff_eq(expected[1].camera_to_world, 1e-9)
    );
    assert_rigid(&read);
}

#[test]
fn wrong_path_files_are_refused_by_frame() {
    let photos = ring(3, PI, TARGET);
    let refused = |text: &str| {
        let result = keyframes(text, &options(&photos, &Normalisation::IDENTITY));
        result.expect_err("must be refused").to_string()
    };
    assert!(refused("").contains("not valid"));
    assert!(refused("{}").contains("no frames"));
    assert!(refused(r#"{"frames": []}"#).contains("no frames"));
    let capture = refused(r#"{"frames": [{"file_path": "a", "transform_matrix": []}]}"#);
    assert!(
        capture.contains("frame 0") && capture.contains("transforms.json"),
        "{capture}"
    );
    let mut frames = json!({ "frames": photos });
    frames["frames"][1]["camera_to_world"][0][0] = json!(5.0);
    let scaled = refused(&frames.to_string());
    assert!(
        scaled.contains("frame 1") && scaled.contains("not a rotation"),
        "{scaled}"
    );
    let short = refused(r#"{"keyframes": [{"matrix": [1, 2]}]}"#);
    assert!(
        short.contains("keyframe 0") && short.contains("2 numbers"),
        "{short}"
    );
    let key = json!({ "matrix": DMat4::IDENTITY.to_cols_array(), "fov": 180.0 });
    let wide = refused(&json!({ "keyframes": [key] }).to_string());
    assert!(
        wide.contains("keyframe 0") && wide.contains("180 degrees"),
        "{wide}"
    );
}
