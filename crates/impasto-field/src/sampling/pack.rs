//! Samples of chunks of rays, joined.

use crate::rays::{RayBatch, contracted_distance};
use crate::sampling::samples::{Samples, VolumeSamples};
use impasto_kernels::{CompositeLayout, RaySpan};
use std::sync::Arc;

/// The step of the last outer sample, which everything infinitely far belongs to.
pub(super) const LAST_STEP: f32 = 1e10;
/// Rays sampled by one task.
pub(super) const CHUNK: usize = 64;

/// A chunk's samples of one volume.
#[derive(Default)]
pub(super) struct VolumePart {
    samples: VolumeSamples,
    /// Deltas, depths, contracted distances.
    steps: [Vec<f32>; 3],
}

/// One sample.
pub(super) struct SampleStep {
    pub(super) cube: [f32; 3],
    pub(super) delta: f32,
    /// In units of the ray's direction.
    pub(super) depth: f32,
    /// Length of the ray's direction.
    pub(super) length: f32,
}

impl VolumePart {
    /// Adds a sample; `raw` is empty where no encoding wants it.
    #[inline(always)]
    pub(super) fn push(&mut self, raw: &[f32], step: &SampleStep) {
        self.samples.raw.extend(raw);
        self.samples.cube.extend(step.cube);
        self.steps[0].push(step.delta);
        self.steps[1].push(step.depth);
        self.steps[2].push(contracted_distance(step.depth * step.length));
    }

    /// Makes the last sample reach to infinity.
    #[inline(always)]
    pub(super) fn end(&mut self) {
        if let Some(last) = self.steps[0].last_mut() {
            *last = LAST_STEP;
        }
    }

    fn reserve(&mut self, samples: usize) {
        self.samples.cube.reserve(samples * 3);
        for steps in &mut self.steps {
            steps.reserve(samples);
        }
    }

    fn append(&mut self, other: &mut Self) {
        append(&mut self.samples.raw, &mut other.samples.raw);
        append(&mut self.samples.cube, &mut other.samples.cube);
        for (all, own) in self.steps.iter_mut().zip(&mut other.steps) {
            append(all, own);
        }
    }
}

/// One chunk's samples before they are joined.
#[derive(Default)]
pub(super) struct Part {
    pub(super) inner: VolumePart,
    pub(super) outer: VolumePart,
    /// Inner and outer counts per ray.
    pub(super) counts: Vec<[usize; 2]>,
}

impl Part {
    /// Room for rays and for the samples of both volumes in any mixture.
    pub(super) fn with_room(rays: usize, samples: usize) -> Self {
        let mut part = Self::default();
        part.inner.reserve(samples);
        part.outer.reserve(samples);
        part.counts.reserve(rays);
        part
    }
}

/// Moves `own` behind `all`; the first one is not copied.
fn append(all: &mut Vec<f32>, own: &mut Vec<f32>) {
    if all.is_empty() {
        std::mem::swap(all, own);
    } else {
        all.append(own);
    }
}

/// All chunks of a batch of rays as one.
pub(super) fn join(parts: Vec<Part>, rays: &RayBatch) -> Samples {
    let [mut inner_at, mut outer_at] = [0, parts.iter().map(|p| p.inner.samples.len()).sum()];
    let mut all = Part::default();
    let mut spans = Vec::with_capacity(rays.len());
    for mut part in parts {
        all.inner.append(&mut part.inner);
        all.outer.append(&mut part.outer);
        for [inner, outer] in part.counts {
            spans.push(RaySpan {
                inner: inner_at..inner_at + inner,
                outer: outer_at..outer_at + outer,
            });
            inner_at += inner;
            outer_at += outer;
        }
    }
    let mut steps = all.inner.steps;
    for (inner, mut outer) in steps.iter_mut().zip(all.outer.steps) {
        inner.append(&mut outer);
    }
    let [deltas, depths, distances] = steps;
    Samples {
        inner: all.inner.samples,
        outer: all.outer.samples,
        layout: Arc::new(CompositeLayout {
            rays: spans,
            deltas,
            depths,
            distances,
        }),
        views: rays.views(),
    }
}
