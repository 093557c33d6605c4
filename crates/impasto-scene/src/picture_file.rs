//! Picture files as pixels: every photo, painting and mask is read here.

use std::io::{Cursor, ErrorKind};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits, RgbImage};

use crate::error::SceneError;
use crate::file::read_whole;

/// Endings that a picture file may have, in lower case.
pub const PICTURE_ENDINGS: [&str; 7] = ["jpg", "jpeg", "png", "webp", "tif", "tiff", "gif"];
/// Most pixels of a picture: what the largest sensors take. More is a panorama, which no camera
/// model here fits.
const MOST_PIXELS: u64 = 200_000_000;
/// Most bytes of its pixels once decoded: 16-bit RGBA.
const MOST_DECODED: u64 = 8 * MOST_PIXELS;
/// Most bytes of its file: uncompressed 16-bit RGB, and as much again for what stands beside it.
const MOST_BYTES: u64 = 2 << 30;
/// What a decoder may allocate beside the pixels before it is told how many there are.
const ROOM: u64 = 64 << 20;
/// From here on, pictures are decoded one at a time, however many cores there are.
const LARGE: u64 = 40_000_000;

static LARGE_ONE: Mutex<()> = Mutex::new(());

/// Whether a file's ending is that of a picture.
pub fn is_picture(path: &Path) -> bool {
    path.extension().is_some_and(|ending| {
        PICTURE_ENDINGS
            .iter()
            .any(|known| ending.eq_ignore_ascii_case(known))
    })
}

/// Reads a picture as 8-bit RGB, upright: turned as its EXIF orientation says. Grey is spread over
/// the channels, CMYK converted, transparency blended on white (in stored values, as Blender's data
/// sets expect), 16 bits become 8; colour profiles are not applied. Of an animation it is the first
/// frame.
///
/// # Errors
/// A file that is no regular file, cannot be read or decoded, or is larger than 2 GiB or 200
/// megapixels, and a JPEG that ends before its end marker (decoders fill the rest of such a picture
/// with grey).
pub fn read_rgb(path: &Path) -> Result<RgbImage, SceneError> {
    Ok(Decoded::read(path)?.upright())
}

/// [`read_rgb`] of a file's bytes, of at most `most_pixels` pixels: for pictures that strangers send.
///
/// # Errors
/// As [`read_rgb`], the reason alone.
pub fn decode_rgb(bytes: &[u8], most_pixels: u64) -> Result<RgbImage, String> {
    let (width, height) = decoder(bytes)?.dimensions();
    if u64::from(width) * u64::from(height) > most_pixels {
        return Err(format!(
            "it is {width}×{height} pixels, more than the {} megapixels that are taken; shrink it \
             first",
            most_pixels / 1_000_000
        ));
    }
    Ok(Decoded::of(bytes)?.upright())
}

/// Width and height as stored, from the header.
pub(crate) fn stored_size(path: &Path) -> Result<(u32, u32), SceneError> {
    let bytes = bytes_of(path)?;
    let decoder = decoder(&bytes).map_err(refusal(path))?;
    Ok(decoder.dimensions())
}

/// A picture as stored.
pub(crate) struct Decoded {
    pub(crate) pixels: DynamicImage,
    /// What its EXIF data says is to be done to see it upright.
    pub(crate) turn: Orientation,
    /// Held until the pixels of a large picture are let go.
    pub(crate) alone: Option<MutexGuard<'static, ()>>,
}

impl Decoded {
    pub(crate) fn read(path: &Path) -> Result<Self, SceneError> {
        let bytes = bytes_of(path)?;
        Self::of(&bytes).map_err(refusal(path))
    }

