//! Density-grid marching: rays in, packed samples out.

use crate::config::SamplingConfig;
use crate::encoding::Positions;
use crate::field::Grids;
use crate::sphere::{dot, exit, inner_cube, outer_cube, outer_point};
use impasto_kernels::{CompositeLayout, RaySpan};
use rayon::prelude::*;

/// The step of the last outer sample, which everything infinitely far belongs to.
const LAST_STEP: f32 = 1e10;
/// Rays marched by one task.
const CHUNK: usize = 64;

/// Rays in scene units. Directions have camera-space z = 1, so that a ray parameter is the depth
/// along the camera's axis.
#[derive(Debug, Clone, Default)]
pub struct RayBatch {
    /// Camera centres, inside the unit sphere.
    pub origins: Vec<[f32; 3]>,
    /// Directions, not normalised.
    pub directions: Vec<[f32; 3]>,
}

impl RayBatch {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Adds a ray.
    pub fn push(&mut self, origin: [f32; 3], direction: [f32; 3]) {
        self.origins.push(origin);
        self.directions.push(direction);
    }
}

/// Samples of one volume, in the order of their rays.
#[derive(Debug, Clone, Default)]
pub struct VolumeSamples {
    /// `n × 3` (inner) or `n × 4` (outer).
    pub raw: Vec<f32>,
    /// `n × 3`, the same in the unit cube.
    pub cube: Vec<f32>,
    /// `n × 3`, unit view directions.
    pub views: Vec<f32>,
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

    fn append(&mut self, other: &mut Self) {
        self.raw.append(&mut other.raw);
        self.cube.append(&mut other.cube);
        self.views.append(&mut other.views);
    }

    fn kept(&self, dimensions: usize, indices: &[usize]) -> Self {
        let pick = |data: &[f32], width: usize| {
            indices
                .iter()
                .flat_map(|i| &data[i * width..(i + 1) * width])
                .copied()
                .collect()
        };
        Self {
            raw: pick(&self.raw, dimensions),
            cube: pick(&self.cube, 3),
            views: pick(&self.views, 3),
        }
    }
}

/// Packed samples of a batch of rays. In the layout's arrays, inner samples come first.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Inner volume.
    pub inner: VolumeSamples,
    /// Outer volume; at least one sample, the farthest, per ray.
    pub outer: VolumeSamples,
    /// Which sample belongs to which ray, steps and depths.
    pub layout: CompositeLayout,
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

    /// Keeps the samples that `keep` says, one flag per sample in layout order.
    pub fn pruned(&self, keep: &[bool]) -> Self {
        let split = self.inner.len();
        let inner: Vec<usize> = (0..split).filter(|i| keep[*i]).collect();
        let outer: Vec<usize> = (split..keep.len())
            .filter(|i| keep[*i])
            .map(|i| i - split)
            .collect();
        let mut position = vec![0usize; keep.len() + 1];
        for (i, kept) in keep.iter().enumerate() {
            position[i + 1] = position[i] + usize::from(*kept);
        }
        let pick = |data: &[f32]| {
            data.iter()
                .zip(keep)
                .filter(|(_, k)| **k)
                .map(|(d, _)| *d)
                .collect()
        };
        let map = |r: &std::ops::Range<usize>| position[r.start]..position[r.end];
        Self {
            inner: self.inner.kept(3, &inner),
            outer: self.outer.kept(4, &outer),
            layout: CompositeLayout {
                rays: self
                    .layout
                    .rays
                    .iter()
                    .map(|span| RaySpan {
                        inner: map(&span.inner),
                        outer: map(&span.outer),
                    })
                    .collect(),
                deltas: pick(&self.layout.deltas),
                depths: pick(&self.layout.depths),
                distances: pick(&self.layout.distances),
            },
        }
    }
}

/// Distance along a ray squeezed into `[0, 1)`: `d / (1 + d)`, one scale for both volumes.
#[inline(always)]
pub fn contracted_distance(distance: f32) -> f32 {
    distance / (1.0 + distance)
}

/// A cheap, well-mixed random number in `[0, 1)` for a seed and a ray.
fn jitter(seed: u64, ray: usize) -> f32 {
    let mut x = seed ^ (ray as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1u64 << 24) as f32
}

