//! How much detail a picture has: a guard, because blur agrees with itself.

use image::RgbImage;

/// Mean squared difference of brightness (Rec. 601, in `[0, 1]`) between neighbouring pixels,
/// across and down; zero for a flat picture.
pub fn gradient_energy(image: &RgbImage) -> f64 {
    let luma = |x: u32, y: u32| {
        let [r, g, b] = image.get_pixel(x, y).0.map(f64::from);
        (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
    };
    let (width, height) = image.dimensions();
    let (mut sum, mut count) = (0.0, 0u64);
    for y in 0..height {
        for x in 0..width {
            let here = luma(x, y);
            let right = (x + 1 < width).then(|| luma(x + 1, y));
            let below = (y + 1 < height).then(|| luma(x, y + 1));
            for there in [right, below].into_iter().flatten() {
                sum += (there - here).powi(2);
                count += 1;
            }
        }
    }
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;
    use image::imageops::blur;

    #[test]
    fn flat_pictures_have_none_and_blurred_ones_less() {
        let flat = RgbImage::from_pixel(9, 7, Rgb([90, 30, 200]));
        assert_eq!(gradient_energy(&flat), 0.0);
        let stripes = RgbImage::from_fn(8, 8, |x, _| Rgb([if x % 2 == 0 { 0 } else { 255 }; 3]));
        // All differences across are 1, all down are 0.
        assert!((gradient_energy(&stripes) - 0.5).abs() < 1e-9);
        assert!(gradient_energy(&blur(&stripes, 1.5)) < 0.1);
        assert_eq!(gradient_energy(&RgbImage::new(1, 1)), 0.0);
    }
}