    fn of(bytes: &[u8]) -> Result<Self, String> {
        if bytes.starts_with(&[0xFF, 0xD8]) && !jpeg_is_complete(bytes) {
            return Err("the JPEG is cut off before its end".into());
        }
        let mut decoder = decoder(bytes)?;
        // Damaged EXIF data says nothing.
        let turn = decoder.orientation().unwrap_or(Orientation::NoTransforms);
        let (width, height) = decoder.dimensions();
        let pixels = u64::from(width) * u64::from(height);
        let alone =
            (pixels >= LARGE).then(|| LARGE_ONE.lock().unwrap_or_else(PoisonError::into_inner));
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(2 * decoder.total_bytes() + ROOM);
        decoder.set_limits(limits).map_err(|e| problem(&e))?;
        Ok(Self {
            pixels: DynamicImage::from_decoder(decoder).map_err(|e| problem(&e))?,
            turn,
            alone,
        })
    }

    /// The picture as 8-bit RGB, turned as its EXIF data says.
    fn upright(mut self) -> RgbImage {
        self.pixels.apply_orientation(self.turn);
        on_white(self.pixels)
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_whole(path, MOST_BYTES).map_err(SceneError::io(path))
}

fn refusal(path: &Path) -> impl FnOnce(String) -> SceneError {
    let path = path.to_owned();
    |problem| SceneError::Photo { path, problem }
}

/// A decoder that has read the header and found a size that may be decoded.
fn decoder(bytes: &[u8]) -> Result<impl ImageDecoder + '_, String> {
    if bytes.is_empty() {
        return Err("the file is empty".into());
    }
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| e.to_string())?;
    use ImageFormat::{Gif, Jpeg, Png, Tiff, WebP};
    if !matches!(reader.format(), Some(Jpeg | Png | WebP | Tiff | Gif)) {
        return Err(unknown_content(bytes));
    }
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(ROOM);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| problem(&e))?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err("it has no pixels".into());
    }
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MOST_PIXELS || decoder.total_bytes() > MOST_DECODED {
        return Err(format!(
            "it is {width}×{height} pixels, more than the {} megapixels that are read; shrink it \
             first",
            MOST_PIXELS / 1_000_000
        ));
    }
    Ok(decoder)
}

/// What a file is that no decoder knows.
fn unknown_content(bytes: &[u8]) -> String {
    let brand = bytes.get(4..12).unwrap_or_default();
    let converted = match brand {
        b"ftypheic" | b"ftypheix" | b"ftypmif1" => Some("HEIC"),
        b"ftypavif" => Some("AVIF"),
        _ => None,
    };
    match converted {
        Some(name) => format!("it is a {name} picture, which is not supported; convert it to JPEG"),
        None => "its content is no JPEG, PNG, WebP, TIFF or GIF".into(),
    }
}

fn problem(error: &ImageError) -> String {
    match error {
        ImageError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => {
            "the file is cut off".into()
        }
        ImageError::Limits(_) => "it needs far more memory than its pixels do".into(),
        other => other.to_string(),
    }
}

/// Whether the end-of-image marker is reached by walking the segments, so that the end marker of
/// an embedded thumbnail does not count.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let mut at = 2;
    loop {
        while bytes.get(at).is_some_and(|&b| b != 0xFF) {
            at += 1;
        }
        while bytes.get(at) == Some(&0xFF) {
            at += 1;
        }
        match bytes.get(at) {
            None => return false,
            Some(0xD9) => return true,
            // A stuffed zero, TEM and the restart markers have no length.
            Some(0x00 | 0x01 | 0xD0..=0xD7) => at += 1,
            Some(_) => {
                let (Some(&high), Some(&low)) = (bytes.get(at + 1), bytes.get(at + 2)) else {
                    return false;
                };
                at += 1 + usize::from(u16::from_be_bytes([high, low]));
            }
        }
    }
}

/// 8-bit RGB, transparency blended on white.
pub(crate) fn on_white(decoded: DynamicImage) -> RgbImage {
    if !decoded.color().has_alpha() {
        return decoded.into_rgb8();
    }
    let rgba = decoded.into_rgba8();
    let mut rgb = RgbImage::new(rgba.width(), rgba.height());
    for (to, from) in rgb.pixels_mut().zip(rgba.pixels()) {
        let [r, g, b, alpha] = from.0;
        to.0 = [r, g, b].map(|channel| faded(channel, alpha));
    }
    rgb
}

