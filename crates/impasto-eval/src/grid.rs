//! Values on the pixels of a picture.

use image::RgbImage;

/// One value for each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height × width`, row by row.
    pub values: Vec<T>,
}

/// The four pixels around a place between pixel indices, first the upper two from left to right, and
/// how far across and down it lies between them; beyond the border that of the border.
pub(crate) fn around(x: f32, y: f32, [width, height]: [usize; 2]) -> ([usize; 4], [f32; 2]) {
    let x = x.clamp(0.0, (width - 1) as f32);
    let y = y.clamp(0.0, (height - 1) as f32);
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let corners = [(left, top), (right, top), (left, bottom), (right, bottom)];
    let corners = corners.map(|(x, y)| y * width + x);
    (corners, [x - left as f32, y - top as f32])
}

impl Grid<f32> {
    /// Brightness of a picture in `[0, 1]` (Rec. 601).
    pub(crate) fn brightness(image: &RgbImage) -> Self {
        let luma = image.pixels().map(|pixel| {
            let [r, g, b] = pixel.0.map(f32::from);
            (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
        });
        Self {
            width: image.width() as usize,
            height: image.height() as usize,
            values: luma.collect(),
        }
    }

    /// The value between pixel indices, bilinear; beyond the border the border's.
    pub(crate) fn at(&self, x: f32, y: f32) -> f32 {
        let (corners, [across, down]) = around(x, y, [self.width, self.height]);
        let [upper_left, upper_right, lower_left, lower_right] = corners.map(|i| self.values[i]);
        let upper = upper_left + across * (upper_right - upper_left);
        let lower = lower_left + across * (lower_right - lower_left);
        upper + down * (lower - upper)
    }

    /// Means of 2×2 pixels.
    pub(crate) fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let values = (0..width * height).map(|i| {
            let (x, y) = ((i % width * 2) as f32, (i / width * 2) as f32);
            self.at(x + 0.5, y + 0.5)
        });
        Self {
            width,
            height,
            values: values.collect(),
        }
    }
}
