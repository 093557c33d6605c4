//! Pictures as floats.

use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};

/// An image's numbers, `height × width × 3` in `[0, 1]`.
pub fn picture(image: &RgbImage) -> Vec<f32> {
    image
        .as_raw()
        .iter()
        .map(|v| f32::from(*v) / 255.0)
        .collect()
}

/// A square part of an image with side `part` (of its shorter side, in `(0, 1]`), placed at
/// `across` and `down` of what room is left (½ being the middle), resampled to `side` pixels.
pub fn square_crop(image: &RgbImage, part: f32, (across, down): (f32, f32), side: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    let edge = ((width.min(height) as f32 * part).round() as u32).clamp(1, width.min(height));
    let place = |room: u32, at: f32| ((room as f32 * at).round() as u32).min(room);
    let (x, y) = (place(width - edge, across), place(height - edge, down));
    resize(
        &crop_imm(image, x, y, edge, edge).to_image(),
        side,
        side,
        FilterType::Triangle,
    )
}
