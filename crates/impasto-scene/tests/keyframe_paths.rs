//! Camera paths through keyframes come back from nerfstudio's form as they were, and go evenly.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::f64::consts::{PI, TAU};

use common::ring;
use glam::{DMat4, DQuat, DVec3};
use impasto_scene::paths::{CameraPath, Keyframe, KeyframeOptions, PathError, keyframes};
use impasto_scene::{Camera, Normalisation};
use serde_json::{Value, json};

const CAPTURE: Normalisation = Normalisation {
    centre: DVec3::new(410.0, -4.0, 3.0),
    scale: 0.2,
};

/// Around a point, up and down, with another field of view at each keyframe.
fn walk(count: usize, closed: bool) -> CameraPath {
    let arc = if closed { TAU } else { PI };
    let target = DVec3::new(0.1, 0.2, -0.1);
    let key = |(i, camera): (usize, Camera)| {
        let mut pose = camera.camera_to_world;
        pose.w_axis.y += 0.2 * (i % 3) as f64;
        Keyframe {
            camera_to_world: pose,
            fov: 40.0 + 5.0 * (i % 4) as f64,
        }
    };
    CameraPath {
        keyframes: ring(count, arc, target)
            .into_iter()
            .enumerate()
            .map(key)
            .collect(),
        seconds: 2.0,
        fps: 24.0,
        closed,
        size: (64, 36),
        even_speed: true,
    }
}

/// What `impasto render --views` makes of a file.
fn read(text: &str) -> Vec<Camera> {
    let options = KeyframeOptions {
        cameras: &[],
        normalisation: &CAPTURE,
        frames: None,
        size: None,
    };
    keyframes(text, &options).unwrap()
}

#[test]
fn the_written_path_is_read_as_the_same_cameras() {
    for (count, closed, even_speed) in [
        (5, false, true),
        (5, true, true),
        (3, true, false),
        (1, false, true),
        (1, true, true),
        (2, false, false),
        (48, false, false),
    ] {
        let path = CameraPath {
            even_speed,
            ..walk(count, closed)
        };
        let cameras = path.cameras().unwrap();
        assert_eq!(cameras.len(), 48);
        let again = read(&path.to_nerfstudio(&CAPTURE).unwrap());
        assert_eq!(again.len(), cameras.len());
        for (a, b) in again.iter().zip(&cameras) {
            assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-9));
            let (a, b) = (a.intrinsics, b.intrinsics);
            assert_eq!((a.width, a.height, a.cx, a.cy), (64, 36, b.cx, b.cy));
            assert!((a.fl_x - b.fl_x).abs() < 1e-9 && (a.fl_y - b.fl_y).abs() < 1e-9);
        }
    }
}

#[test]
fn what_is_written_is_what_nerfstudio_writes() {
    let path = walk(4, true);
    let text = path.to_nerfstudio(&CAPTURE).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    for (key, value) in [
        ("camera_type", json!("perspective")),
        ("render_width", json!(64)),
        ("render_height", json!(36)),
        ("fps", json!(24)),
        ("seconds", json!(2.0)),
        ("is_cycle", json!(true)),
        ("smoothness_value", json!(0.0)),
    ] {
        assert_eq!(json[key], value, "{key}");
    }
    let key = &json["keyframes"][1];
    assert_eq!(key["aspect"], 64.0 / 36.0);
    assert!((key["fov"].as_f64().unwrap() - 45.0).abs() < 1e-9);
    let properties: Value = serde_json::from_str(key["properties"].as_str().unwrap()).unwrap();
    assert_eq!(properties[1], json!(["NAME", "Camera 1"]));
    // Row by row, y up and z backward, in the capture's coordinates.
    let pose = path.keyframes[1].camera_to_world;
    let centre = CAPTURE.to_capture(pose.w_axis.truncate());
    let number = |i: usize| key["matrix"][i].as_f64().unwrap();
    for (found, wanted) in [
        (number(3), centre.x),
        (number(7), centre.y),
        (number(11), centre.z),
        (number(0), pose.x_axis.x),
        (number(1), -pose.y_axis.x),
        (number(10), -pose.z_axis.z),
        (number(15), 1.0),
    ] {
        assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
    }
    // The keyframes alone, as a viewer that makes the frames itself would read them.
    let mut keys = json;
    keys["camera_path"] = json!([]);
    let slow = CameraPath {
        even_speed: false,
        ..path
    };
    let own = read(&keys.to_string());
    for (a, b) in own.iter().zip(slow.cameras().unwrap()) {
        assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-9));
    }
}

/// Keyframes along a line, at these places.
fn line(places: &[f64], closed: bool) -> CameraPath {
    let key = |&x: &f64| Keyframe {
        camera_to_world: DMat4::from_translation(DVec3::new(x, 0.0, 0.0)),
        fov: 50.0,
    };
    CameraPath {
        keyframes: places.iter().map(key).collect(),
        seconds: 4.0,
        fps: 10.0,
        closed,
        size: (32, 18),
        even_speed: true,
    }
}

