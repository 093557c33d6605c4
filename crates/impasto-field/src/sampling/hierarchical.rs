//! The paper's cascade (PAPER §3): samples spread evenly, then more of them where a first field of
//! its own found light.

use crate::config::HierarchicalConfig;
use crate::rays::RayBatch;
use crate::sampling::pack::{CHUNK, LAST_STEP, Part, SampleStep, join};
use crate::sampling::samples::Samples;
use crate::sphere::{dot, exit, inner_cube, outer_cube, outer_point};
use impasto_kernels::cpu::composite;
use impasto_kernels::{CompositeLayout, RaySpan};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::ops::Range;

/// Added to every weight, so that no place is left out.
const LEAST_WEIGHT: f32 = 1e-6;

/// A ray's places: ray parameters inside, ascending; inverse radii outside, descending.
struct Places {
    inner: Vec<f32>,
    outer: Vec<f32>,
}

/// `config.first` samples in either volume, evenly spread from `config.near` to the sphere and from there
/// to infinity; with a `seed`, each at a random place between its neighbours' midpoints.
pub(crate) fn first(rays: &RayBatch, config: &HierarchicalConfig, seed: Option<u64>) -> Samples {
    let near = config.near;
    samples(rays, |ray| {
        let mut rng = seed.map(|seed| ray_rng(seed, ray));
        let far = exit(rays.origins[ray], rays.directions[ray]).filter(|far| *far > near);
        Places {
            inner: far.map_or_else(Vec::new, |far| {
                spread([near, far], config.first, rng.as_mut())
            }),
            outer: spread([1.0, 0.0], config.first, rng.as_mut()),
        }
    })
}

/// The first samples and `config.more` new ones in either volume, placed by the weights that
/// the first have within their volume; with a `seed` at random, else evenly in their distribution.
///
/// `densities`: one per sample of `first`.
pub(crate) fn refined(
    rays: &RayBatch,
    first: &Samples,
    densities: &[f32],
    config: &HierarchicalConfig,
    seed: Option<u64>,
) -> Samples {
    let split = first.inner.len();
    let weights = weights_within(&first.layout, densities);
    samples(rays, |ray| {
        let span = &first.layout.rays[ray];
        let mut rng = seed.map(|seed| ray_rng(!seed, ray));
        let mut more = |places: &mut Vec<f32>, span: &Range<usize>| {
            if places.len() < 3 {
                return;
            }
            let weights = &weights[span.clone()];
            let middles: Vec<f32> = places.windows(2).map(|p| 0.5 * (p[0] + p[1])).collect();
            let last = (config.more.max(2) - 1) as f32;
            let share = |i: usize| rng.as_mut().map_or(i as f32 / last, RngExt::random);
            let inside = &weights[1..weights.len() - 1];
            places.extend(resample(&middles, inside, (0..config.more).map(share)));
        };
        let mut inner = first.layout.depths[span.inner.clone()].to_vec();
        more(&mut inner, &span.inner);
        inner.sort_by(f32::total_cmp);
        let own = span.outer.start - split..span.outer.end - split;
        let outer = first.outer.raw[own.start * 4..own.end * 4].chunks_exact(4);
        let mut outer: Vec<f32> = outer.map(|point| point[3]).collect();
        more(&mut outer, &span.outer);
        outer.sort_by(|a, b| b.total_cmp(a));
        Places { inner, outer }
    })
}

