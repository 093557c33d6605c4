//! A ray's samples merged to one per volume.

use crate::encoding::matrix;
use crate::render::{Geometry, host};
use crate::sampling::{Samples, VolumeSamples};
use burn::tensor::Tensor;
use impasto_kernels::cpu::composite::{LEAST_SHARE, OPAQUE};
use impasto_kernels::{CompositeLayout, RaySpan};
use std::ops::Range;
use std::sync::Arc;

/// One volume's merged samples.
struct Merged<'a> {
    source: &'a VolumeSamples,
    dimensions: usize,
    /// Index of the volume's first sample in the layout.
    first: usize,
    features: Vec<f32>,
    width: usize,
    samples: VolumeSamples,
    rows: Vec<f32>,
    depths: Vec<f32>,
    distances: Vec<f32>,
}

impl Geometry {
    /// The same rays with one sample per volume: the mean, weighted by contribution, of features
    /// and positions. The inner one is as opaque as all of them together; the outer one takes what
    /// light is left, and is left out where that is nothing. No gradients.
    ///
    /// `weights` are the samples' contributions, as of [`Self::weights`].
    pub(crate) fn merged(self, weights: &[f32]) -> Self {
        let split = self.samples.inner.len();
        let device = self.density.device();
        let layout = Arc::clone(&self.samples.layout);
        let mut inner = Merged::new(&self.samples.inner, 3, 0, self.inner);
        let mut outer = Merged::new(&self.samples.outer, 4, split, self.outer);
        let (mut parts, mut optical, mut behind) = (Vec::new(), Vec::new(), 0);
        for span in &layout.rays {
            let sum = |range: &Range<usize>| weights[range.clone()].iter().sum::<f32>();
            let (near, far) = (sum(&span.inner), sum(&span.outer));
            let share = near / (near + far).max(1e-12);
            let before = [optical.len(), behind];
            let opaque = share > 1.0 - LEAST_SHARE;
            if share >= LEAST_SHARE {
                let depth = -(1.0 - share).ln();
                optical.push(if opaque { OPAQUE } else { depth });
                inner.push(weights, &span.inner, &layout);
            }
            if !opaque {
                behind += 1;
                outer.push(weights, &span.outer, &layout);
            }
            parts.push([before[0]..optical.len(), before[1]..behind]);
        }
        let in_front = optical.len();
        optical.extend(std::iter::repeat_n(OPAQUE, behind));
        let rays = parts.into_iter().map(|[inner, outer]| RaySpan {
            inner,
            outer: in_front + outer.start..in_front + outer.end,
        });
        let rays = rays.collect();
        let layout = CompositeLayout {
            rays,
            deltas: vec![1.0; optical.len()],
            depths: [inner.depths, outer.depths].concat(),
            distances: [inner.distances, outer.distances].concat(),
        };
        Self {
            inner: (in_front > 0).then(|| matrix(inner.rows, inner.width, &device)),
            outer: (behind > 0).then(|| matrix(outer.rows, outer.width, &device)),
            density: Tensor::from_data(optical.as_slice(), &device),
            samples: Samples {
                inner: inner.samples,
                outer: outer.samples,
                layout: Arc::new(layout),
            },
        }
    }
}

impl<'a> Merged<'a> {
    fn new(
        source: &'a VolumeSamples,
        dimensions: usize,
        first: usize,
        features: Option<Tensor<2>>,
    ) -> Self {
        Self {
            source,
            dimensions,
            first,
            width: features.as_ref().map_or(1, |f| f.dims()[1]),
            features: features.map(host).unwrap_or_default(),
            samples: VolumeSamples::default(),
            rows: Vec::new(),
            depths: Vec::new(),
            distances: Vec::new(),
        }
    }

    /// Appends the mean of a ray's samples.
    fn push(&mut self, weights: &[f32], span: &Range<usize>, layout: &CompositeLayout) {
        let local = span.start - self.first..span.end - self.first;
        let weights = normalised(&weights[span.clone()]);
        let mean_of = |range: &Range<usize>, data: &[f32], width: usize, out: &mut Vec<f32>| {
            let at = out.len();
            out.resize(at + width, 0.0);
            let rows = data[range.start * width..range.end * width].chunks_exact(width);
            for (row, weight) in rows.zip(&weights) {
                out[at..]
                    .iter_mut()
                    .zip(row)
                    .for_each(|(o, x)| *o += weight * x);
            }
        };
        let (source, merged) = (self.source, &mut self.samples);
        mean_of(&local, &self.features, self.width, &mut self.rows);
        mean_of(&local, &source.raw, self.dimensions, &mut merged.raw);
        mean_of(&local, &source.cube, 3, &mut merged.cube);
        let points = &source.cube[3 * local.start..3 * local.end];
        let spreads = source.spreads.get(local.clone()).unwrap_or_default();
        let mean = &merged.cube[merged.cube.len() - 3..];
        let found = spread((points, spreads), mean, &weights);
        merged.spreads.push(found);
        mean_of(&local, &source.views, 3, &mut merged.views);
        mean_of(span, &layout.depths, 1, &mut self.depths);
        mean_of(span, &layout.distances, 1, &mut self.distances);
    }
}

/// Standard deviation of points, `n × 3`, about their weighted mean; of points that were merged
/// before, with their own, `n`.
fn spread((points, own): (&[f32], &[f32]), mean: &[f32], weights: &[f32]) -> f32 {
    let own = own.iter().copied().chain(std::iter::repeat(0.0));
    let squares = points.chunks_exact(3).zip(own).map(|(point, own)| {
        let off = point.iter().zip(mean).map(|(x, mean)| (x - mean).powi(2));
        off.sum::<f32>() + own.powi(2)
    });
    let weighed = squares.zip(weights).map(|(square, weight)| weight * square);
    weighed.sum::<f32>().sqrt()
}

/// Weights that sum to one; all on the last, the farthest, if none carries light.
fn normalised(weights: &[f32]) -> Vec<f32> {
    let sum: f32 = weights.iter().sum();
    if sum > 1e-9 {
        weights.iter().map(|w| w / sum).collect()
    } else {
        let mut last = vec![0.0; weights.len()];
        last.iter_mut().rev().take(1).for_each(|w| *w = 1.0);
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_one_place_has_no_spread() {
        // Along x at 0, 0.2 and 0.4.
        let points = [0.0, 0.5, 0.5, 0.2, 0.5, 0.5, 0.4, 0.5, 0.5];
        let of = |own: &[f32], weights: [f32; 3], mean: f32| {
            spread((&points, own), &[mean, 0.5, 0.5], &weights)
        };
        let found = |weights: [f32; 3], mean: f32| of(&[], weights, mean);
        assert!(found([0.0, 1.0, 0.0], 0.2).abs() < 1e-6);
        assert!((found([0.5, 0.0, 0.5], 0.2) - 0.2).abs() < 1e-6);
        // 0.25 * 0.15² + 0.5 * 0.05² + 0.25 * 0.25², about 0.15.
        let uneven = (0.25 * 0.0225 + 0.5 * 0.0025 + 0.25 * 0.0625_f32).sqrt();
        assert!((found([0.25, 0.5, 0.25], 0.15) - uneven).abs() < 1e-6);
        // Merged before: their own spread remains, and adds to the one between them.
        assert!((of(&[0.0, 0.3, 0.0], [0.0, 1.0, 0.0], 0.2) - 0.3).abs() < 1e-6);
        let both = of(&[0.3, 0.0, 0.3], [0.5, 0.0, 0.5], 0.2);
        assert!((both - (0.04 + 0.09_f32).sqrt()).abs() < 1e-6);
    }
}
