//! What the weights of samples say of their rays.

use impasto_kernels::{CompositeLayout, RaySpan};

/// Depth along the camera's axis at which half of a ray's light has been gathered, of every ray.
pub(crate) fn median_depth(layout: &CompositeLayout, weights: &[f32]) -> Vec<f32> {
    let rays = layout.rays.iter().map(|span| {
        let mut sum = 0.0;
        let mut all = span.samples();
        let crossing = all.find(|i| {
            sum += weights[*i];
            sum >= 0.5
        });
        crossing.map_or(f32::INFINITY, |i| layout.depths[i])
    });
    rays.collect()
}

/// Most of a ray's light that leaving out small weights may move to the background.
const MOST_DROPPED: f32 = 0.02;

/// Which samples are shaded: those of at least `least` weight, and the farthest of each ray. Of a ray
/// whose smaller samples add up to more than 2 % of the light, as haze does, all those that have a
/// tenth of `least`.
pub(crate) fn visibility_mask(layout: &CompositeLayout, weights: &[f32], least: f32) -> Vec<bool> {
    let mut visible: Vec<bool> = weights.iter().map(|w| *w >= least).collect();
    for span in &layout.rays {
        let all = || span.samples();
        let small = all().map(|i| weights[i]).filter(|w| *w < least);
        if small.sum::<f32>() > MOST_DROPPED {
            all().for_each(|i| visible[i] = weights[i] >= 0.1 * least);
        }
        // What is left of the light belongs to the farthest sample.
        if let Some(last) = all().last() {
            visible[last] = true;
        }
    }
    visible
}

/// The layout of the samples that `keep` says, one flag per sample.
pub(crate) fn pruned(layout: &CompositeLayout, keep: &[bool]) -> CompositeLayout {
    let mut position = vec![0usize; keep.len() + 1];
    for (i, kept) in keep.iter().enumerate() {
        position[i + 1] = position[i] + usize::from(*kept);
    }
    let pick = |data: &[f32]| {
        let kept = data.iter().zip(keep).filter(|(_, kept)| **kept);
        kept.map(|(number, _)| *number).collect()
    };
    let map = |r: &std::ops::Range<usize>| position[r.start]..position[r.end];
    let rays = layout.rays.iter().map(|span| RaySpan {
        inner: map(&span.inner),
        outer: map(&span.outer),
    });
    CompositeLayout {
        rays: rays.collect(),
        deltas: pick(&layout.deltas),
        depths: pick(&layout.depths),
        distances: pick(&layout.distances),
    }
}
