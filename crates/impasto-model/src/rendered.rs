//! Rendered views.

use image::RgbImage;

/// One rendered view.
#[derive(Debug, Clone)]
pub struct RenderedView {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Per appearance, `height × width × 3` in `[0, 1]`.
    pub pixels: Vec<Vec<f32>>,
    /// `height × width`, depth along the camera's axis in scene units.
    pub depth: Vec<f32>,
}

impl RenderedView {
    /// The view on a grid `side` times as coarse: colours are means; a depth is the lower median,
    /// so that it is one that was there and not between a thing and what is behind it.
    pub(crate) fn reduced(self, side: usize) -> Self {
        if side == 1 {
            return self;
        }
        let (width, height) = (self.width / side, self.height / side);
        // The index of every pixel's rays in turn.
        let rays = |pixel: usize| {
            let (top, left) = (pixel / width * side, pixel % width * side);
            (0..side * side).map(move |i| (top + i / side) * self.width + left + i % side)
        };
        let pixels = self.pixels.iter().map(|large| {
            let mean = |pixel: usize| {
                [0, 1, 2].map(|c| {
                    let sum: f32 = rays(pixel).map(|ray| large[3 * ray + c]).sum();
                    sum / (side * side) as f32
                })
            };
            (0..width * height).flat_map(mean).collect()
        });
        let depth = |pixel: usize| {
            let mut depths: Vec<f32> = rays(pixel).map(|ray| self.depth[ray]).collect();
            depths.sort_by(f32::total_cmp);
            depths[(depths.len() - 1) / 2]
        };
        Self {
            pixels: pixels.collect(),
            depth: (0..width * height).map(depth).collect(),
            width,
            height,
        }
    }

    /// One appearance as 8-bit pixels.
    pub fn image(&self, appearance: usize) -> RgbImage {
        let bytes = self.pixels[appearance]
            .iter()
            .map(|v| (v * 255.0).round() as u8)
            .collect();
        RgbImage::from_raw(self.width as u32, self.height as u32, bytes).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_view_has_mean_colours_and_depths_that_were_there() {
        let view = RenderedView {
            width: 4,
            height: 2,
            pixels: vec![(0..24).map(|i| i as f32).collect()],
            depth: vec![1.0, 9.0, 5.0, 6.0, 2.0, 8.0, 7.0, 5.5],
        };
        let found = view.clone().reduced(2);
        assert_eq!((found.width, found.height), (2, 1));
        // Rays 0, 1, 4 and 5: their first channels are 0, 3, 12 and 15.
        assert_eq!(found.pixels[0], [7.5, 8.5, 9.5, 13.5, 14.5, 15.5]);
        assert_eq!(found.depth, [2.0, 5.5]);
        assert_eq!(view.clone().reduced(1).pixels, view.pixels);
    }
}
