//! Pixels as numbers, and as pictures.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, ImageResult, RgbImage};

use crate::cli::CliError;

/// Writes a PNG.
pub fn save_png(picture: &RgbImage, path: &Path) -> Result<(), CliError> {
    picture
        .save_with_format(path, ImageFormat::Png)
        .map_err(CliError::encode(path))
}

/// The bytes of the PNG that [`save_png`] writes.
pub fn png(picture: &RgbImage) -> ImageResult<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}
