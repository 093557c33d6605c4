//! Between pictures and the images of convolutions, for methods whose networks halve three times.

use image::imageops::{FilterType, crop_imm, resize};
use image::{Rgb, RgbImage};
use impasto_kernels::FeatureMap;

/// Sides that every encoder halves without a rest.
const MULTIPLE: u32 = 8;
/// Shorter side at which paintings are encoded.
const PAINTING_SIDE: u32 = 256;

/// A painting at the size at which it is encoded.
pub(super) fn reduced(painting: &RgbImage) -> RgbImage {
    let (width, height) = painting.dimensions();
    let scale = f64::from(PAINTING_SIDE) / f64::from(width.min(height).max(1));
    let side = |length: u32| ((f64::from(length) * scale) as u32).max(PAINTING_SIDE);
    resize(painting, side(width), side(height), FilterType::Triangle)
}

/// What `repaint` makes of a picture, cut to its size. It is given the picture with sides that are
/// multiples of eight, the last row and column repeated.
pub(super) fn padded(picture: &RgbImage, repaint: impl Fn(RgbImage) -> RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let side = |length: u32| length.next_multiple_of(MULTIPLE).max(2 * MULTIPLE);
    let large = RgbImage::from_fn(side(width), side(height), |x, y| {
        *picture.get_pixel(x.min(width - 1), y.min(height - 1))
    });
    crop_imm(&repaint(large), 0, 0, width, height).to_image()
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
