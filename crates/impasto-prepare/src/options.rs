//! What can be chosen.

use std::path::PathBuf;

/// Which photos are compared with which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Matching {
    /// Exhaustive for up to 80 photos and for larger unordered sets, else sequential.
    Auto,
    /// Every photo with every other.
    Exhaustive,
    /// Every photo with its neighbours in the order of names.
    Sequential,
}

/// How photos share cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cameras {
    /// Photos of one size, and of one lens where EXIF names it, share a camera.
    Auto,
    /// All photos share one camera.
    One,
    /// Every photo has its own camera.
    Many,
}

/// A job for [`crate::prepare()`].
#[derive(Debug, Clone)]
pub struct PrepareOptions {
    /// A folder of photos, with sub-folders or without, or a video.
    pub input: PathBuf,
    /// The folder that the capture will be in.
    pub scene: PathBuf,
    /// How many frames to choose from a video, at least 3.
    pub frames: usize,
    /// Which photos are compared.
    pub matching: Matching,
    /// How photos share cameras.
    pub cameras: Cameras,
    /// COLMAP's program: a path, or a name to look for as the system does.
    pub colmap: PathBuf,
    /// ffmpeg's program, likewise; used for videos only.
    pub ffmpeg: PathBuf,
}
