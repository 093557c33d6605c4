//! Pictures, films and folders of frames, written as a whole or not at all; where several processes
//! share a folder, file by file.

mod atomic;
mod film;
mod frame;
pub mod grid;
pub mod job;
mod layout;
pub mod lettering;
mod numbered;
mod picture;
mod shared;
mod sheet;
mod staging;
mod target;
mod zip;

pub use atomic::put;
pub use film::{FfmpegProgram, FilmFormat, Gif};
pub use frame::{RenderedFrame, Sink, Viewpoint};
pub use layout::FrameLayout;
pub use numbered::cameras;
pub use picture::write_png;
pub use shared::{SharedFolder, SharedFrames};
pub use staging::{Staging, check_folder, parent, write_file};
pub use target::{Target, TargetOptions};
