//! Whether frames of a walk agree with each other (PAPER §10; Lai et al. 2018).

use crate::flow::Correspondence;
use image::RgbImage;
use impasto_style::{Perceptual, StyleError};
use rayon::prelude::*;
use serde::Serialize;

/// Frames between the two of a short-range and of a long-range pair.
pub const RANGES: [usize; 2] = [1, 7];
/// A pair of which less can be compared is left out, and counted.
pub const LEAST_COVERAGE: f64 = 0.2;

/// How much two frames differ where both show the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairError {
    /// Mean over compared pixels and channels of the squared difference: E. Zero if there are none.
    pub square: f64,
    /// The same over all pixels that have a flow.
    pub square_all: f64,
    /// Share of pixels compared.
    pub coverage: f64,
}

/// E of two frames, `height × width × 3` in `[0, 1]`.
///
/// # Panics
/// If the frames do not have the correspondence's size.
pub fn pair_error(pair: &Correspondence, first: &[f32], second: &[f32]) -> PairError {
    let warped = pair.warped(second);
    assert_eq!(first.len(), warped.len(), "two frames of a pair");
    // Sum of squares and number of pixels, of those that count and of all with a flow.
    let (mut sums, mut counts) = ([0.0f64; 2], [0u32; 2]);
    let pixels = first.chunks_exact(3).zip(warped.chunks_exact(3));
    let known = pair.mask.iter().zip(&pair.flow.vectors);
    for ((a, b), (counts_too, vector)) in pixels.zip(known) {
        let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
        let square: f64 = squares.sum();
        for (i, used) in [*counts_too, vector.is_some()].into_iter().enumerate() {
            sums[i] += if used { square } else { 0.0 };
            counts[i] += u32::from(used);
        }
    }
    let mean = |i: usize| sums[i] / (3.0 * f64::from(counts[i].max(1)));
    PairError {
        square: mean(0),
        square_all: mean(1),
        coverage: pair.coverage(),
    }
}

/// Consistency over all pairs of one range; NaN (`null` in JSON) where no pair counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Consistency {
    /// Mean E × 100.
    pub e100: f64,
    /// Mean root of E.
    pub rmse: f64,
    /// The same over all pixels that have a flow, occluded or not, as later papers report it.
    pub rmse_all: f64,
    /// Mean squared difference of VGG features (relu4_1, unweighted: not LPIPS) of a frame and the
    /// warped other one, pixels that do not count being equal in both, over a few pairs; absent
    /// where it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vgg: Option<f64>,
    /// Mean share of pixels compared, of pairs that count.
    pub coverage: f64,
    /// Pairs that count.
    pub pairs: usize,
    /// Pairs left out because too little of them can be compared.
    pub dropped: usize,
}

impl Consistency {
    /// The mean over several walks along the same path.
    pub fn mean(all: &[Self]) -> Self {
        let mean = |get: fn(&Self) -> f64| all.iter().map(get).sum::<f64>() / all.len() as f64;
        let Some(first) = all.first() else {
            return Self::default();
        };
        Self {
            e100: mean(|c| c.e100),
            rmse: mean(|c| c.rmse),
            rmse_all: mean(|c| c.rmse_all),
            vgg: first.vgg.map(|_| mean(|c| c.vgg.unwrap_or_default())),
            ..*first
        }
    }
}

/// Pairs of a walk whose perceptual distance is measured: it costs hundreds of times what the
/// others do.
const PERCEPTUAL_PAIRS: usize = 4;

/// The pairs of a walk at one range.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// First and second frame, and how they correspond; only pairs that count.
    kept: Vec<([usize; 2], Correspondence)>,
    dropped: usize,
}

impl Pairs {
    /// Pairs `(t, t − range)` of `frames` frames, by what `correspond` says of two of them.
    pub fn new(
        frames: usize,
        range: usize,
        correspond: impl Fn(usize, usize) -> Correspondence + Sync,
    ) -> Self {
        let all: Vec<_> = (range..frames)
            .into_par_iter()
            .map(|t| ([t, t - range], correspond(t, t - range)))
            .collect();
        let count = all.len();
        let kept: Vec<_> = all
            .into_iter()
            .filter(|(_, pair)| pair.coverage() >= LEAST_COVERAGE)
            .collect();
        Self {
            dropped: count - kept.len(),
            kept,
        }
    }

    /// How frames `(t, t − range)` correspond, of pairs that count.
    pub(crate) fn links(&self) -> impl Iterator<Item = ([usize; 2], &Correspondence)> {
        self.kept.iter().map(|(frames, pair)| (*frames, pair))
    }

