//! The photos: found, checked, and taken over into the capture.

mod check;
mod exif;
mod groups;
mod list;
mod place;
mod take;

pub(crate) use groups::{CameraGroup, groups};
pub(crate) use list::list;
pub(crate) use take::{few, take, too_few};

use std::path::PathBuf;

use serde::Serialize;

/// Fewer photos than this cannot be placed reliably.
pub(crate) const LEAST: usize = 3;
/// A file that could be a photo.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PhotoSource {
    /// Path below the folder, with `/` between its parts.
    pub(crate) name: String,
    /// Where the file is.
    pub(crate) path: PathBuf,
}

/// A file that was not taken.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Path below the folder.
    pub file: String,
    /// Why.
    pub reason: String,
}

/// A photo of the capture.
#[derive(Debug, Clone)]
pub(crate) struct Taken {
    /// Its name in the capture.
    pub(crate) name: String,
    /// Width and height, upright.
    pub(crate) size: (u32, u32),
    /// Camera and lens as EXIF tells, empty where it does not.
    pub(crate) lens: String,
    /// Whether it was turned.
    pub(crate) turned: bool,
}
