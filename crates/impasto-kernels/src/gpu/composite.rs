//! Compositing of packed samples, one unit a ray.

use super::launch::{Uploaded, Uploads, argument, cube, cubes_for, empty, zeros};
use crate::CompositeLayout;
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;
use std::sync::Arc;

/// Kept under every factor of the transmittance, as in NeRF++.
const TRANSMITTANCE_EPS: f32 = crate::cpu::composite::TRANSMITTANCE_EPS;

/// A layout on the device: where each ray's samples are, then their steps.
#[derive(Clone)]
pub(crate) struct DeviceLayout {
    /// Start and end of the inner, then of the outer samples of each ray.
    pub(crate) spans: Uploaded,
    /// All step lengths, all depths, all distances, and whatever else there is.
    pub(crate) steps: Uploaded,
    pub(crate) rays: usize,
    pub(crate) samples: usize,
    /// Which of `steps` are the depths.
    pub(crate) depths: u32,
}

/// Layouts that still exist: a patch is painted many times, forward and backward.
static KNOWN: Uploads<CompositeLayout, DeviceLayout> = Uploads::new();

impl DeviceLayout {
    pub(crate) fn of(like: &CubeTensor, layout: &Arc<CompositeLayout>) -> Self {
        KNOWN.of(layout, like, || Self::new(like, layout))
    }

    fn new(like: &CubeTensor, layout: &CompositeLayout) -> Self {
        let spans = layout
            .rays
            .iter()
            .flat_map(|ray| [&ray.inner, &ray.outer].map(|r| [r.start as u32, r.end as u32]));
        let spans: Vec<u32> = spans.flatten().collect();
        let samples = layout.deltas.len();
        layout.check(samples, samples, 1);
        let ends = spans.iter().max().copied().unwrap_or(0);
        assert!(ends as usize <= samples, "spans of a composite");
        let steps = [&layout.deltas[..], &layout.depths, &layout.distances].concat();
        Self {
            spans: Uploaded::u32(like, &spans),
            steps: Uploaded::f32(like, &steps),
            rays: layout.rays.len(),
            samples,
            depths: 1,
        }
    }

    /// # Panics
    /// If there are not as many densities and colours as samples.
    fn check(&self, sigma: &CubeTensor, colours: &CubeTensor) {
        let channels = colours.meta.shape()[1];
        assert_eq!(
            sigma.meta.num_elements(),
            self.samples,
            "densities of a composite"
        );
        let found = colours.meta.num_elements();
        assert_eq!(found, self.samples * channels, "colours of a composite");
    }
}

#[cube(launch_unchecked)]
fn forward_kernel(
    sigma: &[f32],
    colours: &[f32],
    spans: &[u32],
    steps: &[f32],
    out: &mut [f32],
    rays: u32,
    samples: u32,
    depths: u32,
    #[comptime] channels: usize,
) {
    let ray = ABSOLUTE_POS;
    if ray < rays as usize {
        let samples = samples as usize;
        let depths = depths as usize * samples;
        let at = ray * (channels + 3);
        let mut sums = Array::<f32>::new(channels);
        #[unroll]
        for c in 0..channels {
            sums[c] = 0.0;
        }
        let mut transmittance = 1.0f32;
        let mut depth = 0.0f32;
        let mut distortion = 0.0f32;
        let mut mass = 0.0f32;
        let mut moment = 0.0f32;
        for volume in 0..2usize {
            let start = spans[ray * 4 + volume * 2] as usize;
            let end = spans[ray * 4 + volume * 2 + 1] as usize;
            for i in start..end {
                let passed = f32::exp(-sigma[i] * steps[i]);
                let weight = (1.0 - passed) * transmittance;
                transmittance *= passed + TRANSMITTANCE_EPS;
                #[unroll]
                for c in 0..channels {
                    sums[c] += weight * colours[i * channels + c];
                }
                let s = steps[2 * samples + i];
                depth += weight * steps[depths + i];
                // Σ_ij w_i w_j |s_i − s_j| for sorted s, accumulated in one pass.
                distortion += 2.0 * weight * (s * mass - moment);
                mass += weight;
                moment += weight * s;
            }
        }
        #[unroll]
        for c in 0..channels {
            out[at + c] = sums[c];
        }
        out[at + channels] = mass;
        out[at + channels + 1] = depth;
        out[at + channels + 2] = distortion;
    }
}

/// See [`crate::cpu::composite::forward`].
///
/// # Panics
/// If there are not as many densities and colours as samples.
pub(crate) fn forward(
    layout: &DeviceLayout,
    sigma: &CubeTensor,
    colours: &CubeTensor,
) -> CubeTensor {
    layout.check(sigma, colours);
    let channels = colours.meta.shape()[1];
    let out = [layout.rays, CompositeLayout::outputs(channels)];
    if layout.samples == 0 || layout.rays == 0 {
        return zeros(sigma, out);
    }
    let out = empty(sigma, out);
    // SAFETY: units write their own ray; a layout's spans lie inside its samples, of which there
    // are as many as densities and colours.
    unsafe {
        forward_kernel::launch_unchecked(
            &sigma.client,
            cubes_for(layout.rays),
            cube(),
            argument(sigma),
            argument(colours),
            layout.spans.argument(),
            layout.steps.argument(),
            argument(&out),
            layout.rays as u32,
            layout.samples as u32,
            layout.depths,
            channels,
        );
    }
    out
}

