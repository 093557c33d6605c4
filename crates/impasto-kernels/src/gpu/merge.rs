//! A ray's samples merged to one per volume: what lies where, then the means of features, one unit
//! a number.

use super::composite::DeviceLayout;
use super::launch::{argument, cube, cubes_for, empty};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

const TRANSMITTANCE_EPS: f32 = crate::cpu::composite::TRANSMITTANCE_EPS;
/// Share of a ray's light under which its inner or its outer samples are left out.
const LEAST_SHARE: f32 = crate::cpu::composite::LEAST_SHARE;
/// Optical depth of what lets nothing through.
const OPAQUE: f32 = crate::cpu::composite::OPAQUE;

/// What a ray's samples come to.
pub(crate) struct Merged {
    /// Share of each sample in its volume's light along the ray.
    pub(crate) shares: CubeTensor,
    /// `[2 · rays]`, optical depths: all inner ones, then all outer ones.
    pub(crate) density: CubeTensor,
    /// `[rays]`, depth at which half of the light has been gathered; infinite where there is not
    /// as much.
    pub(crate) depth: CubeTensor,
    /// `[2 · rays, 3]`, mean points in the unit cube.
    pub(crate) points: CubeTensor,
    /// `[2 · rays]`, standard deviations of points about their mean.
    pub(crate) footprint: CubeTensor,
}

/// Weights of a ray's samples, into `weights`: their sums by volume, and the median depth.
#[cube]
fn ray_weights(
    sigma: &[f32],
    spans: &[u32],
    steps: &[f32],
    weights: &mut [f32],
    ray: usize,
    samples: usize,
    depths: usize,
) -> (f32, f32, f32) {
    let mut transmittance = 1.0f32;
    let mut near = 0.0f32;
    let mut sum = 0.0f32;
    let mut depth = f32::from_bits(0x7f80_0000u32);
    for volume in 0..2usize {
        near = sum;
        let start = spans[ray * 4 + volume * 2] as usize;
        let end = spans[ray * 4 + volume * 2 + 1] as usize;
        for i in start..end {
            let passed = f32::exp(-sigma[i] * steps[i]);
            let weight = (1.0 - passed) * transmittance;
            transmittance *= passed + TRANSMITTANCE_EPS;
            weights[i] = weight;
            if sum < 0.5 && sum + weight >= 0.5 {
                depth = steps[depths * samples + i];
            }
            sum += weight;
        }
    }
    (near, sum - near, depth)
}

/// Turns the weights of one volume's samples of a ray into shares, and leaves the mean and the
/// deviation of their points.
#[cube]
fn gather(
    points: &[f32],
    shares: &mut [f32],
    means: &mut [f32],
    footprint: &mut [f32],
    start: usize,
    end: usize,
    sum: f32,
    at: usize,
) {
    let mut x = 0.0f32;
    let mut y = 0.0f32;
    let mut z = 0.0f32;
    for i in start..end {
        // All on the last, the farthest, if none carries light.
        let mut share = select(i + 1 == end, 1.0f32, 0.0f32);
        if sum > 1e-9 {
            share = shares[i] / sum;
        }
        shares[i] = share;
        x += share * points[3 * i];
        y += share * points[3 * i + 1];
        z += share * points[3 * i + 2];
    }
    let mut square = 0.0f32;
    for i in start..end {
        let (dx, dy, dz) = (
            points[3 * i] - x,
            points[3 * i + 1] - y,
            points[3 * i + 2] - z,
        );
        square += shares[i] * (dx * dx + dy * dy + dz * dz);
    }
    means[3 * at] = x;
    means[3 * at + 1] = y;
    means[3 * at + 2] = z;
    footprint[at] = f32::sqrt(square);
}

#[cube(launch_unchecked)]
fn weigh_kernel(
    sigma: &[f32],
    spans: &[u32],
    steps: &[f32],
    points: &[f32],
    shares: &mut [f32],
    density: &mut [f32],
    depth: &mut [f32],
    means: &mut [f32],
    footprint: &mut [f32],
    rays: u32,
    samples: u32,
    depths: u32,
) {
    let ray = ABSOLUTE_POS;
    let rays = rays as usize;
    if ray < rays {
        let (near, far, median) = ray_weights(
            sigma,
            spans,
            steps,
            shares,
            ray,
            samples as usize,
            depths as usize,
        );
        depth[ray] = median;
        let share = near / (near + far).max(1e-12);
        let thick = select(
            share > 1.0 - LEAST_SHARE,
            OPAQUE,
            -f32::ln((1.0 - share).max(1e-9)),
        );
        density[ray] = select(share < LEAST_SHARE, 0.0f32, thick);
        density[rays + ray] = OPAQUE;
        for volume in 0..2usize {
            let start = spans[ray * 4 + volume * 2] as usize;
            let end = spans[ray * 4 + volume * 2 + 1] as usize;
            let sum = select(volume == 0, near, far);
            let at = volume * rays + ray;
            gather(points, shares, means, footprint, start, end, sum, at);
        }
    }
}

/// What the samples of rays come to, volume by volume.
pub(crate) fn merge(layout: &DeviceLayout, sigma: &CubeTensor, points: &CubeTensor) -> Merged {
    let (rays, samples) = (layout.rays, layout.samples);
    let merged = Merged {
        shares: empty(sigma, [samples]),
        density: empty(sigma, [2 * rays]),
        depth: empty(sigma, [rays]),
        points: empty(sigma, [2 * rays, 3]),
        footprint: empty(sigma, [2 * rays]),
    };
    // SAFETY: units look at their own ray, whose samples are its own.
    unsafe {
        weigh_kernel::launch_unchecked(
            &sigma.client,
            cubes_for(rays),
            cube(),
            argument(sigma),
            layout.spans.argument(),
            layout.steps.argument(),
            argument(points),
            argument(&merged.shares),
            argument(&merged.density),
            argument(&merged.depth),
            argument(&merged.points),
            argument(&merged.footprint),
            rays as u32,
            samples as u32,
            layout.depths,
        );
    }
    merged
}

#[cube(launch_unchecked)]
fn mean_kernel(
    features: &[f32],
    shares: &[f32],
    spans: &[u32],
    out: &mut [f32],
    rays: u32,
    volume: u32,
    width: u32,
) {
    let at = ABSOLUTE_POS;
    let width = width as usize;
    let (ray, channel) = (at / width, at % width);
    if ray < rays as usize {
        let span = 4 * ray + 2 * volume as usize;
        let mut sum = 0.0f32;
        for i in spans[span] as usize..spans[span + 1] as usize {
            sum += shares[i] * features[i * width + channel];
        }
        out[at] = sum;
    }
}

/// Mean features of one volume's samples of each ray, `[rays, width]`; zero where there are none.
pub(crate) fn means(
    layout: &DeviceLayout,
    features: &CubeTensor,
    shares: &CubeTensor,
    volume: u32,
) -> CubeTensor {
    let width = features.meta.shape()[1];
    let out = empty(features, [layout.rays, width]);
    // SAFETY: units look at their own ray's samples.
    unsafe {
        mean_kernel::launch_unchecked(
            &features.client,
            cubes_for(layout.rays * width),
            cube(),
            argument(features),
            argument(shares),
            layout.spans.argument(),
            argument(&out),
            layout.rays as u32,
            volume,
            width as u32,
        );
    }
    out
}
