//! What is asked of a camera path, and why it may be refused.

use glam::DMat4;

use crate::camera::Camera;
use crate::pose;

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
pub(super) fn check_request(frames: usize, size: (u32, u32)) -> Result<(), PathError> {
    if frames == 0 || size.0 == 0 || size.1 == 0 {
        return Err(PathError::Empty { frames, size });
    }
    if frames > MOST_FRAMES || u64::from(size.0) * u64::from(size.1) > MOST_PIXELS {
        return Err(PathError::TooLarge { frames, size });
    }
    Ok(())
}

/// [`check_request`] of a path that is fitted to `cameras`.
pub(super) fn check_fit(
    cameras: &[Camera],
    frames: usize,
    size: (u32, u32),
) -> Result<(), PathError> {
    check_request(frames, size)?;
    if cameras.is_empty() {
        return Err(PathError::no_cameras());
    }
    Ok(())
}

impl PathError {
    /// There is nothing to fit a path to.
    pub(super) fn no_cameras() -> Self {
        Self::TooFewCameras {
            needed: 1,
            given: 0,
        }
    }
}

/// The cameras of a file's frames, each made by `camera`, whose error is what is wrong with one.
pub(super) fn cameras_of<T>(
    kind: &'static str,
    frames: &[T],
    camera: impl Fn(&T) -> Result<Camera, String>,
) -> Result<Vec<Camera>, PathError> {
    let frames = frames.iter().enumerate();
    let cameras = frames.map(|(index, frame)| {
        camera(frame).map_err(|problem| PathError::Frame {
            kind,
            index,
            problem,
        })
    });
    cameras.collect()
}

/// The pose of a frame as an exactly rigid transform, or what is wrong with it.
pub(super) fn rigid(pose: DMat4) -> Result<DMat4, String> {
    pose::rigid(pose).map_err(|problem| format!("its pose {problem}"))
}
