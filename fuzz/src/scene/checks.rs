//! What must hold of whatever was read.

use glam::DMat4;
use impasto_scene::{Camera, Scene};

/// A message says something.
pub fn check_message(error: &impl std::fmt::Display) {
    assert!(
        !error.to_string().trim().is_empty(),
        "an error without a message"
    );
}

/// What everything downstream relies on of a camera: finite numbers, a rotation, a focal length and
/// pixels.
pub fn check_camera(camera: &Camera) {
    let lens = &camera.intrinsics;
    let numbers = [lens.fl_x, lens.fl_y, lens.cx, lens.cy];
    assert!(numbers.iter().all(|x| x.is_finite()), "{lens:?}");
    assert!(lens.fl_x > 0.0 && lens.fl_y > 0.0, "{lens:?}");
    assert!(lens.width > 0 && lens.height > 0, "{lens:?}");
    check_pose(&camera.camera_to_world);
}

fn check_pose(pose: &DMat4) {
    assert!(pose.is_finite(), "{pose:?}");
    for axis in [pose.x_axis, pose.y_axis, pose.z_axis] {
        assert!((axis.truncate().length() - 1.0).abs() < 1e-2, "{pose:?}");
    }
}

/// What training relies on of a capture.
pub fn check_scene(scene: &Scene) {
    assert!(scene.photos.len() >= 2);
    assert!(scene.normalisation.scale > 0.0, "{:?}", scene.normalisation);
    for photo in &scene.photos {
        check_camera(&photo.camera);
        assert!(photo.camera.centre().length() <= 1.0, "{photo:?}");
        let lens = &photo.camera.intrinsics;
        assert_eq!((lens.width, lens.height), photo.pixels.dimensions());
    }
    for point in &scene.points {
        assert!(point.position.is_finite(), "{point:?}");
        for seen in &point.seen_by {
            assert!(seen.photo < scene.photos.len(), "{seen:?}");
        }
    }
}
