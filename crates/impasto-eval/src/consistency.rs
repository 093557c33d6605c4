//! Whether frames along a path agree with each other (PAPER §10; Lai et al. 2018).

use crate::flow::Correspondence;
use image::RgbImage;
use impasto_style::{Perceptual, StyleError};
use rayon::prelude::*;
use serde::Serialize;

/// Frames between the two of a short-range and of a long-range pair.
pub const RANGES: [usize; 2] = [1, 7];
/// A pair of which less can be compared is left out, and counted.
pub const LEAST_COVERAGE: f64 = 0.2;
/// Variance under which a frame is of one colour: a millionth of an 8-bit step, squared.
const FLAT: f64 = 1e-11;

/// How much two frames differ where both show the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairError {
    /// Mean over compared pixels and channels of the squared difference: E. Zero if there are none.
    pub square: f64,
    /// The same over all pixels that have a flow.
    pub square_all: f64,
    /// Variance of the first frame over the compared pixels: mean over them and their channels of
    /// the squared difference to their mean colour.
    pub variance: f64,
    /// Share of pixels compared.
    pub coverage: f64,
}

impl PairError {
    /// E in units of the first frame's variance, which contrast does not change; `None` where the
    /// compared pixels are of one colour.
    pub fn relative(&self) -> Option<f64> {
        (self.variance > 0.0).then(|| self.square / self.variance)
    }
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
    // Colour and its square, summed over those that count.
    let (mut colour, mut energy) = ([0.0f64; 3], 0.0f64);
    let pixels = first.chunks_exact(3).zip(warped.chunks_exact(3));
    let known = pair.mask.iter().zip(&pair.flow.vectors);
    for ((a, b), (counts_too, vector)) in pixels.zip(known) {
        let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
        let square: f64 = squares.sum();
        for (i, used) in [*counts_too, vector.is_some()].into_iter().enumerate() {
            sums[i] += if used { square } else { 0.0 };
            counts[i] += u32::from(used);
        }
        for (sum, value) in colour.iter_mut().zip(a).filter(|_| *counts_too) {
            let value = f64::from(*value);
            *sum += value;
            energy += value * value;
        }
    }
    let mean = |i: usize| sums[i] / (3.0 * f64::from(counts[i].max(1)));
    let compared = f64::from(counts[0].max(1));
    let means: f64 = colour.iter().map(|sum| (sum / compared).powi(2)).sum();
    PairError {
        square: mean(0),
        square_all: mean(1),
        // What is left of a frame of one colour is rounding.
        variance: Some((energy / compared - means) / 3.0)
            .filter(|variance| *variance > FLAT)
            .unwrap_or_default(),
        coverage: pair.coverage(),
    }
}

/// Consistency over all pairs of one range; NaN (`null` in JSON) where no pair counts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Mean E × 100.
    pub e100: f64,
    /// Mean of E divided by the first frame's variance over the compared pixels (see
    /// [`PairError::relative`]): low contrast does not lower it. Over the pairs whose first frame is
    /// not of one colour; NaN (`null` in JSON) if all are.
    pub relative: f64,
    /// Mean root of E.
    pub rmse: f64,
    /// The same over all pixels that have a flow, occluded or not, as later papers report it.
    pub rmse_all: f64,
    /// Mean perceptual distance of a frame and the warped other one: LPIPS' form on VGG-16 without
    /// learned weights, not LPIPS (see [`Perceptual::unweighted_distance`]). Pixels that do not
    /// count are equal in both; over a few pairs; absent where it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vgg_unweighted: Option<f64>,
    /// Mean share of pixels compared, of pairs that count.
    pub coverage: f64,
    /// Pairs that count.
    pub pairs: usize,
    /// Pairs left out because too little of them can be compared.
    pub dropped: usize,
}

impl Consistency {
    /// The mean over several methods' or styles' frames along the same path; `None` over none.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let mean = |get: fn(&Self) -> f64| all.iter().map(get).sum::<f64>() / all.len() as f64;
        let first = all.first()?;
        Some(Self {
            e100: mean(|c| c.e100),
            relative: mean(|c| c.relative),
            rmse: mean(|c| c.rmse),
            rmse_all: mean(|c| c.rmse_all),
            vgg_unweighted: first
                .vgg_unweighted
                .map(|_| mean(|c| c.vgg_unweighted.unwrap_or_default())),
            ..*first
        })
    }
}

