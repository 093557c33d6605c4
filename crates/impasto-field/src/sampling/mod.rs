//! Density grids say where along its ray a sample is worth its time: rays in, packed samples out.
//! [`cascade`] is the paper's way to do the same.

pub mod cascade;
mod guide;

use crate::config::SamplingConfig;
use crate::encoding::Positions;
use crate::field::Grids;
use crate::sphere::{dot, exit, inner_cube, outer_cube, outer_point};
pub(crate) use guide::{ANY, LEAST_LIGHT};
use guide::{Guide, Table};
use impasto_kernels::{CompositeLayout, RaySpan};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// The step of the last outer sample, which everything infinitely far belongs to.
const LAST_STEP: f32 = 1e10;
/// Most looks at the inner density grid along a ray.
const MOST_STEPS: f32 = 2e4;
/// Rays sampled by one task.
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

    /// Some of the rays.
    ///
    /// # Panics
    /// If there are not so many.
    #[must_use]
    pub fn part(&self, rays: Range<usize>) -> Self {
        Self {
            origins: self.origins[rays.clone()].to_vec(),
            directions: self.directions[rays].to_vec(),
        }
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
    /// Of merged samples `n`: standard deviation, in the unit cube, of where their light comes from.
    /// Empty for single points.
    pub spreads: Vec<f32>,
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

    #[inline(always)]
    fn push(&mut self, raw: &[f32], cube: [f32; 3], view: [f32; 3]) {
        self.raw.extend(raw);
        self.cube.extend(cube);
        self.views.extend(view);
    }

    fn append(&mut self, other: &mut Self) {
        append(&mut self.raw, &mut other.raw);
        append(&mut self.cube, &mut other.cube);
        append(&mut self.views, &mut other.views);
        append(&mut self.spreads, &mut other.spreads);
    }

    fn part(&self, dimensions: usize, range: Range<usize>) -> Self {
        let pick =
            |data: &[f32], width: usize| data[range.start * width..range.end * width].to_vec();
        Self {
            raw: pick(&self.raw, dimensions),
            cube: pick(&self.cube, 3),
            views: pick(&self.views, 3),
            // Samples of a ray are taken apart before they are merged.
            spreads: Vec::new(),
        }
    }

    fn reserve(&mut self, samples: usize, dimensions: usize) {
        self.raw.reserve(samples * dimensions);
        self.cube.reserve(samples * 3);
        self.views.reserve(samples * 3);
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
            // Samples of a ray are taken apart before they are merged.
            spreads: Vec::new(),
        }
    }
}

/// Packed samples of a batch of rays. In the layout's arrays, inner samples come first.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Inner volume.
    pub inner: VolumeSamples,
    /// Outer volume; as sampled, at least one, the farthest, per ray.
    pub outer: VolumeSamples,
    /// Which sample belongs to which ray, steps and depths.
    pub layout: Arc<CompositeLayout>,
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

    /// Samples of one batch of rays after the other as one.
    pub(crate) fn joined(parts: Vec<Self>) -> Self {
        join(parts.into_iter().map(Part::from).collect())
    }

    /// The samples of some of the rays.
    ///
    /// # Panics
    /// If there are not so many rays.
    pub fn of_rays(&self, rays: Range<usize>) -> Self {
        let spans = &self.layout.rays[rays];
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
        let map = |r: &Range<usize>| position[r.start]..position[r.end];
        Self {
            inner: self.inner.kept(3, &inner),
            outer: self.outer.kept(4, &outer),
            layout: Arc::new(CompositeLayout {
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
            }),
        }
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

/// Distance along a ray squeezed into `[0, 1)`: `d / (1 + d)`, one scale for both volumes.
#[inline(always)]
pub fn contracted_distance(distance: f32) -> f32 {
    distance / (1.0 + distance)
}

/// A cheap, well-mixed random number in `[0, 1)` for a seed and a ray.
#[inline(always)]
pub(crate) fn jitter(seed: u64, ray: usize) -> f32 {
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
    /// Room for rays and for the samples of both volumes in any mixture.
    fn with_room(rays: usize, samples: usize) -> Self {
        let mut part = Self::default();
        part.inner.reserve(samples, 3);
        part.outer.reserve(samples, 4);
        for steps in part.inner_steps.iter_mut().chain(&mut part.outer_steps) {
            steps.reserve(samples);
        }
        part.counts.reserve(rays);
        part
    }
}

impl From<Samples> for Part {
    fn from(samples: Samples) -> Self {
        let split = samples.inner.len();
        let layout = Arc::unwrap_or_clone(samples.layout);
        let mut inner_steps = [layout.deltas, layout.depths, layout.distances];
        let outer_steps = inner_steps.each_mut().map(|all| all.split_off(split));
        let counts = layout.rays.iter();
        Self {
            inner: samples.inner,
            outer: samples.outer,
            inner_steps,
            outer_steps,
            counts: counts.map(|s| [s.inner.len(), s.outer.len()]).collect(),
        }
    }
}

/// What sampling needs beside the ray.
pub(crate) struct March<'a> {
    config: &'a SamplingConfig,
    grids: &'a Grids,
    /// Of both volumes' steps.
    tables: [Table; 2],
    /// Light that a sample must be expected to find.
    least: f32,
    /// Whether samples know their raw positions and views.
    whole: bool,
}