    /// Consistency of frames, with the perceptual distance if there is a network for it.
    ///
    /// # Errors
    /// If frames are too small for the network.
    ///
    /// # Panics
    /// If a frame is missing or has another size.
    pub fn consistency(
        &self,
        frames: &[RgbImage],
        vgg: Option<&Perceptual>,
    ) -> Result<Consistency, StyleError> {
        let every = self.kept.len().div_ceil(PERCEPTUAL_PAIRS).max(1);
        let errors = self
            .kept
            .par_iter()
            .enumerate()
            .map(|(i, ([first, second], pair))| {
                let vgg = vgg.filter(|_| i % every == 0);
                let [a, b] = [first, second].map(|i| impasto_style::picture(&frames[*i]));
                let error = pair_error(pair, &a, &b);
                let perceptual = vgg.map(|vgg| perceptual(pair, vgg, a, &b)).transpose()?;
                Ok((error, perceptual))
            })
            .collect::<Result<Vec<_>, StyleError>>()?;
        // Of no pair there is no mean, which is no agreement either.
        let n = errors.len() as f64;
        let mean = |get: fn(&PairError) -> f64| errors.iter().map(|(e, _)| get(e)).sum::<f64>() / n;
        let distances: Vec<f64> = errors.iter().filter_map(|(_, vgg)| *vgg).collect();
        Ok(Consistency {
            e100: 100.0 * mean(|e| e.square),
            rmse: mean(|e| e.square.sqrt()),
            rmse_all: mean(|e| e.square_all.sqrt()),
            vgg: vgg.map(|_| distances.iter().sum::<f64>() / distances.len() as f64),
            coverage: mean(|e| e.coverage),
            pairs: errors.len(),
            dropped: self.dropped,
        })
    }
}

/// Squared difference of features of a frame and of the other one warped onto it.
fn perceptual(
    pair: &Correspondence,
    vgg: &Perceptual,
    first: Vec<f32>,
    second: &[f32],
) -> Result<f64, StyleError> {
    let mut warped = pair.warped(second);
    for (i, mask) in pair.mask.iter().enumerate() {
        if !mask {
            warped[3 * i..3 * i + 3].copy_from_slice(&first[3 * i..3 * i + 3]);
        }
    }
    let size = (pair.flow.height, pair.flow.width);
    let [a, b] = [first, warped].map(|image| vgg.features(&image, size.0, size.1));
    let (a, b) = (a?.content, b?.content);
    let squares = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2));
    Ok(squares.sum::<f64>() / a.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::flow::Geometry;
    use crate::flow::tests::camera;
    use image::Rgb;

    const DEPTH: f32 = 2.0;

    /// Pairs of a sideways walk along a wall.
    fn pairs(frames: usize, range: usize, step: f64) -> Pairs {
        let depth = [DEPTH; 40 * 30];
        Pairs::new(frames, range, |a, b| {
            let cameras = [a, b].map(|i| camera(step * i as f64));
            let [first, second] = cameras.each_ref().map(|camera| Geometry {
                camera,
                depth: &depth,
            });
            Correspondence::exact(&first, &second)
        })
    }

    /// The wall, painted with a ramp, from along the walk; with noise of its own in each frame.
    fn frames(count: usize, step: f64, noise: u8) -> Vec<RgbImage> {
        let shade = |frame: usize, x: u32, y: u32| {
            let along = f64::from(x) + 20.0 * step * frame as f64;
            let random = (x * 31 + y * 17 + frame as u32 * 101).wrapping_mul(2_654_435_761) >> 24;
            let noise = f64::from(noise) * (f64::from(random) / 255.0 - 0.5);
            (40.0 + 2.0 * along + f64::from(y) + noise) as u8
        };
        let frame = |i| RgbImage::from_fn(40, 30, |x, y| Rgb([shade(i, x, y); 3]));
        (0..count).map(frame).collect()
    }

    #[test]
    fn a_painted_wall_agrees_with_itself_and_noise_does_not() {
        // One pixel of parallax a frame.
        let pairs = pairs(5, 1, 0.05);
        let e = |noise| pairs.consistency(&frames(5, 0.05, noise), None).unwrap();
        assert!(e(0).e100 < 1e-9, "{:?}", e(0));
        let noisy = [10, 20, 40, 80].map(|noise| e(noise).e100);
        assert!(
            noisy.is_sorted_by(|a, b| a < b) && noisy[0] > 0.0,
            "{noisy:?}"
        );
        assert!((e(40).rmse.powi(2) * 100.0 / noisy[2] - 1.0).abs() < 0.05);
        assert_eq!((e(0).pairs, e(0).dropped), (4, 0));
        assert!((e(0).coverage - 39.0 / 40.0).abs() < 1e-9);
    }

    #[test]
    fn pairs_that_share_too_little_are_dropped_and_counted() {
        // Seven frames apart, 35 of 40 columns have left the image.
        let pairs = pairs(9, 7, 0.25);
        let found = pairs.consistency(&frames(9, 0.25, 0), None).unwrap();
        assert_eq!((found.pairs, found.dropped), (0, 2));
        assert!(found.e100.is_nan(), "nothing compared is not agreement");
    }

    #[test]
    fn the_perceptual_distance_sees_what_is_compared_only() {
        let vgg = Perceptual::vgg16().unwrap();
        let pairs = pairs(2, 1, 0.05);
        let mut same = frames(2, 0.05, 0);
        let of = |frames: &[RgbImage]| {
            let found = pairs.consistency(frames, Some(&vgg)).unwrap();
            found.vgg.unwrap()
        };
        assert!(of(&same) < 1e-6);
        assert!(of(&frames(2, 0.05, 60)) > 1e-3);
        // The column that only the later frame shows, of a pair from the later to the earlier.
        (0..30).for_each(|y| same[1].put_pixel(39, y, Rgb([255, 0, 0])));
        assert!(of(&same) < 1e-6);
    }
}
