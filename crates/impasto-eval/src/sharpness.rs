//! How much detail a picture has: a guard, because blur agrees with itself.

use crate::grid::Grid;
use image::RgbImage;

/// Mean squared difference of brightness (in `[0, 1]`) between neighbouring pixels,
/// across and down; zero for a flat picture.
pub fn gradient_energy(image: &RgbImage) -> f64 {
    let plane = Grid::brightness(image);
    let (mut sum, mut count) = (0.0, 0u64);
    for (y, row) in plane.values.chunks_exact(plane.width.max(1)).enumerate() {
        let below = plane.values[y * plane.width..].iter().skip(plane.width);
        let across = row.iter().zip(&row[1..]);
        for (here, there) in across.chain(row.iter().zip(below)) {
            sum += f64::from(there - here).powi(2);
            count += 1;
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
        assert!((gradient_energy(&stripes) - 0.5).abs() < 1e-6);
        assert!(gradient_energy(&blur(&stripes, 1.5)) < 0.1);
        assert_eq!(gradient_energy(&RgbImage::new(1, 1)), 0.0);
    }
}
