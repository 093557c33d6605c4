//! Sizes of pictures.

use image::RgbImage;
use image::imageops::{FilterType, resize};

/// A picture whose sides are `scale` times as long, see [`scaled_size`].
pub(crate) fn scaled(picture: &RgbImage, scale: f64, filter: FilterType) -> RgbImage {
    let [width, height] = scaled_size(picture.dimensions().into(), scale);
    resize(picture, width, height, filter)
}

/// The same, but a picture that would be enlarged stays as it is.
pub(crate) fn reduced(picture: &RgbImage, scale: f64, filter: FilterType) -> RgbImage {
    if scale >= 1.0 {
        return picture.clone();
    }
    scaled(picture, scale, filter)
}

/// Width and height in pixels, `scale` times as long and at least one each.
pub(crate) fn scaled_size(size: [u32; 2], scale: f64) -> [u32; 2] {
    size.map(|side| ((f64::from(side) * scale).round() as u32).max(1))
}
