//! Rendered views, and what takes them.

use std::path::PathBuf;

use image::RgbImage;
use impasto::scene::Camera;

use crate::cli::CliError;

/// A viewpoint to render.
#[derive(Debug, Clone)]
pub struct Viewpoint {
    /// The camera, in scene space.
    pub camera: Camera,
    /// The photo's name, where this is a photo's viewpoint.
    pub photo: Option<String>,
}

/// One rendered view.
pub struct RenderedFrame<'a> {
    /// From where.
    pub view: &'a Viewpoint,
    /// One picture per variant.
    pub pictures: Vec<RgbImage>,
    /// Depth along the camera's axis, scene units, row by row.
    pub depth: &'a [f32],
}

/// Takes frames and leaves nothing behind unless it is finished.
pub trait Sink {
    /// Takes the next frame.
    fn add(&mut self, frame: RenderedFrame<'_>) -> Result<(), CliError>;

    /// Completes the output and names the files or folders that hold it.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, CliError>;
}