#[test]
fn an_even_path_takes_equal_steps() {
    let steps = |path: &CameraPath| -> Vec<f64> {
        let cameras = path.cameras().unwrap();
        let step = |two: &[Camera]| two[0].centre().distance(two[1].centre());
        cameras.windows(2).map(step).collect()
    };
    let path = line(&[0.0, 0.1, 1.0, 1.2, 2.0], false);
    let even = steps(&path);
    for step in &even {
        assert!((step - 2.0 / 39.0).abs() < 1e-3, "{step}");
    }
    let uneven = steps(&CameraPath {
        even_speed: false,
        ..path.clone()
    });
    assert!(uneven.iter().any(|step| (step - 2.0 / 39.0).abs() > 1e-2));
    let cameras = path.cameras().unwrap();
    assert!(cameras[0].centre().length() < 1e-12);
    assert!((cameras[39].centre().x - 2.0).abs() < 1e-9);
}

#[test]
fn a_closed_path_comes_back_without_doubling_a_frame() {
    for even_speed in [true, false] {
        let path = CameraPath {
            even_speed,
            ..walk(6, true)
        };
        let cameras = path.cameras().unwrap();
        let step = |a: &Camera, b: &Camera| a.centre().distance(b.centre());
        let last = step(&cameras[47], &cameras[0]);
        let mean = cameras
            .windows(2)
            .map(|two| step(&two[0], &two[1]))
            .sum::<f64>()
            / 47.0;
        assert!((0.5..1.5).contains(&(last / mean)), "{last} {mean}");
        assert!(
            cameras[0]
                .camera_to_world
                .abs_diff_eq(path.keyframes[0].camera_to_world, 1e-9)
        );
    }
}

#[test]
fn turning_and_zooming_take_their_time_too() {
    let mut path = line(&[0.0, 0.0, 0.0], false);
    let turn = DQuat::from_rotation_y(1.0);
    path.keyframes[1].camera_to_world = DMat4::from_quat(turn);
    path.keyframes[2].camera_to_world = DMat4::from_quat(turn);
    path.keyframes[2].fov = 10.0;
    let cameras = path.cameras().unwrap();
    let halfway = cameras[19];
    assert!(halfway.forward().angle_between(DVec3::Z) > 0.9);
    let zoomed = cameras[39].intrinsics.fl_y / cameras[0].intrinsics.fl_y;
    assert!((zoomed.ln() - (25f64.to_radians().tan() / 5f64.to_radians().tan()).ln()).abs() < 1e-9);
    // Nothing moves at all.
    let still = line(&[0.3; 4], false).cameras().unwrap();
    let place = still[0].camera_to_world;
    assert!(
        still
            .iter()
            .all(|camera| camera.camera_to_world.abs_diff_eq(place, 1e-12))
    );
    assert_eq!(still.len(), 40);
}

#[test]
fn impossible_paths_are_refused_by_keyframe() {
    let refused = |change: fn(&mut CameraPath)| {
        let mut path = walk(4, false);
        change(&mut path);
        let error = path.cameras().expect_err("must be refused");
        assert_eq!(
            path.to_nerfstudio(&CAPTURE).unwrap_err().to_string(),
            error.to_string()
        );
        error
    };
    let says = |change: fn(&mut CameraPath), parts: &[&str]| {
        let message = refused(change).to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    says(|path| path.keyframes.clear(), &["no keyframes"]);
    says(
        |path| path.keyframes[2].fov = 180.0,
        &["keyframe 2", "180", "1 to 170"],
    );
    says(
        |path| path.keyframes[1].fov = f64::NAN,
        &["keyframe 1", "NaN"],
    );
    says(
        |path| path.keyframes[3].camera_to_world.x_axis *= 2.0,
        &["keyframe 3", "not a rotation"],
    );
    says(
        |path| path.keyframes[0].camera_to_world.w_axis.x = f64::INFINITY,
        &["keyframe 0", "infinite"],
    );
    says(|path| path.seconds = -1.0, &["-1 second", "above 0"]);
    says(|path| path.fps = f64::NAN, &["NaN frames", "above 0"]);
    assert!(matches!(
        refused(|path| path.seconds = 1e9),
        PathError::TooLarge { .. }
    ));
    assert!(matches!(
        refused(|path| path.seconds = 1e-9),
        PathError::Empty { .. }
    ));
    assert!(matches!(
        refused(|path| path.size = (0, 9)),
        PathError::Empty { .. }
    ));
    assert!(matches!(
        refused(|path| path.size = (u32::MAX, 9999)),
        PathError::TooLarge { .. }
    ));
}

#[test]
fn the_studios_form_is_read_and_written() {
    let text = r#"{"keyframes": [{"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0.5,0.25,-1,1], "fov": 50.0}],
        "seconds": 4.0, "fps": 24, "closed": false, "size": [640, 360]}"#;
    let path: CameraPath = serde_json::from_str(text).unwrap();
    assert_eq!(
        path.cameras().unwrap()[95].centre(),
        DVec3::new(0.5, 0.25, -1.0)
    );
    assert!(path.even_speed);
    let again = serde_json::to_string(&path).unwrap();
    assert_eq!(serde_json::from_str::<CameraPath>(&again).unwrap(), path);
    for wrong in [
        text.replace("0.5,0.25,", "0.25,"),
        text.replace("\"size\"", "\"sise\""),
        text.replace("[640, 360]", "[-640, 360]"),
    ] {
        assert!(
            serde_json::from_str::<CameraPath>(&wrong).is_err(),
            "{wrong}"
        );
    }
}
