//! Camera paths: the file's own number of frames, and another.
#![no_main]

use std::sync::LazyLock;

use glam::{DMat4, DVec3};
use impasto_fuzz::{check_camera, check_message};
use impasto_scene::paths::{KeyframeOptions, keyframes};
use impasto_scene::{Camera, Distortion, Intrinsics, Normalisation};
use libfuzzer_sys::fuzz_target;

static CAMERA: LazyLock<Camera> = LazyLock::new(|| Camera {
    intrinsics: Intrinsics {
        width: 8,
        height: 6,
        fl_x: 7.0,
        fl_y: 7.0,
        cx: 4.0,
        cy: 3.0,
        distortion: Distortion::default(),
    },
    camera_to_world: DMat4::IDENTITY,
});

static NORMALISATION: LazyLock<Normalisation> = LazyLock::new(|| {
    Normalisation::of_cameras(&[DVec3::ZERO, DVec3::X, DVec3::Y]).expect("three places")
});

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    for (frames, size) in [(None, None), (Some(7), Some((16, 12)))] {
        let options = KeyframeOptions {
            cameras: std::slice::from_ref(&*CAMERA),
            normalisation: &NORMALISATION,
            frames,
            size,
        };
        match keyframes(text, &options) {
            Ok(cameras) => cameras.iter().for_each(check_camera),
            Err(error) => check_message(&error),
        }
    }
});
