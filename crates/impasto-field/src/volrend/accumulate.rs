//! A ray's samples accumulated to one per volume: their means, by weight.

use crate::sampling::Samples;
use impasto_kernels::cpu::composite::{LEAST_SHARE, OPAQUE};
use impasto_kernels::cpu::passes;
use impasto_kernels::{CompositeLayout, RaySpan};
use std::ops::Range;

/// Rays with at most one sample per volume.
pub(crate) struct MergedRays {
    pub(crate) layout: CompositeLayout,
    /// Optical depths, of all inner ones, then of all outer ones.
    pub(crate) density: Vec<f32>,
    pub(crate) volumes: [MergedVolume; 2],
}

/// One volume's merged samples.
pub(crate) struct MergedVolume {
    /// Mean features.
    pub(crate) features: Vec<f32>,
    /// Mean points in the unit cube, `n × 3`.
    pub(crate) cube: Vec<f32>,
    /// Standard deviation, in the unit cube, of where their light comes from.
    pub(crate) footprint: Vec<f32>,
    /// Whose they are.
    pub(crate) rays: Vec<usize>,
}

/// A volume's features: `n × width`.
#[derive(Clone, Copy)]
pub(crate) struct FeatureRows<'a> {
    pub(crate) rows: &'a [f32],
    pub(crate) width: usize,
}

/// The same rays with one sample per volume: the mean, by weight, of features and positions. The
/// inner one is as opaque as all of them together; the outer one takes what light is left, and is
/// left out where that is nothing. No gradients.
pub(crate) fn accumulate(
    samples: &Samples,
    features: [FeatureRows<'_>; 2],
    weights: &[f32],
) -> MergedRays {
    let split = samples.inner.len();
    let layout = &samples.layout;
    let (mut inner, mut outer) = (Vec::new(), Vec::new());
    let (mut parts, mut optical) = (Vec::new(), Vec::new());
    for (ray, span) in layout.rays.iter().enumerate() {
        let sum = |range: &Range<usize>| weights[range.clone()].iter().sum::<f32>();
        let (near, far) = (sum(&span.inner), sum(&span.outer));
        let share = near / (near + far).max(1e-12);
        let before = [inner.len(), outer.len()];
        let opaque = share > 1.0 - LEAST_SHARE;
        if share >= LEAST_SHARE {
            let depth = -(1.0 - share).ln();
            optical.push(if opaque { OPAQUE } else { depth });
            inner.push((ray, span.inner.clone()));
        }
        if !opaque {
            outer.push((ray, span.outer.start - split..span.outer.end - split));
        }
        parts.push([before[0]..inner.len(), before[1]..outer.len()]);
    }
    let in_front = inner.len();
    optical.extend(std::iter::repeat_n(OPAQUE, outer.len()));
    let rays = parts.into_iter().map(|[inner, outer]| RaySpan {
        inner,
        outer: in_front + outer.start..in_front + outer.end,
    });
    let rays = rays.collect();
    let inner = Merging::new(inner, &weights[..split]);
    let outer = Merging::new(outer, &weights[split..]);
    let of_steps = |steps: &[f32]| {
        let parts = [(&inner, &steps[..split]), (&outer, &steps[split..])];
        parts
            .map(|(merging, rows)| merging.means(FeatureRows { rows, width: 1 }))
            .concat()
    };
    MergedRays {
        layout: CompositeLayout {
            rays,
            deltas: vec![1.0; optical.len()],
            depths: of_steps(&layout.depths),
            distances: of_steps(&layout.distances),
        },
        density: optical,
        volumes: [
            inner.merged(&samples.inner.cube, features[0]),
            outer.merged(&samples.outer.cube, features[1]),
        ],
    }
}

/// Rays that have samples in a volume, and what of each of these samples is in the mean.
struct Merging {
    /// Numbers of rays, and the volume's samples that are theirs.
    rays: Vec<(usize, Range<usize>)>,
    /// Of each sample of the volume; those of a ray sum to one.
    shares: Vec<f32>,
}

impl Merging {
    fn new(rays: Vec<(usize, Range<usize>)>, weights: &[f32]) -> Self {
        let mut shares = weights.to_vec();
        for (_, span) in &rays {
            normalise(&mut shares[span.clone()]);
        }
        Self { rays, shares }
    }

    fn means(&self, of: FeatureRows<'_>) -> Vec<f32> {
        let spans = self.rays.iter().map(|(_, span)| span.clone());
        passes::means((of.rows, of.width), spans, &self.shares)
    }

    fn merged(&self, cube: &[f32], features: FeatureRows<'_>) -> MergedVolume {
        let points = FeatureRows {
            rows: cube,
            width: 3,
        };
        let mean = self.means(points);
        let (means, _) = mean.as_chunks::<3>();
        let footprint = means.iter().zip(&self.rays).map(|(mean, (_, span))| {
            let points = &cube[3 * span.start..3 * span.end];
            footprint(points, mean, &self.shares[span.clone()])
        });
        MergedVolume {
            footprint: footprint.collect(),
            features: self.means(features),
            cube: mean,
            rays: self.rays.iter().map(|(ray, _)| *ray).collect(),
        }
    }
}

/// Standard deviation of points, `n × 3`, about their weighted mean.
fn footprint(points: &[f32], mean: &[f32], weights: &[f32]) -> f32 {
    let squares = points.chunks_exact(3).map(|point| {
        let off = point.iter().zip(mean).map(|(x, mean)| (x - mean).powi(2));
        off.sum::<f32>()
    });
    let weighed = squares.zip(weights).map(|(square, weight)| weight * square);
    weighed.sum::<f32>().sqrt()
}

/// Makes weights sum to one; all on the last, the farthest, if none carries light.
fn normalise(weights: &mut [f32]) {
    let sum: f32 = weights.iter().sum();
    if sum > 1e-9 {
        weights.iter_mut().for_each(|w| *w /= sum);
    } else {
        weights.fill(0.0);
        weights.iter_mut().rev().take(1).for_each(|w| *w = 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_one_place_has_no_footprint() {
        // Along x at 0, 0.2 and 0.4.
        let points = [0.0, 0.5, 0.5, 0.2, 0.5, 0.5, 0.4, 0.5, 0.5];
        let found = |weights: [f32; 3], mean: f32| footprint(&points, &[mean, 0.5, 0.5], &weights);
        assert!(found([0.0, 1.0, 0.0], 0.2).abs() < 1e-6);
        assert!((found([0.5, 0.0, 0.5], 0.2) - 0.2).abs() < 1e-6);
        // 0.25 * 0.15² + 0.5 * 0.05² + 0.25 * 0.25², about 0.15.
        let uneven = (0.25 * 0.0225 + 0.5 * 0.0025 + 0.25 * 0.0625_f32).sqrt();
        assert!((found([0.25, 0.5, 0.25], 0.15) - uneven).abs() < 1e-6);
    }
}
