//! All views on one picture.

use std::path::{Path, PathBuf};

use image::RgbImage;

use super::frame::{RenderedFrame, Sink};
use super::grid;
use super::picture::write_png;
use crate::cli::CliError;

/// A contact sheet: views in reading order, or, with several variants, one row per view and one
/// column per variant. A single picture is written as it is.
pub struct Sheet {
    path: PathBuf,
    pictures: Vec<RgbImage>,
    variants: usize,
}

impl Sheet {
    /// Begins a sheet.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            pictures: Vec::new(),
            variants: 1,
        }
    }

    fn composed(&self) -> RgbImage {
        match self.pictures.as_slice() {
            [only] => only.clone(),
            [] => grid::grid(&[], 1),
            [first, ..] if self.variants == 1 => grid::grid(
                &self.pictures,
                grid::square_columns(self.pictures.len(), first),
            ),
            _ => grid::grid(&self.pictures, self.variants),
        }
    }
}

impl Sink for Sheet {
    fn add(&mut self, frame: RenderedFrame<'_>) -> Result<(), CliError> {
        self.variants = frame.pictures.len();
        self.pictures.extend(frame.pictures);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        write_png(&self.path, &self.composed())?;
        Ok(vec![self.path])
    }
}