/// Leaves in `reaching` what share of the light reaches each of a ray's samples; returns the sum of
/// their weights and of weight times distance.
#[cube]
fn sweep(
    sigma: &[f32],
    spans: &[u32],
    steps: &[f32],
    reaching: &mut [f32],
    ray: usize,
    samples: usize,
) -> (f32, f32) {
    let mut transmittance = 1.0f32;
    let mut mass = 0.0f32;
    let mut moment = 0.0f32;
    for volume in 0..2usize {
        let start = spans[ray * 4 + volume * 2] as usize;
        let end = spans[ray * 4 + volume * 2 + 1] as usize;
        for i in start..end {
            let passed = f32::exp(-sigma[i] * steps[i]);
            let weight = (1.0 - passed) * transmittance;
            reaching[i] = transmittance;
            transmittance *= passed + TRANSMITTANCE_EPS;
            mass += weight;
            moment += weight * steps[2 * samples + i];
        }
    }
    (mass, moment)
}

/// See [`crate::cpu::composite::learned`].
#[cube]
fn learned(contracted: f32, from: f32) -> f32 {
    let distance = contracted / f32::max(1.0 - contracted, 1e-6);
    let nearness = distance / f32::max(from, 1e-20);
    select(distance >= from, 1.0f32, nearness * nearness)
}

#[cube(launch_unchecked)]
fn backward_kernel(
    sigma: &[f32],
    colours: &[f32],
    spans: &[u32],
    steps: &[f32],
    grad: &[f32],
    sigma_grad: &mut [f32],
    colour_grad: &mut [f32],
    rays: u32,
    samples: u32,
    depths: u32,
    learned_from: f32,
    #[comptime] channels: usize,
) {
    let ray = ABSOLUTE_POS;
    if ray < rays as usize {
        let samples = samples as usize;
        let at = ray * (channels + 3);
        // What reaches a sample stands in its gradient's place until the way back has used it.
        let (mass, moment) = sweep(sigma, spans, steps, sigma_grad, ray, samples);
        let by_depth = grad[at + channels + 1];
        let by_distortion = grad[at + channels + 2];
        let mut mass_before = mass;
        let mut moment_before = moment;
        // dL/dT of the transmittance that leaves the sample, from far to near.
        let mut behind = 0.0f32;
        for turn in 0..2usize {
            let volume = 1 - turn;
            let start = spans[ray * 4 + volume * 2] as usize;
            let end = spans[ray * 4 + volume * 2 + 1] as usize;
            for back in 0..end - start {
                let i = end - 1 - back;
                let passed = f32::exp(-sigma[i] * steps[i]);
                let reaching = sigma_grad[i];
                let weight = (1.0 - passed) * reaching;
                let s = steps[2 * samples + i];
                let share = learned(s, learned_from);
                mass_before -= weight;
                moment_before -= weight * s;
                let mass_after = mass - mass_before - weight;
                let moment_after = moment - moment_before - weight * s;
                let spread = s * mass_before - moment_before + moment_after - s * mass_after;
                let mut weight_grad = grad[at + channels]
                    + by_depth * steps[depths as usize * samples + i]
                    + 2.0 * by_distortion * spread;
                #[unroll]
                for c in 0..channels {
                    let by_colour = grad[at + c];
                    weight_grad += by_colour * colours[i * channels + c];
                    colour_grad[i * channels + c] = by_colour * weight * share;
                }
                let alpha_grad = reaching * (weight_grad - behind);
                // A huge last step saturates e^(−σδ) at 0; 0 · 1e10 must stay 0.
                let slope = passed * steps[i];
                sigma_grad[i] = select(slope > 0.0, alpha_grad * slope * share, 0.0);
                behind = (1.0 - passed) * weight_grad + (passed + TRANSMITTANCE_EPS) * behind;
            }
        }
    }
}

/// See [`crate::cpu::composite::backward`] and, for `learned_from`, [`crate::cpu::composite::learned`].
/// Samples must not belong to two rays: they would get the gradient of one of them, by chance.
///
/// # Panics
/// If there are not as many densities and colours as samples.
pub(crate) fn backward(
    layout: &DeviceLayout,
    sigma: &CubeTensor,
    colours: &CubeTensor,
    grad: &CubeTensor,
    learned_from: f32,
) -> (CubeTensor, CubeTensor) {
    layout.check(sigma, colours);
    let channels = colours.meta.shape()[1];
    let sigma_grad = zeros(sigma, [layout.samples]);
    let colour_grad = zeros(sigma, [layout.samples, channels]);
    if layout.samples > 0 && layout.rays > 0 {
        // SAFETY: as of `forward`.
        unsafe {
            backward_kernel::launch_unchecked(
                &sigma.client,
                cubes_for(layout.rays),
                cube(),
                argument(sigma),
                argument(colours),
                layout.spans.argument(),
                layout.steps.argument(),
                argument(grad),
                argument(&sigma_grad),
                argument(&colour_grad),
                layout.rays as u32,
                layout.samples as u32,
                layout.depths,
                learned_from,
                channels,
            );
        }
    }
    (sigma_grad, colour_grad)
}
