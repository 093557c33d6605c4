//! Mean and deviation of every channel of an image, forward and backward.

use super::padded::Padded;
use rayon::prelude::*;

/// Added to the variance under the root (PAPER §5).
const VARIANCE_EPS: f64 = 1e-5;

/// Mean and `sqrt(unbiased variance + 1e-5)` of each channel.
#[derive(Debug)]
pub(crate) struct ChannelStatistics {
    pub(crate) mean: Vec<f64>,
    pub(crate) std: Vec<f64>,
}

impl ChannelStatistics {
    pub(crate) fn of(image: &Padded) -> Self {
        let n = image.pixels() as f64;
        let mut mean = sum_of_pixels(image, |sum, pixel| {
            sum.iter_mut().zip(pixel).for_each(|(s, v)| *s += v);
        });
        mean.iter_mut().for_each(|m| *m /= n);
        let centre: Vec<f32> = mean.iter().map(|m| *m as f32).collect();
        let mut std = sum_of_pixels(image, |sum, pixel| {
            for ((s, m), v) in sum.iter_mut().zip(&centre).zip(pixel) {
                *s += (v - m) * (v - m);
            }
        });
        // One pixel has no unbiased variance; it counts as none.
        let freedom = (n - 1.0).max(1.0);
        std.iter_mut()
            .for_each(|s| *s = (*s / freedom + VARIANCE_EPS).sqrt());
        Self { mean, std }
    }

    /// Adds the gradient of both to `into`, where `grad` holds means first.
    pub(crate) fn backward(&self, image: &Padded, grad: &[f32], into: &mut Padded) {
        let channels = image.channels;
        let n = image.pixels() as f64;
        let freedom = (n - 1.0).max(1.0);
        let slope: Vec<f32> = (0..channels)
            .map(|c| (f64::from(grad[channels + c]) / (freedom * self.std[c])) as f32)
            .collect();
        let constant: Vec<f32> = (0..channels)
            .map(|c| (f64::from(grad[c]) / n - f64::from(slope[c]) * self.mean[c]) as f32)
            .collect();
        into.par_rows_mut().enumerate().for_each(|(y, into)| {
            let pixels = image.row(y).chunks_exact(channels);
            for (into, pixel) in into.chunks_exact_mut(channels).zip(pixels) {
                for c in 0..channels {
                    into[c] += constant[c] + slope[c] * pixel[c];
                }
            }
        });
    }
}

/// Per channel, what `add` sums up over all pixels: in single precision along a row, in double
/// precision over the rows.
fn sum_of_pixels(image: &Padded, add: impl Fn(&mut [f32], &[f32]) + Sync) -> Vec<f64> {
    let rows: Vec<Vec<f32>> = (0..image.height)
        .into_par_iter()
        .with_min_len(4)
        .map(|y| {
            let mut sum = vec![0.0; image.channels];
            for pixel in image.row(y).chunks_exact(image.channels) {
                add(&mut sum, pixel);
            }
            sum
        })
        .collect();
    let mut total = vec![0.0; image.channels];
    for row in rows {
        total
            .iter_mut()
            .zip(row)
            .for_each(|(t, r)| *t += f64::from(r));
    }
    total
}
