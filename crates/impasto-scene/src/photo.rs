//! Reading and shrinking photos.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageReader, RgbImage};

use crate::error::{SceneError, read_bytes};

/// Reads an image file as 8-bit RGB, exactly as stored: no colour management, no EXIF rotation
/// (poses belong to the stored pixels). Grey is spread over the channels, transparency is blended
/// on white (in stored values, as Blender's data sets expect), 16 bits become 8.
///
/// # Errors
/// A file that cannot be read or decoded, and a JPEG that ends before its end marker (decoders
/// fill the rest of such a picture with grey).
pub fn read_rgb(path: &Path) -> Result<RgbImage, SceneError> {
    let bytes = read_bytes(path)?;
    let refuse = |problem: String| SceneError::Photo {
        path: path.to_owned(),
        problem,
    };
    if bytes.is_empty() {
        return Err(refuse("the file is empty".into()));
    }
    if bytes.starts_with(&[0xFF, 0xD8]) && !jpeg_is_complete(&bytes) {
        return Err(refuse("the JPEG is cut off before its end".into()));
    }
    let decoded = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(|e| refuse(e.to_string()))?
        .decode()
        .map_err(|e| refuse(e.to_string()))?;
    Ok(on_white(decoded))
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

fn on_white(decoded: DynamicImage) -> RgbImage {
    if !decoded.color().has_alpha() {
        return decoded.into_rgb8();
    }
    let rgba = decoded.into_rgba8();
    let mut rgb = RgbImage::new(rgba.width(), rgba.height());
    for (to, from) in rgb.pixels_mut().zip(rgba.pixels()) {
        let alpha = u32::from(from[3]);
        for channel in 0..3 {
            let blended = u32::from(from[channel]) * alpha + 255 * (255 - alpha);
            // Rounded; at most 255, so the cast keeps the value.
            to[channel] = ((blended + 127) / 255) as u8;
        }
    }
    rgb
}

/// The size of a `width × height` photo shrunk `k` times, at least one pixel.
pub(crate) fn downscaled_size(width: u32, height: u32, k: u32) -> (u32, u32) {
    let shrink = |side: u32| ((f64::from(side) / f64::from(k)).round() as u32).max(1);
    (shrink(width), shrink(height))
}

/// Shrinks a photo `k ≥ 1` times to `round(width / k) × round(height / k)` pixels.
///
/// Each new pixel is the mean of exactly the area that it covers, in stored values: no aliasing,
/// no ringing, and no blur beyond the pixel that a rendered ray stands for.
pub fn downscale(photo: &RgbImage, k: u32) -> RgbImage {
    let (width, height) = downscaled_size(photo.width(), photo.height(), k.max(1));
    if (width, height) == photo.dimensions() {
        return photo.clone();
    }
    let columns = coverage(photo.width(), width);
    let rows = coverage(photo.height(), height);
    let (stride, out_stride) = (photo.width() as usize * 3, width as usize * 3);
    let mut narrow = vec![0.0f32; out_stride * photo.height() as usize];
    for (to, from) in narrow
        .chunks_exact_mut(out_stride)
        .zip(photo.as_raw().chunks_exact(stride))
    {
        for (pixel, (first, weights)) in to.chunks_exact_mut(3).zip(&columns) {
            for (weight, source) in weights.iter().zip(from[first * 3..].chunks_exact(3)) {
                for (sum, &value) in pixel.iter_mut().zip(source) {
                    *sum += weight * f32::from(value);
                }
            }
        }
    }
    let mut small = RgbImage::new(width, height);
    let mut line = vec![0.0f32; out_stride];
    for (to, (first, weights)) in small.chunks_exact_mut(out_stride).zip(&rows) {
        line.fill(0.0);
        for (weight, from) in weights
            .iter()
            .zip(narrow[first * out_stride..].chunks_exact(out_stride))
        {
            for (sum, value) in line.iter_mut().zip(from) {
                *sum += weight * value;
            }
        }
        for (byte, value) in to.iter_mut().zip(&line) {
            *byte = value.round() as u8;
        }
    }
    small
}

/// For each of `to` equal parts of a line of `from ≥ to` pixels: the first pixel it touches and
/// the share that each touched pixel has in it. Shares sum to 1.
fn coverage(from: u32, to: u32) -> Vec<(usize, Vec<f32>)> {
    let step = f64::from(from) / f64::from(to);
    (0..to)
        .map(|i| {
            let (start, end) = (f64::from(i) * step, f64::from(i + 1) * step);
            let first = start.floor() as u32;
            let last = (end.ceil() as u32).min(from);
            let weights = (first..last)
                .map(|p| {
                    let covered = end.min(f64::from(p) + 1.0) - start.max(f64::from(p));
                    (covered.max(0.0) / step) as f32
                })
                .collect();
            (first as usize, weights)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use image::{ImageFormat, Rgb, Rgba, RgbaImage};

    use super::*;

    #[test]
    fn a_whole_factor_averages_blocks() {
        let photo = RgbImage::from_fn(4, 2, |x, y| Rgb([(x * 40 + y * 20) as u8, 7, 255]));
        let small = downscale(&photo, 2);
        assert_eq!(small.dimensions(), (2, 1));
        assert_eq!(small.get_pixel(0, 0), &Rgb([30, 7, 255]));
        assert_eq!(small.get_pixel(1, 0), &Rgb([110, 7, 255]));
    }

    #[test]
    fn any_factor_keeps_flat_colours_and_the_mean() {
        let flat = RgbImage::from_pixel(103, 57, Rgb([3, 128, 250]));
        let small = downscale(&flat, 4);
        assert_eq!(small.dimensions(), (26, 14));
        assert!(small.pixels().all(|p| p == &Rgb([3, 128, 250])));
        let stripes = RgbImage::from_fn(99, 99, |x, _| Rgb([if x % 2 == 0 { 0 } else { 200 }; 3]));
        let mean = |image: &RgbImage| {
            image.pixels().map(|p| f64::from(p[0])).sum::<f64>()
                / f64::from(image.width() * image.height())
        };
        assert!((mean(&stripes) - mean(&downscale(&stripes, 5))).abs() < 1.0);
    }

    #[test]
    fn shrinking_to_nothing_stops_at_one_pixel() {
        let photo = RgbImage::from_pixel(3, 2, Rgb([9, 9, 9]));
        assert_eq!(downscale(&photo, 100).dimensions(), (1, 1));
    }

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
}
