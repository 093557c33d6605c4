//! Pictures side by side.

use image::{Rgb, RgbImage, imageops};

/// Between the pictures of a grid and around them, in pixels.
pub const GAP: u32 = 4;
/// The colour between the pictures.
pub const GROUND: Rgb<u8> = Rgb([24, 24, 26]);

/// Lays pictures out row by row, in cells of the largest one's size.
pub fn grid(pictures: &[RgbImage], columns: usize) -> RgbImage {
    let cell = |side: fn(&RgbImage) -> u32| pictures.iter().map(side).max().unwrap_or(0);
    let (width, height) = (cell(RgbImage::width), cell(RgbImage::height));
    let columns = columns.max(1);
    let rows = pictures.len().div_ceil(columns) as u32;
    let across = columns.min(pictures.len()) as u32;
    let whole = (GAP + across * (width + GAP), GAP + rows * (height + GAP));
    let mut grid = RgbImage::from_pixel(whole.0, whole.1, GROUND);
    for (i, picture) in pictures.iter().enumerate() {
        let (column, row) = ((i % columns) as u32, (i / columns) as u32);
        let x = GAP + column * (width + GAP) + (width - picture.width()) / 2;
        let y = GAP + row * (height + GAP) + (height - picture.height()) / 2;
        imageops::replace(&mut grid, picture, i64::from(x), i64::from(y));
    }
    grid
}

/// Columns that make a grid of equal pictures about as wide as high.
pub fn square_columns(count: usize, picture: &RgbImage) -> usize {
    let shape = f64::from(picture.height()) / f64::from(picture.width().max(1));
    ((count as f64 * shape).sqrt().round() as usize).clamp(1, count.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_the_middle_of_their_cells() {
        let white = |w, h| RgbImage::from_pixel(w, h, Rgb([255; 3]));
        let sheet = grid(&[white(10, 6), white(4, 6), white(10, 6)], 2);
        assert_eq!(sheet.dimensions(), (3 * GAP + 20, 3 * GAP + 12));
        let at = |x, y| sheet.get_pixel(x, y).0[0] == 255;
        assert!(at(GAP, GAP) && at(2 * GAP + 13, GAP) && at(GAP, 2 * GAP + 6));
        assert!(!at(2 * GAP + 12, GAP) && !at(2 * GAP + 13, 2 * GAP + 6));
    }

    #[test]
    fn a_grid_of_wide_pictures_has_fewer_columns() {
        assert_eq!(square_columns(16, &RgbImage::new(4, 1)), 2);
        assert_eq!(square_columns(9, &RgbImage::new(5, 5)), 3);
        assert_eq!(square_columns(1, &RgbImage::new(1, 9)), 1);
    }
}
