//! Packed samples.

use crate::encoding::Positions;
use impasto_kernels::{CompositeLayout, RaySpan};
use std::ops::Range;
use std::sync::Arc;

/// Samples of one volume, in the order of their rays.
#[derive(Debug, Clone, Default)]
pub struct VolumeSamples {
    /// `n × 3` (inner) or `n × 4` (outer); empty where no encoding wants it.
    pub raw: Vec<f32>,
    /// `n × 3`, the same in the unit cube.
    pub cube: Vec<f32>,
}

impl VolumeSamples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.cube.len() / 3
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.cube.is_empty()
    }

    /// The positions for encodings.
    pub fn positions(&self, dimensions: usize) -> Positions<'_> {
        Positions {
            raw: &self.raw,
            dimensions,
            cube: &self.cube,
        }
    }

    fn part(&self, dimensions: usize, range: Range<usize>) -> Self {
        let pick = |data: &[f32], width: usize| match data.is_empty() {
            true => Vec::new(),
            false => data[range.start * width..range.end * width].to_vec(),
        };
        Self {
            raw: pick(&self.raw, dimensions),
            cube: pick(&self.cube, 3),
        }
    }
}

/// Packed samples of a batch of rays. In the layout's arrays, inner samples come first.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Inner volume.
    pub inner: VolumeSamples,
    /// Outer volume; at least one, the farthest, per ray.
    pub outer: VolumeSamples,
    /// Which sample belongs to which ray, steps and depths.
    pub layout: Arc<CompositeLayout>,
    /// `rays × 3`, unit view directions.
    pub views: Vec<f32>,
}

impl Samples {
    /// Number of samples of both volumes.
    pub fn len(&self) -> usize {
        self.inner.len() + self.outer.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The samples of some of the rays.
    ///
    /// # Panics
    /// If there are not so many rays.
    pub fn of_rays(&self, rays: Range<usize>) -> Self {
        let spans = &self.layout.rays[rays.clone()];
        let whole = |of: fn(&RaySpan) -> &Range<usize>| match (spans.first(), spans.last()) {
            (Some(first), Some(last)) => of(first).start..of(last).end,
            _ => 0..0,
        };
        let (inner, outer) = (whole(|span| &span.inner), whole(|span| &span.outer));
        let split = self.inner.len();
        let local = outer.start.max(split) - split..outer.end.max(split) - split;
        let pick = |data: &[f32]| [&data[inner.clone()], &data[outer.clone()]].concat();
        let moved = |range: &Range<usize>, from: usize, to: usize| {
            range.start - from + to..range.end - from + to
        };
        let spans = spans.iter().map(|span| RaySpan {
            inner: moved(&span.inner, inner.start, 0),
            outer: moved(&span.outer, outer.start, inner.len()),
        });
        Self {
            views: self.views[3 * rays.start..3 * rays.end].to_vec(),
            inner: self.inner.part(3, inner.clone()),
            outer: self.outer.part(4, local),
            layout: Arc::new(CompositeLayout {
                rays: spans.collect(),
                deltas: pick(&self.layout.deltas),
                depths: pick(&self.layout.depths),
                distances: pick(&self.layout.distances),
            }),
        }
    }
}
