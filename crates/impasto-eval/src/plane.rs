//! Brightness of a picture.

use image::RgbImage;

/// Brightness in `[0, 1]` (Rec. 601).
#[derive(Debug, Clone)]
pub(crate) struct Plane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Row by row.
    pub(crate) values: Vec<f32>,
}

impl Plane {
    pub(crate) fn of(image: &RgbImage) -> Self {
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
        let x = x.clamp(0.0, (self.width - 1) as f32);
        let y = y.clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = (
            (left + 1).min(self.width - 1),
            (top + 1).min(self.height - 1),
        );
        let (across, down) = (x - left as f32, y - top as f32);
        let value = |x: usize, y: usize| self.values[y * self.width + x];
        let upper = value(left, top) + across * (value(right, top) - value(left, top));
        let lower = value(left, bottom) + across * (value(right, bottom) - value(left, bottom));
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
