//! How sharp a picture is.

use image::RgbImage;
use impasto_scene::downscale;

/// Width at which pictures are compared: finer detail is noise and compression.
const WIDTH: u32 = 640;

/// Variance of the Laplacian of the grey picture at about 640 pixels of width. Blur lowers it, but
/// so does a plain wall: compare only pictures of nearly the same view.
pub(super) fn of(picture: &RgbImage) -> f64 {
    let small = downscale(picture, (picture.width() + WIDTH / 2) / WIDTH);
    let (width, height) = (small.width() as usize, small.height() as usize);
    if width < 3 || height < 3 {
        return 0.0;
    }
    let grey: Vec<f64> = small
        .pixels()
        .map(|p| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]))
        .collect();
    let (mut sum, mut squares) = (0.0, 0.0);
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let at = y * width + x;
            let around = grey[at - 1] + grey[at + 1] + grey[at - width] + grey[at + width];
            let laplacian = around - 4.0 * grey[at];
            sum += laplacian;
            squares += laplacian * laplacian;
        }
    }
    let count = ((width - 2) * (height - 2)) as f64;
    squares / count - (sum / count).powi(2)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn blur_lowers_it() {
        let sharp = RgbImage::from_fn(700, 90, |x, y| Rgb([((x / 7 + y / 5) % 2 * 200) as u8; 3]));
        let blurred = image::imageops::blur(&sharp, 2.0);
        assert!(of(&sharp) > 3.0 * of(&blurred));
        assert!(of(&RgbImage::from_pixel(9, 9, Rgb([7; 3]))).abs() < 1e-9);
    }
}
