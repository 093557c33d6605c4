//! Between pictures and the images of convolutions, for methods whose networks halve three times.

use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage};
use impasto_kernels::FeatureMap;

/// Sides that every encoder halves without a rest.
const MULTIPLE: u32 = 8;
/// Shorter side that paintings are looked at with.
const PAINTING_SIDE: u32 = 256;

/// A painting at the size it is looked at.
pub(super) fn reduced(painting: &RgbImage) -> RgbImage {
    let (width, height) = painting.dimensions();
    let scale = f64::from(PAINTING_SIDE) / f64::from(width.min(height).max(1));
    let side = |length: u32| ((f64::from(length) * scale) as u32).max(PAINTING_SIDE);
    resize(painting, side(width), side(height), FilterType::Triangle)
}

/// A picture whose sides are multiples of eight, its last row and column repeated.
pub(super) fn enlarged(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let side = |length: u32| length.next_multiple_of(MULTIPLE).max(2 * MULTIPLE);
    RgbImage::from_fn(side(width), side(height), |x, y| {
        *picture.get_pixel(x.min(width - 1), y.min(height - 1))
    })
}

/// A picture's numbers in `[0, 1]` as an image of three channels.
pub(super) fn map_of(picture: &RgbImage) -> FeatureMap {
    FeatureMap {
        height: picture.height() as usize,
        width: picture.width() as usize,
        channels: 3,
        data: impasto_style::picture(picture),
    }
}

/// The picture of an image of three channels; what lies outside `[0, 1]` is cut off.
pub(super) fn picture_of(map: &FeatureMap) -> RgbImage {
    RgbImage::from_fn(map.width as u32, map.height as u32, |x, y| {
        let at = 3 * (y as usize * map.width + x as usize);
        Rgb([0, 1, 2].map(|c| (255.0 * map.data[at + c]).round() as u8))
    })
}
