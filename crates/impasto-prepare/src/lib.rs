//! Raw photos or a video in; a capture with camera poses out.
//!
//! The poses are computed by the installed COLMAP, frames of a video are taken out by the
//! installed ffmpeg. [`prepare()`] chooses their options, follows their output, understands how they
//! fail and checks what they made. Nothing is undistorted: photos stay as they were taken.

mod batches;
mod child;
mod colmap;
mod error;
mod event;
mod folder;
mod listing;
mod log;
mod options;
mod photos;
mod prepare;
mod summary;
mod video;

pub use error::PrepareError;
pub use event::{Phase, PrepareEvent};
pub use options::{Cameras, Matching, PrepareOptions};
pub use photos::LeftOut;
pub use prepare::prepare;
pub use summary::{LensGroup, PhotoCounts, PrepareSummary, Seconds, VideoFrames};
