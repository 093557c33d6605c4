//! What the fuzz targets share: captures of which one file is the fuzzer's, and what must hold of
//! whatever is read from them.

mod capture;
#[allow(
    dead_code,
    reason = "the sources are another crate's, which uses all of them"
)]
mod weights;

pub use capture::{Capture, Kind, files, scratch};
pub use weights::checkpoint::Checkpoint;
pub use weights::tensors::{TensorFile, write_f16};

use std::io;
use std::path::PathBuf;

use glam::DMat4;
use impasto_scene::{Camera, Scene};

/// What [`weights`] says of `crate::StyleError`: the part of impasto-style's that it uses.
#[derive(Debug, thiserror::Error)]
pub enum StyleError {
    /// A weight file does not have the expected content.
    #[error("weight file {file}: {reason}")]
    Weights {
        /// Which file.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A weight file cannot be read.
    #[error("{}: cannot be read ({source})", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

/// A message is one line that says something.
pub fn check_message(error: &impl std::fmt::Display) {
    let message = error.to_string();
    assert!(!message.trim().is_empty(), "an error without a message");
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
    for photo in &scene.photos {
        check_camera(&photo.camera);
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