/// One chunk's samples before they are joined.
#[derive(Default)]
struct Part {
    inner: VolumeSamples,
    outer: VolumeSamples,
    /// Deltas, depths, distances.
    inner_steps: [Vec<f32>; 3],
    outer_steps: [Vec<f32>; 3],
    /// Inner and outer counts per ray.
    counts: Vec<[usize; 2]>,
}

impl Part {
    fn march(
        &mut self,
        origin: [f32; 3],
        direction: [f32; 3],
        config: &SamplingConfig,
        grids: &Grids,
        jitter: f32,
    ) {
        let length = dot(direction, direction).sqrt();
        let view = direction.map(|c| c / length);
        let before = [self.inner.len(), self.outer.len()];
        if let Some(far) = exit(origin, direction) {
            let step = config.inner_step / length;
            let count = ((far - config.near) / step).ceil().clamp(0.0, 1e5) as usize;
            for i in 0..count {
                let t = config.near + (i as f32 + jitter) * step;
                let point = [0, 1, 2].map(|a| origin[a] + t * direction[a]);
                let cube = inner_cube(point);
                if t < far && grids.inner.is_occupied(cube) {
                    self.inner.raw.extend(point);
                    self.inner.cube.extend(cube);
                    self.inner.views.extend(view);
                    self.inner_steps[0].push(config.inner_step);
                    self.inner_steps[1].push(t);
                    self.inner_steps[2].push(contracted_distance(t * length));
                }
            }
        }
        let step = 1.0 / config.outer_steps as f32;
        for i in 0..config.outer_steps {
            let last = i + 1 == config.outer_steps;
            let (point, depth) = outer_point(origin, direction, 1.0 - (i as f32 + jitter) * step);
            let cube = outer_cube(point);
            if last || grids.outer.is_occupied(cube) {
                self.outer.raw.extend(point);
                self.outer.cube.extend(cube);
                self.outer.views.extend(view);
                self.outer_steps[0].push(if last { LAST_STEP } else { step });
                self.outer_steps[1].push(depth);
                self.outer_steps[2].push(contracted_distance(depth * length));
            }
        }
        self.counts
            .push([self.inner.len() - before[0], self.outer.len() - before[1]]);
    }
}

/// Samples every ray where the density grids are occupied.
///
/// With a `seed`, sample positions are shifted by a random part of a step, one per ray; without,
/// they lie in the middle of their steps.
pub fn march(
    rays: &RayBatch,
    config: &SamplingConfig,
    grids: &Grids,
    seed: Option<u64>,
) -> Samples {
    let parts: Vec<Part> = (0..rays.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut part = Part::default();
            for ray in chunk * CHUNK..((chunk + 1) * CHUNK).min(rays.len()) {
                let shift = seed.map_or(0.5, |seed| jitter(seed, ray));
                part.march(
                    rays.origins[ray],
                    rays.directions[ray],
                    config,
                    grids,
                    shift,
                );
            }
            part
        })
        .collect();
    join(parts)
}

fn join(parts: Vec<Part>) -> Samples {
    let mut samples = Samples::default();
    let split: usize = parts.iter().map(|p| p.inner.len()).sum();
    let [mut inner_at, mut outer_at] = [0, split];
    let mut steps: [[Vec<f32>; 3]; 2] = Default::default();
    for mut part in parts {
        samples.inner.append(&mut part.inner);
        samples.outer.append(&mut part.outer);
        for (all, own) in steps
            .iter_mut()
            .zip([&mut part.inner_steps, &mut part.outer_steps])
        {
            for (all, own) in all.iter_mut().zip(own) {
                all.append(own);
            }
        }
        for [inner, outer] in part.counts {
            samples.layout.rays.push(RaySpan {
                inner: inner_at..inner_at + inner,
                outer: outer_at..outer_at + outer,
            });
            inner_at += inner;
            outer_at += outer;
        }
    }
    let [mut inner, outer] = steps;
    for (inner, mut outer) in inner.iter_mut().zip(outer) {
        inner.append(&mut outer);
    }
    [
        samples.layout.deltas,
        samples.layout.depths,
        samples.layout.distances,
    ] = inner;
    samples
}
