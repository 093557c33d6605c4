//! A ray's samples merged to one per volume.

use crate::encoding::matrix;
use crate::render::{Geometry, host};
use crate::sampling::{Samples, VolumeSamples};
use burn::tensor::Tensor;
use impasto_kernels::{CompositeLayout, RaySpan};
use std::ops::Range;
use std::sync::Arc;

/// Share of a ray's light under which its inner samples are left out.
const LEAST_SHARE: f32 = 2e-3;
/// Optical depth of a step that lets nothing through, in single precision.
const OPAQUE: f32 = 20.0;

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
}

impl Geometry {
    /// The same rays with one sample per volume: the mean, weighted by contribution, of features
    /// and positions. The inner one is as opaque as all of them together; the outer one takes what
    /// light is left. No gradients.
    pub(crate) fn merged(self) -> Self {
        let weights = self.weights();
        let split = self.samples.inner.len();
        let device = self.outer.device();
        let layout = Arc::clone(&self.layout);
        let mut inner = Merged::new(&self.samples.inner, 3, 0, self.inner.clone());
        let mut outer = Merged::new(&self.samples.outer, 4, split, Some(self.outer.clone()));
        let (mut rays, mut optical, mut behind) = (Vec::new(), Vec::new(), 0);
        let (mut depths, mut distances) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        for span in &layout.rays {
            let sum = |range: &Range<usize>| weights[range.clone()].iter().sum::<f32>();
            let (near, far) = (sum(&span.inner), sum(&span.outer));
            let share = near / (near + far).max(1e-12);
            let before = optical.len();
            if share >= LEAST_SHARE {
                optical.push((-(1.0 - share).ln()).min(OPAQUE));
                depths[0].push(mean(&weights, &layout.depths, &span.inner));
                distances[0].push(mean(&weights, &layout.distances, &span.inner));
                inner.push(&weights, &span.inner);
            }
            depths[1].push(mean(&weights, &layout.depths, &span.outer));
            distances[1].push(mean(&weights, &layout.distances, &span.outer));
            outer.push(&weights, &span.outer);
            rays.push((before..optical.len(), behind));
            behind += 1;
        }
        let in_front = optical.len();
        optical.extend(std::iter::repeat_n(OPAQUE, behind));
        let rays = rays
            .into_iter()
            .map(|(inner, behind)| RaySpan {
                inner,
                outer: in_front + behind..in_front + behind + 1,
            })
            .collect();
        let layout = CompositeLayout {
            rays,
            deltas: vec![1.0; optical.len()],
            depths: depths.concat(),
            distances: distances.concat(),
        };
        Self {
            inner: (in_front > 0).then(|| matrix(inner.rows, inner.width, &device)),
            outer: matrix(outer.rows, outer.width, &device),
            density: Tensor::from_data(optical.as_slice(), &device),
            layout: Arc::new(layout.clone()),
            samples: Samples {
                inner: inner.samples,
                outer: outer.samples,
                layout,
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
        }
    }

    /// Appends the mean of a ray's samples.
    fn push(&mut self, weights: &[f32], span: &Range<usize>) {
        let local = span.start - self.first..span.end - self.first;
        let weights = normalised(&weights[span.clone()]);
        let mean = |data: &[f32], width: usize, out: &mut Vec<f32>| {
            let at = out.len();
            out.resize(at + width, 0.0);
            let rows = data[local.start * width..local.end * width].chunks_exact(width);
            for (row, weight) in rows.zip(&weights) {
                out[at..]
                    .iter_mut()
                    .zip(row)
                    .for_each(|(o, x)| *o += weight * x);
            }
        };
        mean(&self.features, self.width, &mut self.rows);
        mean(&self.source.raw, self.dimensions, &mut self.samples.raw);
        mean(&self.source.cube, 3, &mut self.samples.cube);
        mean(&self.source.views, 3, &mut self.samples.views);
    }
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

fn mean(weights: &[f32], data: &[f32], span: &Range<usize>) -> f32 {
    normalised(&weights[span.clone()])
        .iter()
        .zip(&data[span.clone()])
        .map(|(w, d)| w * d)
        .sum()
}
