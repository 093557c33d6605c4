//! Pictures as floats.

use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};
use rand::RngExt;
use rand_pcg::Pcg64;

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

/// Turns hues, and changes saturation, contrast and brightness, by random amounts.
pub fn recolour(image: &mut RgbImage, rng: &mut Pcg64) {
    let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
    let saturation = rng.random_range(0.4f32..1.5);
    let contrast = rng.random_range(0.7f32..1.3);
    let shift = rng.random_range(-25.0f32..25.0);
    for pixel in image.pixels_mut() {
        let [r, g, b] = pixel.0.map(f32::from);
        // Luma and two opponent colours (YIQ), in which a hue is an angle.
        let luma = 0.299 * r + 0.587 * g + 0.114 * b;
        let i = 0.596 * r - 0.274 * g - 0.322 * b;
        let q = 0.211 * r - 0.523 * g + 0.312 * b;
        let (i, q) = (
            saturation * (cos * i - sin * q),
            saturation * (sin * i + cos * q),
        );
        let luma = (luma - 128.0) * contrast + 128.0 + shift;
        let rgb = [
            luma + 0.956 * i + 0.621 * q,
            luma - 0.272 * i - 0.647 * q,
            luma - 1.106 * i + 1.703 * q,
        ];
        // A float's cast to a byte saturates.
        pixel.0 = rgb.map(|c| c.round() as u8);
    }
}