/// A ray in the units that steps are measured in.
struct Ray {
    origin: [f32; 3],
    direction: [f32; 3],
    /// Length of `direction`.
    length: f32,
    /// Steps in the unit ball, and the ray parameter of one.
    steps: usize,
    step: f32,
}

impl Ray {
    #[inline(always)]
    fn new(origin: [f32; 3], direction: [f32; 3], config: &SamplingConfig) -> Self {
        let length = dot(direction, direction).sqrt();
        let far = exit(origin, direction).unwrap_or(0.0);
        let range = ((far - config.near) * length).max(0.0);
        let steps = (range / config.inner_step).ceil().min(MOST_STEPS) as usize;
        Self {
            origin,
            direction,
            length,
            steps,
            step: range / steps.max(1) as f32 / length,
        }
    }

    #[inline(always)]
    fn at(&self, t: f32) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.origin[axis] + t * self.direction[axis])
    }

    #[inline(always)]
    fn view(&self) -> [f32; 3] {
        self.direction.map(|c| c / self.length)
    }
}

impl March<'_> {
    #[inline(always)]
    fn ray(&self, ray: &Ray, jitter: f32, guides: &mut [Guide; 2], part: &mut Part) {
        self.look(ray, guides);
        let explore = 0.5 * self.config.explore;
        // Even shares by volume: both have their places that no grid knows of.
        let masses = guides.each_mut().map(|guide| guide.sum(explore));
        let share = masses[0] / (masses[0] + masses[1]).max(1e-20);
        let most = match ray.steps {
            0 => 0,
            _ => self.config.samples.saturating_sub(1),
        };
        let within = ((self.config.samples as f32 * share).round() as usize).min(most);
        let counts = [within, self.config.samples.max(1) - within];
        self.place(ray, jitter, guides, counts, part);
    }

    /// Asks both grids what light to expect along the ray.
    #[inline(always)]
    fn look(&self, ray: &Ray, [inner, outer]: &mut [Guide; 2]) {
        let left = inner.look(ray.steps, 1.0, (&self.grids.inner, &self.tables[0]), |i| {
            inner_cube(ray.at(self.config.near + (i + 0.5) * ray.step))
        });
        let (origin, view) = (ray.origin, ray.view());
        let (along, away) = (dot(origin, view), dot(origin, origin));
        let steps = self.config.outer_steps;
        let step = 1.0 / steps as f32;
        // What `outer_point` does, without its division and without its depth.
        let place = |i: f32| {
            let s = 1.0 - (i + 0.5) * step;
            let sb = s * along;
            let st = (sb * sb + 1.0 - s * s * away).max(0.0).sqrt() - sb;
            let point = |axis: usize| s * origin[axis] + st * view[axis];
            outer_cube([point(0), point(1), point(2), s])
        };
        let left = match left < LEAST_LIGHT {
            true => outer.look_away(steps, left),
            false => outer.look(steps, left, (&self.grids.outer, &self.tables[1]), place),
        };
        if let Some(last) = outer.light.last_mut() {
            *last += left;
        }
    }

    /// Adds `counts` samples of both volumes where the guides say.
    #[inline(always)]
    fn place(
        &self,
        ray: &Ray,
        jitter: f32,
        [inner, outer]: &mut [Guide; 2],
        counts: [usize; 2],
        part: &mut Part,
    ) {
        let (view, length) = (ray.view(), ray.length);
        let parts = inner.cut(counts[0], self.least, false);
        for &[start, end] in parts {
            let t = self.config.near + (start + jitter * (end - start)) * ray.step;
            let point = ray.at(t);
            match self.whole {
                true => part.inner.push(&point, inner_cube(point), view),
                false => part.inner.cube.extend(inner_cube(point)),
            }
            let delta = (end - start) * ray.step * length;
            push_step(&mut part.inner_steps, delta, t, length);
        }
        let within = parts.len();
        let parts = outer.cut(counts[1], self.least, true);
        let step = 1.0 / self.config.outer_steps as f32;
        for &[start, end] in parts {
            let inverse_radius = 1.0 - (start + jitter * (end - start)) * step;
            let (point, depth) = outer_point(ray.origin, ray.direction, inverse_radius);
            match self.whole {
                true => part.outer.push(&point, outer_cube(point), view),
                false => part.outer.cube.extend(outer_cube(point)),
            }
            push_step(&mut part.outer_steps, (end - start) * step, depth, length);
        }
        if let Some(last) = part.outer_steps[0].last_mut() {
            *last = LAST_STEP;
        }
        part.counts.push([within, parts.len()]);
    }
}

