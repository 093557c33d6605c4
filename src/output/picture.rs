//! Pictures as PNG.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, ImageResult, RgbImage};

use super::staging::write_file;
use crate::cli::CliError;

/// Writes a PNG, and makes the folders above it where missing.
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), CliError> {
    write_file(path, png(picture).map_err(CliError::encode(path))?)
}

/// The bytes of a PNG.
pub fn png(picture: &RgbImage) -> ImageResult<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}