/// Something at each of [`RANGES`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ByRange<T> {
    /// Neighbouring frames.
    pub short: T,
    /// Frames seven apart.
    pub long: T,
}

impl<T> ByRange<T> {
    /// At short and at long range.
    pub fn each_ref(&self) -> [&T; 2] {
        [&self.short, &self.long]
    }

    /// What `of` makes of this and another at each range.
    pub(crate) fn with<U>(&self, other: &Self, of: impl Fn(&T, &T) -> U) -> ByRange<U> {
        ByRange {
            short: of(&self.short, &other.short),
            long: of(&self.long, &other.long),
        }
    }
}

impl<T> From<[T; 2]> for ByRange<T> {
    fn from([short, long]: [T; 2]) -> Self {
        Self { short, long }
    }
}

/// Pairs of a range whose perceptual distance is measured: it costs hundreds of times what the
/// others do.
const PERCEPTUAL_PAIRS: usize = 4;

/// The pairs of frames along a path at one range.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// First and second frame, and how they correspond; only pairs that count.
    kept: Vec<([usize; 2], Correspondence)>,
    dropped: usize,
}

/// The pair that agrees least.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Worst<'a> {
    /// First and second frame.
    pub(crate) frames: [usize; 2],
    /// How they correspond.
    pub(crate) pair: &'a Correspondence,
    /// How much they differ.
    pub(crate) error: PairError,
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

    /// How frames `(t, t − range)` correspond, each with `t`, of pairs that count.
    pub(crate) fn links(&self) -> impl Iterator<Item = (usize, &Correspondence)> {
        self.kept.iter().map(|([t, _], pair)| (*t, pair))
    }

    /// The pair of largest E; the first of several. `None` if no pair counts.
    ///
    /// # Panics
    /// If a frame is missing or has another size.
    pub(crate) fn worst(&self, frames: &[RgbImage]) -> Option<Worst<'_>> {
        let errors = self.kept.par_iter().map(|(places, pair)| {
            let [a, b] = places.map(|i| impasto_style::picture(&frames[i]));
            pair_error(pair, &a, &b)
        });
        let errors: Vec<PairError> = errors.collect();
        let all = self.kept.iter().zip(errors);
        // The first of equals is the least in this order.
        let worst = all.min_by(|a, b| b.1.square.total_cmp(&a.1.square));
        worst.map(|((frames, pair), error)| Worst {
            frames: *frames,
            pair,
            error,
        })
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
                let perceptual = vgg.map(|vgg| perceptual(pair, vgg, &a, &b)).transpose()?;
                Ok((error, perceptual))
            })
            .collect::<Result<Vec<_>, StyleError>>()?;
        // Of no pair there is no mean, which is no agreement either.
        let n = errors.len() as f64;
        let mean = |get: fn(&PairError) -> f64| errors.iter().map(|(e, _)| get(e)).sum::<f64>() / n;
        let average = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        let relative = errors.iter().filter_map(|(error, _)| error.relative());
        let distances = errors.iter().filter_map(|(_, distance)| *distance);
        Ok(Consistency {
            e100: 100.0 * mean(|e| e.square),
            relative: average(relative.collect()),
            rmse: mean(|e| e.square.sqrt()),
            rmse_all: mean(|e| e.square_all.sqrt()),
            vgg_unweighted: vgg.map(|_| average(distances.collect())),
            coverage: mean(|e| e.coverage),
            pairs: errors.len(),
            dropped: self.dropped,
        })
    }
}