/// Adds a sample's step, depth and contracted distance.
#[inline(always)]
fn push_step(steps: &mut [Vec<f32>; 3], delta: f32, depth: f32, length: f32) {
    steps[0].push(delta);
    steps[1].push(depth);
    steps[2].push(contracted_distance(depth * length));
}

/// Places every ray's samples where the density grids expect its light: each sample stands for an
/// equal part of it (but for the share that is spread evenly), and for the length of the ray up to
/// the next one's part.
///
/// With a `seed`, samples lie at a random place inside their parts, the same for all of one ray;
/// without, in the middle.
pub fn march(
    rays: &RayBatch,
    config: &SamplingConfig,
    grids: &Grids,
    seed: Option<u64>,
) -> Samples {
    let march = March {
        least: ANY,
        ..March::to_light(config, grids)
    };
    march.all(rays, seed)
}

impl<'a> March<'a> {
    /// [`march`] without a seed, and without samples that stand for parts in which the grids expect
    /// less than a ten-thousandth of the ray's light: an eighth of them on real scenes, for less
    /// than 0.03 dB. What grids take for nothing, less than 0.01 a unit, is nothing then. (Training
    /// keeps them: what is never looked at is never learned.)
    pub(crate) fn to_light(config: &'a SamplingConfig, grids: &'a Grids) -> Self {
        Self {
            config,
            grids,
            tables: [config.inner_step, 1.0 / config.outer_steps as f32].map(Table::new),
            least: LEAST_LIGHT,
            whole: true,
        }
    }

    /// The same with samples that have neither raw positions nor views.
    pub(crate) fn bare(self) -> Self {
        Self {
            whole: false,
            ..self
        }
    }

    /// Samples of rays, on all threads.
    pub(crate) fn all(&self, rays: &RayBatch, seed: Option<u64>) -> Samples {
        let parts: Vec<Part> = (0..rays.len().div_ceil(CHUNK))
            .into_par_iter()
            .map_init(<[Guide; 2]>::default, |guides, chunk| {
                let chunk = MarchChunk {
                    march: self,
                    rays,
                    chunk: chunk * CHUNK..((chunk + 1) * CHUNK).min(rays.len()),
                    seed,
                    guides,
                };
                Arch::new().dispatch(chunk)
            })
            .collect();
        join(parts)
    }

    /// Samples of a few rays, on the calling thread.
    pub(crate) fn samples(&self, rays: &RayBatch) -> Samples {
        join(vec![Arch::new().dispatch(MarchChunk {
            march: self,
            rays,
            chunk: 0..rays.len(),
            seed: None,
            guides: &mut Default::default(),
        })])
    }
}

/// A few rays, for code compiled for this machine's vectors.
struct MarchChunk<'a> {
    march: &'a March<'a>,
    rays: &'a RayBatch,
    chunk: Range<usize>,
    seed: Option<u64>,
    guides: &'a mut [Guide; 2],
}

impl WithSimd for MarchChunk<'_> {
    type Output = Part;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Part {
        let config = self.march.config;
        let mut part = Part::with_room(self.chunk.len(), self.chunk.len() * config.samples);
        for ray in self.chunk {
            let shift = self.seed.map_or(0.5, |seed| jitter(seed, ray));
            let ray = Ray::new(self.rays.origins[ray], self.rays.directions[ray], config);
            self.march.ray(&ray, shift, self.guides, &mut part);
        }
        part
    }
}

fn join(parts: Vec<Part>) -> Samples {
    let (mut samples, mut layout) = (Samples::default(), CompositeLayout::default());
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
                append(all, own);
            }
        }
        for [inner, outer] in part.counts {
            layout.rays.push(RaySpan {
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
    [layout.deltas, layout.depths, layout.distances] = inner;
    samples.layout = Arc::new(layout);
    samples
}
