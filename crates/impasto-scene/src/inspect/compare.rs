//! Brightness and sharpness of photos beside their neighbours, which show the same things.

use rayon::prelude::*;

use super::neighbours::{Neighbour, Seen};
use super::quality::{Luma, PhotoQuality, RegionQuality};
use crate::scene::Photo;
use crate::statistics::median;

/// Brightness and sharpness of a photo beside its neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Comparison {
    /// Logarithm of its detail over theirs.
    pub(super) detail: f64,
    /// Logarithm of its fine over its coarse detail, less theirs.
    pub(super) slope: f64,
    /// Stops (factors of two of light) that it is brighter.
    pub(super) stops: f64,
    /// Whether the same points were compared, not the whole photos.
    pub(super) at_points: bool,
}

/// Neighbours that a photo is compared with, and the fewest that allow a judgement: with two, one
/// cannot tell which of three differs.
const COMPARED: usize = 5;
const FEWEST: usize = 3;
/// Fewest points in common that allow a judgement.
const LEAST_POINTS: usize = 12;

/// Stops for a ratio of stored values, which are about the 2.2nd root of the light.
fn stops(ratio: f64) -> f64 {
    2.2 * ratio.log2()
}

/// Brightness and detail of all photos, as wholes and at their points.
pub(super) fn qualities(photos: &[Photo], seen: &[Seen]) -> Vec<PhotoQuality> {
    let pairs = photos.par_iter().zip(seen);
    let qualities = pairs.map(|(photo, seen)| Luma::of(&photo.pixels).quality(seen));
    qualities.collect()
}

/// Compares every photo with its neighbours; `None` where there are too few.
pub(super) fn compare(
    qualities: &[PhotoQuality],
    neighbours: &[Vec<Neighbour>],
) -> Vec<Option<Comparison>> {
    let compared = (0..qualities.len()).into_par_iter().map(|index| {
        let near: Vec<usize> = neighbours[index]
            .iter()
            .filter(|n| n.overlap >= 0.2)
            .take(COMPARED)
            .map(|n| n.photo)
            .collect();
        at_points(qualities, index, &near).or_else(|| as_wholes(qualities, index, &near))
    });
    compared.collect()
}

fn at_points(qualities: &[PhotoQuality], index: usize, near: &[usize]) -> Option<Comparison> {
    let own = &qualities[index].at_points;
    let [mut details, mut brighter] = [Vec::new(), Vec::new()];
    for &photo in near {
        let other = &qualities[photo].at_points;
        let shared: Vec<(&RegionQuality, &RegionQuality)> = own
            .iter()
            .filter_map(|(point, quality)| Some((quality, other.get(point)?)))
            .collect();
        if shared.len() < LEAST_POINTS {
            continue;
        }
        details.push(median(shared.iter().map(|(a, b)| a.detail - b.detail))?);
        // The floor keeps the noise of black pixels from becoming stops.
        let ratio = |(a, b): &(&RegionQuality, &RegionQuality)| {
            stops((a.brightness + 4.0) / (b.brightness + 4.0))
        };
        brighter.push(median(shared.iter().map(ratio))?);
    }
    if details.len() < FEWEST {
        return None;
    }
    Some(Comparison {
        detail: median(details)?,
        slope: 0.0,
        stops: median(brighter)?,
        at_points: true,
    })
}

fn as_wholes(qualities: &[PhotoQuality], index: usize, near: &[usize]) -> Option<Comparison> {
    if near.len() < FEWEST {
        return None;
    }
    let own = &qualities[index];
    let against = |of: fn(&PhotoQuality) -> f64| {
        let others = near.iter().map(|photo| of(&qualities[*photo]));
        Some(of(own) - median(others)?)
    };
    Some(Comparison {
        detail: against(|q| q.whole.detail)?,
        slope: against(|q| q.slope)?,
        stops: against(|q| stops(q.whole.brightness + 4.0))?,
        at_points: false,
    })
}
