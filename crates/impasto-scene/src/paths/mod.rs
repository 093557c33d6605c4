//! Camera paths: lists of cameras to render a film or a set of views from.
//!
//! Paths are made from the cameras of a capture's train photos, in scene space, so that they work
//! from a saved model as well. The paths of the photos themselves are
//! [`Scene::cameras`](crate::Scene::cameras).

mod camera_path;
mod keyframes;
mod orbit;
pub(crate) mod shape;
mod spiral;
mod spline;

pub use camera_path::{CameraPath, Keyframe};
pub use keyframes::{KeyframeOptions, frame_rate, keyframes};
pub use orbit::orbit;
pub use spiral::spiral;

use crate::camera::{Camera, Distortion, Intrinsics};

/// Why a camera path could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// No frames, or frames without pixels, were asked for.
    #[error("a camera path needs at least one frame and one pixel, not {frames} frame(s) of {}×{}", size.0, size.1)]
    Empty {
        /// Frames asked for.
        frames: usize,
        /// Width and height asked for.
        size: (u32, u32),
    },
    /// More frames, or larger ones, than anyone renders.
    #[error(
        "a camera path of {frames} frame(s) of {}×{} is too large; the most is {MOST_FRAMES} frames \
         of {} megapixels",
        size.0, size.1, MOST_PIXELS / 1_000_000
    )]
    TooLarge {
        /// Frames asked for.
        frames: usize,
        /// Width and height asked for.
        size: (u32, u32),
    },
    /// Too few cameras to fit a path to.
    #[error("a path needs at least {needed} camera(s) to be fitted to, and there are {given}")]
    TooFewCameras {
        /// The least number.
        needed: usize,
        /// The number given.
        given: usize,
    },
    /// A path without time.
    #[error(
        "{seconds} second(s) at {fps} frames a second make no camera path; both must be numbers above 0"
    )]
    Time {
        /// How long it takes.
        seconds: f64,
        /// Frames a second.
        fps: f64,
    },
    /// The file is not JSON, or not of a known form.
    #[error("{0}")]
    Unreadable(String),
    /// One frame or keyframe of a file is wrong.
    #[error("{kind} {index}: {problem}")]
    Frame {
        /// "frame" or "keyframe".
        kind: &'static str,
        /// Its number, from 0.
        index: usize,
        /// What is wrong with it.
        problem: String,
    },
}

/// Most frames of a path: an hour of film. A file may ask for any number of seconds.
const MOST_FRAMES: usize = 100_000;
/// Most pixels of a frame, as of a photo.
const MOST_PIXELS: u64 = 200_000_000;

/// Refuses paths without frames or pixels, and such with absurdly many.
fn check_request(frames: usize, size: (u32, u32)) -> Result<(), PathError> {
    if frames == 0 || size.0 == 0 || size.1 == 0 {
        return Err(PathError::Empty { frames, size });
    }
    if frames > MOST_FRAMES || u64::from(size.0) * u64::from(size.1) > MOST_PIXELS {
        return Err(PathError::TooLarge { frames, size });
    }
    Ok(())
}

/// An ideal pinhole with square pixels whose picture of `size` pixels shows no more, across or
/// down, than the median photo did: rendering wider shows what was never photographed.
fn median_lens(cameras: &[Camera], size: (u32, u32)) -> Intrinsics {
    let median = |of: fn(&Intrinsics) -> f64| {
        let mut values: Vec<f64> = cameras.iter().map(|c| of(&c.intrinsics)).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(1.0)
    };
    let across = median(|k| k.fl_x / f64::from(k.width)) * f64::from(size.0);
    let down = median(|k| k.fl_y / f64::from(k.height)) * f64::from(size.1);
    pinhole(across.max(down), size)
}

/// An ideal pinhole with a vertical field of view in degrees, between 0 and 180.
pub(crate) fn of_fov(fov: f64, size: (u32, u32)) -> Intrinsics {
    pinhole(
        0.5 * f64::from(size.1) / (0.5 * fov.to_radians()).tan(),
        size,
    )
}

fn pinhole(focal: f64, (width, height): (u32, u32)) -> Intrinsics {
    Intrinsics {
        width,
        height,
        fl_x: focal,
        fl_y: focal,
        cx: 0.5 * f64::from(width),
        cy: 0.5 * f64::from(height),
        distortion: Distortion::default(),
    }
}
