//! Pictures without what colour and contrast say.

use crate::grid::Grid;
use crate::resize::scaled;
use image::RgbImage;
use image::imageops::FilterType;

/// Mean and standard deviation of the normal distribution that all luminances get.
const MIDDLE: f64 = 0.5;
const SPREAD: f64 = 0.22;
/// Steps of the table of its distribution function, over this many deviations to either side.
const STEPS: usize = 4096;
const REACH: f64 = 4.0;

impl Grid<f32> {
    /// Brightness of a picture whose shorter side is resampled to `side` pixels.
    pub fn resampled(picture: &RgbImage, side: u32) -> Self {
        let (width, height) = picture.dimensions();
        let scale = f64::from(side) / f64::from(width.min(height));
        Self::brightness(&scaled(picture, scale, FilterType::Triangle))
    }

    /// The same picture with the one histogram that all get: normal, 0.5 ± 0.22, cut to `[0, 1]`.
    /// Ranks decide; equal values stay equal, at their mean rank.
    #[must_use]
    pub fn rank_matched(&self) -> Self {
        let mut order: Vec<usize> = (0..self.values.len()).collect();
        order.sort_by(|a, b| self.values[*a].total_cmp(&self.values[*b]));
        let quantiles = NormalQuantiles::new();
        let mut values = vec![0.0; order.len()];
        let mut start = 0;
        for equal in order.chunk_by(|a, b| self.values[*a] == self.values[*b]) {
            let rank = start as f64 + equal.len() as f64 / 2.0;
            let matched = MIDDLE + SPREAD * quantiles.at(rank / order.len() as f64);
            equal
                .iter()
                .for_each(|i| values[*i] = matched.clamp(0.0, 1.0) as f32);
            start += equal.len();
        }
        Self { values, ..*self }
    }

    /// A rectangle of it.
    pub(super) fn crop(&self, [left, top]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let rows = (top..top + height).map(|y| &self.values[y * self.width + left..][..width]);
        Self {
            values: rows.flatten().copied().collect(),
            width,
            height,
        }
    }

    /// As a picture for a network, `height × width × 3`.
    pub fn rgb(&self) -> Vec<f32> {
        self.values.iter().flat_map(|v| [*v; 3]).collect()
    }
}

/// The inverse of the normal distribution function.
struct NormalQuantiles(Vec<f64>);

impl NormalQuantiles {
    fn new() -> Self {
        let place = |i: usize| REACH * (2.0 * i as f64 / STEPS as f64 - 1.0);
        let mut sum = 0.0;
        let density = (0..STEPS).map(|i| {
            let middle = place(i) + REACH / STEPS as f64;
            (-0.5 * middle * middle).exp()
        });
        let mut below = vec![0.0];
        below.extend(density.map(|d| {
            sum += d;
            sum
        }));
        below.iter_mut().for_each(|b| *b /= sum);
        Self(below)
    }

    /// Where a share, 0 to 1, lies below.
    fn at(&self, share: f64) -> f64 {
        let after = self.0.partition_point(|b| *b < share).clamp(1, STEPS);
        let (low, high) = (self.0[after - 1], self.0[after]);
        let part = ((share - low) / (high - low)).clamp(0.0, 1.0);
        REACH * (2.0 * ((after - 1) as f64 + part) / STEPS as f64 - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_the_normal_distributions() {
        let quantiles = NormalQuantiles::new();
        for (share, wanted) in [
            (0.5, 0.0),
            (0.841_344_7, 1.0),
            (0.022_750_1, -2.0),
            (0.0, -REACH),
            (1.0, REACH),
        ] {
            assert!((quantiles.at(share) - wanted).abs() < 2e-3, "{share}");
        }
    }

    #[test]
    fn colour_contrast_and_curves_leave_no_trace() {
        let values: Vec<f32> = (0..40 * 30)
            .map(|i| (i * 37 % 101) as f32 / 200.0)
            .collect();
        let picture = Grid {
            width: 40,
            height: 30,
            values,
        };
        let matched = picture.rank_matched();
        let curved = Grid {
            values: picture.values.iter().map(|v| 0.3 + v * v).collect(),
            ..picture
        };
        assert_eq!(curved.rank_matched(), matched);
        let count = matched.values.len() as f32;
        let mean = matched.values.iter().sum::<f32>() / count;
        let square = matched
            .values
            .iter()
            .map(|v| (v - mean).powi(2))
            .sum::<f32>()
            / count;
        assert!((mean - 0.5).abs() < 5e-3 && (square.sqrt() - 0.22).abs() < 5e-3);
        let flat = Grid {
            values: vec![0.9; 12],
            width: 4,
            height: 3,
        };
        let matched = flat.rank_matched().values;
        assert!(
            matched.iter().all(|v| (v - 0.5).abs() < 1e-3),
            "{matched:?}"
        );
    }
}