/// A channel of which white shows through.
pub(crate) fn faded(channel: u8, alpha: u8) -> u8 {
    let alpha = u32::from(alpha);
    let blended = u32::from(channel) * alpha + 255 * (255 - alpha);
    // Rounded; at most 255, so the cast keeps the value.
    ((blended + 127) / 255) as u8
}

#[cfg(test)]
mod tests {
    use image::{Rgb, Rgba, RgbaImage};

    use super::*;

    #[test]
    fn transparency_is_blended_on_white_and_grey_spread() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let half = RgbaImage::from_pixel(2, 2, Rgba([255, 0, 100, 51]));
        half.save(&path).unwrap();
        assert_eq!(
            read_rgb(&path).unwrap().get_pixel(1, 1),
            &Rgb([255, 204, 224])
        );
        image::GrayImage::from_pixel(2, 2, image::Luma([77]))
            .save(&path)
            .unwrap();
        assert_eq!(read_rgb(&path).unwrap().get_pixel(0, 1), &Rgb([77, 77, 77]));
    }

    #[test]
    fn cut_photos_are_refused_at_every_length_and_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let noise = RgbImage::from_fn(40, 30, |x, y| {
            Rgb([(x * 31 + y * 57) as u8, (x * y) as u8, (y * 91) as u8])
        });
        for (name, format) in [
            ("cut.jpg", ImageFormat::Jpeg),
            ("cut.png", ImageFormat::Png),
        ] {
            let mut bytes = Vec::new();
            noise
                .write_to(&mut Cursor::new(&mut bytes), format)
                .unwrap();
            let path = dir.path().join(name);
            std::fs::write(&path, &bytes).unwrap();
            read_rgb(&path).unwrap();
            // The last chunk of a PNG holds no pixels, so it may be missing.
            let needed = bytes.len() - if name == "cut.png" { 17 } else { 1 };
            for length in (0..needed).step_by(41).chain([needed]) {
                std::fs::write(&path, &bytes[..length]).unwrap();
                let message = read_rgb(&path).expect_err("cut").to_string();
                assert!(message.contains(name), "{length}: {message}");
            }
        }
    }

    #[test]
    fn the_end_marker_of_a_thumbnail_does_not_count() {
        let with_thumbnail = [0xFF, 0xD8, 0xFF, 0xE1, 0x00, 0x06, 0xFF, 0xD8, 0xFF, 0xD9];
        assert!(!jpeg_is_complete(&with_thumbnail));
        assert!(jpeg_is_complete(
            &[&with_thumbnail[..], &[0xFF, 0xD9]].concat()
        ));
    }

    #[test]
    fn bytes_are_decoded_up_to_a_size() {
        let mut bytes = Vec::new();
        let grey = RgbImage::from_pixel(40, 30, Rgb([9, 8, 7]));
        grey.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
            .unwrap();
        assert_eq!(decode_rgb(&bytes, 1200).unwrap(), grey);
        assert!(decode_rgb(&bytes, 1199).unwrap_err().contains("40×30"));
        assert!(decode_rgb(b"<svg/>", 1200).unwrap_err().contains("no JPEG"));
        assert!(decode_rgb(&[], 1200).unwrap_err().contains("empty"));
        assert!(decode_rgb(&bytes[..60], 1200).is_err());
    }

    #[test]
    fn endings_are_known_in_any_case() {
        for name in ["a.JPG", "b.tiff", "c.WebP", "d.gif", "e.f.png"] {
            assert!(is_picture(Path::new(name)), "{name}");
        }
        for name in ["a", "png", "a.txt", "a.png.txt", "a.heic"] {
            assert!(!is_picture(Path::new(name)), "{name}");
        }
    }
}
