//! Statistics of pictures as patches are compared with them.

use image::RgbImage;
use image::imageops::crop_imm;
use impasto_style::{Perceptual, Statistics, StyleError, picture};

/// Mean statistics of windows of `height × width` pixels that cover the picture.
pub(crate) fn window_statistics(
    vgg: &Perceptual,
    square: &RgbImage,
    patch: [usize; 2],
) -> Result<Statistics, StyleError> {
    let side = square.width() as usize;
    let [height, width] = patch.map(|p| p.clamp(1, side));
    let starts = |size: usize| {
        let count = side.div_ceil(size);
        (0..count).map(move |i| (side - size) * i / (count - 1).max(1))
    };
    let mut sum = vec![0.0; Statistics::LEN];
    let mut windows = 0.0;
    for top in starts(height) {
        for left in starts(width) {
            let size = (width as u32, height as u32);
            let window = crop_imm(square, left as u32, top as u32, size.0, size.1).to_image();
            let statistics = vgg.features(&picture(&window), height, width)?.statistics;
            sum.iter_mut().zip(&statistics.0).for_each(|(s, x)| *s += x);
            windows += 1.0;
        }
    }
    sum.iter_mut().for_each(|s| *s /= windows);
    Ok(Statistics(sum))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use impasto_model::{STYLE_SIDE, square_statistics};
    use impasto_paintings::{Recipe, paint};

    #[test]
    fn window_statistics_are_the_mean_over_windows_that_cover_the_picture() {
        let vgg = Perceptual::vgg16().unwrap();
        let square = paint(&Recipe::random(7), STYLE_SIDE, STYLE_SIDE);
        let side = STYLE_SIDE as usize;
        let whole = window_statistics(&vgg, &square, [side, 4 * side]).unwrap();
        assert_eq!(whole, square_statistics(&vgg, &square).unwrap());

        // 100 of 160 rows: two windows, from rows 0 and 60.
        let found = window_statistics(&vgg, &square, [100, side]).unwrap();
        let window = |top| {
            let part = crop_imm(&square, 0, top, STYLE_SIDE, 100).to_image();
            vgg.features(&picture(&part), 100, side).unwrap().statistics
        };
        let wanted = window(0).mixed(&window(60), 0.5);
        assert!(found.distance(&wanted) < 1e-9);
        assert!(
            found.distance(&whole) > 1e-6,
            "windows differ from the whole"
        );
    }
}
