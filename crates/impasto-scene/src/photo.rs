//! Shrinking photos.

use image::RgbImage;

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

/// Whether two sizes are of one shape, within 1 %.
pub(crate) fn same_shape(a: (u32, u32), b: (u32, u32)) -> bool {
    let stretch = |from: u32, to: u32| f64::from(to) / f64::from(from);
    (stretch(a.0, b.0) / stretch(a.1, b.1) - 1.0).abs() <= 0.01
}

/// [`downscale`] that keeps what need not shrink.
pub(crate) fn downscaled(photo: RgbImage, k: u32) -> RgbImage {
    if k <= 1 {
        return photo;
    }
    downscale(&photo, k)
}

/// Whether all pixels that a pixel of the smaller grid covers are set; grids as width and height,
/// values row by row.
pub(crate) fn all_of(values: &[bool], from: (u32, u32), to: (u32, u32)) -> Vec<bool> {
    let (columns, rows) = (coverage(from.0, to.0), coverage(from.1, to.1));
    let stride = from.0 as usize;
    let mut small = Vec::with_capacity(rows.len() * columns.len());
    for (top, heights) in &rows {
        for (left, widths) in &columns {
            let mut lines = values.chunks_exact(stride).skip(*top).take(heights.len());
            small.push(lines.all(|line| line[*left..left + widths.len()].iter().all(|v| *v)));
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
    use image::Rgb;

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
}
