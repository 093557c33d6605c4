//! Pixels as numbers, and as pictures.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, ImageResult, RgbImage};

use crate::cli::CliError;

/// Moves `styled` towards `photo`: `strength` 1 leaves it, 0 makes it the photo.
pub fn blend(photo: &[f32], styled: &mut [f32], strength: f32) {
    for (styled, photo) in styled.iter_mut().zip(photo) {
        *styled = photo + strength * (*styled - photo);
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strength_goes_from_photo_to_style() {
        let at = |strength| {
            let mut styled = [1.0, 0.0];
            blend(&[0.5, 0.5], &mut styled, strength);
            styled
        };
        assert_eq!(
            (at(0.0), at(0.5), at(1.0)),
            ([0.5, 0.5], [0.75, 0.25], [1.0, 0.0])
        );
    }
}