/// Perceptual distance of a frame and the other one warped onto it.
fn perceptual(
    pair: &Correspondence,
    vgg: &Perceptual,
    first: &[f32],
    second: &[f32],
) -> Result<f64, StyleError> {
    let mut warped = pair.warped(second);
    for (i, mask) in pair.mask.iter().enumerate() {
        if !mask {
            warped[3 * i..3 * i + 3].copy_from_slice(&first[3 * i..3 * i + 3]);
        }
    }
    vgg.unweighted_distance([first, &warped], pair.flow.height, pair.flow.width)
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::flow::FrameGeometry;
    use crate::flow::tests::camera;
    use image::Rgb;

    const DEPTH: f32 = 2.0;

    /// Pairs of a sideways path along a wall.
    pub(crate) fn pairs(frames: usize, range: usize, step: f64) -> Pairs {
        let depth = [DEPTH; 40 * 30];
        Pairs::new(frames, range, |a, b| {
            let cameras = [a, b].map(|i| camera(step * i as f64));
            let [first, second] = cameras.each_ref().map(|camera| FrameGeometry {
                camera,
                depth: &depth,
            });
            Correspondence::exact(&first, &second)
        })
    }

    /// The wall, painted with a ramp, from along the path; with noise of its own in each frame.
    pub(crate) fn frames(count: usize, step: f64, noise: u8) -> Vec<RgbImage> {
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
    fn the_worst_pair_is_the_one_with_the_stained_frame() {
        let wall = pairs(6, 1, 0.05);
        let mut frames = frames(6, 0.05, 8);
        let worst = |frames: &[RgbImage]| wall.worst(frames).unwrap();
        // The last frame is compared with the one before it alone.
        (5..20).for_each(|x| frames[5].put_pixel(x, 15, Rgb([255, 0, 0])));
        assert_eq!(worst(&frames).frames, [5, 4]);
        let all = wall.consistency(&frames, None).unwrap();
        assert!(100.0 * worst(&frames).error.square > all.e100);
        frames[0] = RgbImage::from_pixel(40, 30, Rgb([0, 255, 0]));
        assert_eq!(worst(&frames).frames, [1, 0]);
        assert!(pairs(1, 1, 0.05).worst(&frames).is_none());
    }

    #[test]
    fn contrast_is_divided_out_and_noise_is_not() {
        let pairs = pairs(5, 1, 0.05);
        let of = |frames: &[RgbImage]| pairs.consistency(frames, None).unwrap();
        let noisy = |noise| frames(5, 0.05, noise);
        let [mut pale, mut strong] = [noisy(20), noisy(20)];
        for (pale, strong) in pale.iter_mut().zip(&mut strong) {
            pale.pixels_mut().for_each(|p| p.0 = p.0.map(|v| v / 2));
            strong.pixels_mut().for_each(|p| p.0 = p.0.map(|v| v & !1));
        }
        let (once, twice) = (of(&pale), of(&strong));
        assert!((twice.e100 / once.e100 - 4.0).abs() < 1e-3);
        assert!((twice.relative / once.relative - 1.0).abs() < 1e-4);
        let rising = [0, 10, 20, 40].map(|noise| of(&noisy(noise)).relative);
        assert!(
            rising[0] < 1e-9 && rising.is_sorted_by(|a, b| a < b),
            "{rising:?}"
        );
        let flat = vec![RgbImage::from_pixel(40, 30, Rgb([90, 60, 130])); 5];
        assert!(
            of(&flat).relative.is_nan(),
            "agreement of nothing is not measured"
        );
    }

    #[test]
    fn the_variance_is_that_of_the_compared_pixels() {
        let pair = pairs(2, 1, 0.05).kept.remove(0).1;
        // Half black, half of one colour; what is not compared does not matter.
        let mut frame = vec![0.0f32; 40 * 30 * 3];
        for (i, pixel) in frame.chunks_exact_mut(3).enumerate() {
            match pair.mask[i] {
                true if i / 40 < 15 => pixel.copy_from_slice(&[0.2, 0.4, 0.0]),
                true => {}
                false => pixel.fill(1.0),
            }
        }
        let found = pair_error(&pair, &frame, &frame).variance;
        // Of a half, (a − a/2)² everywhere.
        assert!((found - (0.01 + 0.04) / 3.0).abs() < 1e-8, "{found}");
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
            found.vgg_unweighted.unwrap()
        };
        assert!(of(&same) < 1e-6);
        assert!(of(&frames(2, 0.05, 60)) > 1e-3);
        // The column that only the later frame shows, of a pair from the later to the earlier.
        (0..30).for_each(|y| same[1].put_pixel(39, y, Rgb([255, 0, 0])));
        assert!(of(&same) < 1e-6);
    }
}