/// Places with the distribution of a histogram: `weights` of the bins between `edges`, which
/// ascend or descend. `shares` in `[0, 1]` say what part of the weight lies before each place.
/// What is no number weighs nothing.
///
/// # Panics
/// Unless there is one edge more than bins.
pub fn resample(edges: &[f32], weights: &[f32], shares: impl IntoIterator<Item = f32>) -> Vec<f32> {
    assert!(
        !weights.is_empty() && edges.len() == weights.len() + 1,
        "edges of a histogram's bins"
    );
    let weights = weights.iter().map(|w| match w.is_finite() {
        true => f64::from(w + LEAST_WEIGHT),
        false => f64::from(LEAST_WEIGHT),
    });
    // In double precision: the last places lie in what rounding leaves of faint bins.
    let total: f64 = weights.clone().sum();
    let mut sums = vec![0.0];
    let mut sum = 0.0;
    for weight in weights {
        sum += weight / total;
        sums.push(sum);
    }
    let place = |share: f32| {
        let share = f64::from(share);
        let bin = sums.partition_point(|sum| *sum <= share);
        let bin = bin.clamp(1, sums.len() - 1) - 1;
        let width = sums[bin + 1] - sums[bin];
        let width = if width > f64::from(LEAST_WEIGHT) {
            width
        } else {
            1.0
        };
        let within = ((share - sums[bin]) / width) as f32;
        edges[bin] + within * (edges[bin + 1] - edges[bin])
    };
    shares.into_iter().map(place).collect()
}

/// Every ray has random numbers of its own, whichever thread it meets.
fn ray_rng(seed: u64, ray: usize) -> Pcg64 {
    Pcg64::seed_from_u64(seed ^ (ray as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// `count` places from one end to the other.
fn spread([from, to]: [f32; 2], count: usize, rng: Option<&mut Pcg64>) -> Vec<f32> {
    let last = count.max(2) - 1;
    let at = |i: f32| from + (to - from) * i / last as f32;
    let Some(rng) = rng else {
        return (0..count).map(|i| at(i as f32)).collect();
    };
    (0..count)
        .map(|i| {
            let low = (i as f32 - 0.5).max(0.0);
            let high = (i as f32 + 0.5).min(last as f32);
            at(low + (high - low) * rng.random::<f32>())
        })
        .collect()
}

/// Weight of each sample as if its volume were all there is.
fn weights_within(layout: &CompositeLayout, densities: &[f32]) -> Vec<f32> {
    let volumes = layout
        .rays
        .iter()
        .flat_map(|span| [&span.inner, &span.outer]);
    let alone = volumes.map(|samples| RaySpan {
        inner: samples.clone(),
        outer: samples.end..samples.end,
    });
    let layout = CompositeLayout {
        rays: alone.collect(),
        deltas: layout.deltas.clone(),
        ..CompositeLayout::default()
    };
    composite::weights(&layout, densities)
}

/// Packs every ray's places.
fn samples(rays: &RayBatch, places: impl Fn(usize) -> Places + Sync) -> Samples {
    let parts: Vec<Part> = (0..rays.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut part = Part::default();
            for ray in chunk * CHUNK..((chunk + 1) * CHUNK).min(rays.len()) {
                place(
                    rays.origins[ray],
                    rays.directions[ray],
                    &places(ray),
                    &mut part,
                );
            }
            part
        })
        .collect();
    join(parts, rays)
}

fn place(origin: [f32; 3], direction: [f32; 3], places: &Places, part: &mut Part) {
    let length = dot(direction, direction).sqrt();
    let far = exit(origin, direction).unwrap_or(0.0);
    for (i, t) in places.inner.iter().enumerate() {
        let point = [0, 1, 2].map(|axis| origin[axis] + t * direction[axis]);
        let next = places.inner.get(i + 1).copied().unwrap_or(far);
        let step = SampleStep {
            cube: inner_cube(point),
            delta: (next - t) * length,
            depth: *t,
            length,
        };
        part.inner.push(&point, &step);
    }
    for (i, s) in places.outer.iter().enumerate() {
        let (point, depth) = outer_point(origin, direction, *s);
        let step = SampleStep {
            cube: outer_cube(point),
            delta: places.outer.get(i + 1).map_or(LAST_STEP, |next| s - next),
            depth,
            length,
        };
        part.outer.push(&point, &step);
    }
    part.counts.push([places.inner.len(), places.outer.len()]);
}
