//! Pictures on their way to a page.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};

/// Bytes before the picture.
pub(crate) const HEAD: usize = 32;

/// How good a picture is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Level {
    Coarse,
    Sharp,
}

impl Level {
    fn code(self) -> u8 {
        match self {
            Self::Coarse => 0,
            Self::Sharp => 2,
        }
    }

    fn quality(self) -> u8 {
        match self {
            Self::Coarse => 85,
            Self::Sharp => 95,
        }
    }
}

/// What is said before a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Head {
    pub(crate) view: u32,
    pub(crate) coats: u32,
    /// First row and number of rows, in the view's pixels; they go all across.
    pub(crate) rows: (u32, u32),
    /// Width and height of the view.
    pub(crate) size: (u32, u32),
    pub(crate) level: Level,
    pub(crate) last: bool,
    pub(crate) milliseconds: u128,
    pub(crate) rays_per_second: f64,
}

/// A frame without its number, which [`number`] gives when it is sent.
pub(crate) fn encode(head: &Head, picture: &RgbImage) -> Result<Vec<u8>, String> {
    let short = |number: u32| u16::try_from(number).unwrap_or(u16::MAX).to_le_bytes();
    let milliseconds = u32::try_from(head.milliseconds).unwrap_or(u32::MAX);
    let mut bytes = Vec::with_capacity(HEAD + picture.as_raw().len() / 8);
    bytes.extend([0; 4]);
    bytes.extend(head.view.to_le_bytes());
    bytes.extend(head.coats.to_le_bytes());
    for number in [
        0,
        head.rows.0,
        head.size.0,
        head.rows.1,
        head.size.0,
        head.size.1,
    ] {
        bytes.extend(short(number));
    }
    bytes.extend([head.level.code(), u8::from(head.last)]);
    bytes.extend(short(milliseconds));
    // Saturates.
    bytes.extend((head.rays_per_second as u32).to_le_bytes());
    jpeg(picture, head.level.quality(), &mut bytes)?;
    Ok(bytes)
}

/// Writes the number of a frame.
pub(crate) fn number(frame: &mut [u8], number: u32) {
    if let Some(place) = frame.first_chunk_mut() {
        *place = number.to_le_bytes();
    }
}

/// Appends a picture as JPEG.
pub(crate) fn jpeg(picture: &RgbImage, quality: u8, to: &mut Vec<u8>) -> Result<(), String> {
    let (width, height) = picture.dimensions();
    JpegEncoder::new_with_quality(to, quality)
        .write_image(picture.as_raw(), width, height, ExtendedColorType::Rgb8)
        .map_err(|e| format!("a picture cannot be encoded ({e})"))
}

/// Colours in `[0, 1]` as a picture.
pub(crate) fn picture(colours: &[f32], width: u32, height: u32) -> RgbImage {
    let bytes = colours.iter().map(|c| (c * 255.0).round() as u8).collect();
    // As many as there are pixels: a painter's contract.
    RgbImage::from_raw(width, height, bytes).unwrap_or_else(|| RgbImage::new(width, height))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn the_head_is_laid_out_as_documented() {
        let head = Head {
            view: 5,
            coats: 6,
            rows: (16, 8),
            size: (640, 360),
            level: Level::Sharp,
            last: true,
            milliseconds: 70_000,
            rays_per_second: 250_000.4,
        };
        let grey = picture(&[0.5; 4 * 8 * 3], 4, 8);
        let mut frame = encode(&head, &grey).unwrap();
        number(&mut frame, 9);
        let long = |at: usize| u32::from_le_bytes(frame[at..at + 4].try_into().unwrap());
        let short = |at: usize| u16::from_le_bytes(frame[at..at + 2].try_into().unwrap());
        assert_eq!([long(0), long(4), long(8)], [9, 5, 6]);
        let places: Vec<u16> = (12..24).step_by(2).map(short).collect();
        assert_eq!(places, [0, 16, 640, 8, 640, 360]);
        assert_eq!((frame[24], frame[25], short(26)), (2, 1, u16::MAX));
        assert_eq!(long(28), 250_000);
        let read = image::load_from_memory(&frame[HEAD..]).unwrap().into_rgb8();
        assert_eq!(read.dimensions(), (4, 8));
        assert!(read.get_pixel(2, 3)[1].abs_diff(128) < 3);
    }
}
