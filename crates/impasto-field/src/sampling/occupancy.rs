//! Density grids say where along its ray a sample is worth its time.

use crate::grids::OccupancyGrids;
use crate::rays::{RayBatch, jitter};
use crate::sampling::expected::{ExpectedWeights, Table};
use crate::sampling::pack::{CHUNK, Part, SampleStep, join};
use crate::sampling::samples::Samples;
use crate::sphere::{dot, exit, inner_cube, outer_cube, outer_point};
use impasto_kernels::OccupancySpec;
use impasto_kernels::sampling::{LEAST_TRANSMITTANCE, least_weight};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Most queries of the inner density grid along a ray.
const MOST_STEPS: f32 = 2e4;

/// Places every ray's samples where the density grids expect its light: each sample stands for an
/// equal part of it (but for the share that is spread evenly), and for the length of the ray up to
/// the next one's part.
///
/// With a seed, samples lie at a random place inside their parts, the same for all of one ray;
/// without, in the middle, and those are left out in whose parts no light is expected: see
/// [`least_weight`].
pub struct OccupancySampler<'a> {
    spec: &'a OccupancySpec,
    grids: &'a OccupancyGrids,
    seed: Option<u64>,
    /// Of both volumes' steps.
    tables: [Table; 2],
    /// Whether samples know their raw positions.
    raw: bool,
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
    fn new(origin: [f32; 3], direction: [f32; 3], spec: &OccupancySpec) -> Self {
        let length = dot(direction, direction).sqrt();
        let far = exit(origin, direction).unwrap_or(0.0);
        let range = ((far - spec.near) * length).max(0.0);
        let steps = (range / spec.inner_step).ceil().min(MOST_STEPS) as usize;
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
}

impl<'a> OccupancySampler<'a> {
    /// Samples in the unit cube, without raw positions.
    pub fn new(spec: &'a OccupancySpec, grids: &'a OccupancyGrids, seed: Option<u64>) -> Self {
        Self {
            spec,
            grids,
            seed,
            tables: [spec.inner_step, 1.0 / spec.outer_steps as f32].map(Table::new),
            raw: false,
        }
    }

    /// The same with raw positions, if they are wanted.
    #[must_use]
    pub fn with_raw(self, raw: bool) -> Self {
        Self { raw, ..self }
    }

    /// Samples of rays, on all threads.
    pub fn all(&self, rays: &RayBatch) -> Samples {
        let parts = (0..rays.len().div_ceil(CHUNK)).into_par_iter().map_init(
            <[ExpectedWeights; 2]>::default,
            |expected, chunk| {
                let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(rays.len());
                self.part(rays, range, expected)
            },
        );
        join(parts.collect(), rays)
    }

    /// Samples of a few rays, on the calling thread.
    pub fn few(&self, rays: &RayBatch) -> Samples {
        let part = self.part(rays, 0..rays.len(), &mut Default::default());
        join(vec![part], rays)
    }

    fn part(
        &self,
        rays: &RayBatch,
        range: Range<usize>,
        expected: &mut [ExpectedWeights; 2],
    ) -> Part {
        Arch::new().dispatch(Chunk {
            sampler: self,
            rays,
            range,
            expected,
        })
    }

    #[inline(always)]
    fn sample(&self, ray: &Ray, jitter: f32, expected: &mut [ExpectedWeights; 2], part: &mut Part) {
        self.query(ray, expected);
        let uniform = 0.5 * self.spec.uniform_fraction;
        // Even shares by volume: both have their places that no grid knows of.
        let masses = expected.each_mut().map(|weights| weights.sum(uniform));
        let share = masses[0] / (masses[0] + masses[1]).max(1e-20);
        let most = match ray.steps {
            0 => 0,
            _ => self.spec.samples.saturating_sub(1),
        };
        let within = ((self.spec.samples as f32 * share).round() as usize).min(most);
        let counts = [within, self.spec.samples.max(1) - within];
        self.place(ray, jitter, expected, counts, part);
    }

    /// Asks both grids what light to expect along the ray.
    #[inline(always)]
    fn query(&self, ray: &Ray, expected: &mut [ExpectedWeights; 2]) {
        let [inner, outer] = expected;
        let left = inner.query(ray.steps, 1.0, (&self.grids.inner, &self.tables[0]), |i| {
            inner_cube(ray.at(self.spec.near + (i + 0.5) * ray.step))
        });
        let (origin, view) = (ray.origin, ray.direction.map(|c| c / ray.length));
        let (along, away) = (dot(origin, view), dot(origin, origin));
        let steps = self.spec.outer_steps;
        let step = 1.0 / steps as f32;
        // What `outer_point` does, without its division and without its depth.
        let place = |i: f32| {
            let s = 1.0 - (i + 0.5) * step;
            let sb = s * along;
            let st = (sb * sb + 1.0 - s * s * away).max(0.0).sqrt() - sb;
            let point = |axis: usize| s * origin[axis] + st * view[axis];
            outer_cube([point(0), point(1), point(2), s])
        };
        let left = if left < LEAST_TRANSMITTANCE {
            outer.skip(steps, left)
        } else {
            outer.query(steps, left, (&self.grids.outer, &self.tables[1]), place)
        };
        if let Some(last) = outer.weights.last_mut() {
            *last += left;
        }
    }

    /// Adds `counts` samples of both volumes where light is expected.
    #[inline(always)]
    fn place(
        &self,
        ray: &Ray,
        jitter: f32,
        expected: &mut [ExpectedWeights; 2],
        counts: [usize; 2],
        part: &mut Part,
    ) {
        let [inner, outer] = expected;
        let (length, least) = (ray.length, least_weight(self.seed));
        let parts = inner.cut(counts[0], least, false);
        for &[start, end] in parts {
            let t = self.spec.near + (start + jitter * (end - start)) * ray.step;
            let point = ray.at(t);
            let step = SampleStep {
                cube: inner_cube(point),
                delta: (end - start) * ray.step * length,
                depth: t,
                length,
            };
            part.inner.push(if self.raw { &point } else { &[] }, &step);
        }
        let within = parts.len();
        let parts = outer.cut(counts[1], least, true);
        let size = 1.0 / self.spec.outer_steps as f32;
        for &[start, end] in parts {
            let inverse_radius = 1.0 - (start + jitter * (end - start)) * size;
            let (point, depth) = outer_point(ray.origin, ray.direction, inverse_radius);
            let step = SampleStep {
                cube: outer_cube(point),
                delta: (end - start) * size,
                depth,
                length,
            };
            part.outer.push(if self.raw { &point } else { &[] }, &step);
        }
        part.outer.end();
        part.counts.push([within, parts.len()]);
    }
}

/// A few rays, for code compiled for this machine's vectors.
struct Chunk<'a> {
    sampler: &'a OccupancySampler<'a>,
    rays: &'a RayBatch,
    range: Range<usize>,
    expected: &'a mut [ExpectedWeights; 2],
}

impl WithSimd for Chunk<'_> {
    type Output = Part;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Part {
        let spec = self.sampler.spec;
        let mut part = Part::with_room(self.range.len(), self.range.len() * spec.samples);
        for i in self.range {
            let shift = jitter(self.sampler.seed, i);
            let ray = Ray::new(self.rays.origins[i], self.rays.directions[i], spec);
            self.sampler.sample(&ray, shift, self.expected, &mut part);
        }
        part
    }
}
