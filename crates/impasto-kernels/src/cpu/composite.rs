//! Volume compositing of packed samples (PAPER §3): inner samples first, then the outer volume's
//! behind them, one transmittance running through both.

use super::math::exp;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Kept under every factor of the transmittance, as in NeRF++.
pub(crate) const TRANSMITTANCE_EPS: f32 = 1e-6;

/// Share of a ray's light under which a volume's samples are left out where samples are merged.
pub const LEAST_SHARE: f32 = 2e-3;
/// Optical depth of a merged sample that lets nothing through, in single precision.
pub const OPAQUE: f32 = 20.0;

/// Which samples belong to one ray. Both ranges index the sample arrays; `outer` continues behind
/// `inner`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RaySpan {
    /// Samples of the inner volume, near to far.
    pub inner: Range<usize>,
    /// Samples of the outer volume, near to far.
    pub outer: Range<usize>,
}

/// The fixed part of a composite: everything that is not differentiated.
#[derive(Debug, Clone, Default)]
pub struct CompositeLayout {
    /// One span per ray.
    pub rays: Vec<RaySpan>,
    /// Step length of each sample (inner: along the ray; outer: in inverse radius).
    pub deltas: Vec<f32>,
    /// Depth of each sample, used for the expected depth.
    pub depths: Vec<f32>,
    /// Normalised distance in `[0, 1]` of each sample, used for the distortion measure
    /// (Barron et al. 2022, mip-NeRF 360, eq. 15).
    pub distances: Vec<f32>,
}

impl CompositeLayout {
    /// Numbers per ray in the output for `channels` colours: colours, opacity, expected depth,
    /// distortion.
    pub const fn outputs(channels: usize) -> usize {
        channels + 3
    }

    /// # Panics
    /// If there are not as many steps and colours as densities.
    pub(crate) fn check(&self, densities: usize, colours: usize, channels: usize) {
        assert_eq!(colours, densities * channels, "colours of a composite");
        for (name, values) in [
            ("deltas", &self.deltas),
            ("depths", &self.depths),
            ("distances", &self.distances),
        ] {
            assert_eq!(values.len(), densities, "{name} of a composite");
        }
    }

    /// All ranges that are not empty, from first to last sample, with their rays and sides.
    ///
    /// # Panics
    /// If a sample belongs to two rays.
    pub(crate) fn in_order(&self) -> Vec<(&Range<usize>, usize, usize)> {
        let rays = || self.rays.iter().enumerate();
        let inner = rays().map(|(ray, span)| (&span.inner, ray, 0));
        let outer = rays().map(|(ray, span)| (&span.outer, ray, 1));
        // Both halves ascend where samples were packed ray by ray: the sort is then one merge.
        let mut ranges: Vec<_> = inner
            .chain(outer)
            .filter(|(range, ..)| !range.is_empty())
            .collect();
        ranges.sort_by_key(|(range, ..)| range.start);
        for pair in ranges.windows(2) {
            assert!(
                pair[0].0.end <= pair[1].0.start,
                "a sample of a composite belongs to one ray"
            );
        }
        ranges
    }
}

impl RaySpan {
    /// All samples of the ray, near to far.
    pub fn samples(&self) -> impl DoubleEndedIterator<Item = usize> + use<> {
        self.inner.clone().chain(self.outer.clone())
    }
}

/// Share of light that each sample lets through, `e^(−σδ)`. What nearly nothing passes would lose
/// most of its digits as `1 − opacity`, and gradients with it.
pub(crate) fn transmittances(deltas: &[f32], sigma: &[f32]) -> Vec<f32> {
    struct Transmittances<'a>(&'a [f32], &'a [f32]);
    impl WithSimd for Transmittances<'_> {
        type Output = Vec<f32>;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> Vec<f32> {
            let pairs = self.0.iter().zip(self.1);
            pairs.map(|(delta, sigma)| exp(-sigma * delta)).collect()
        }
    }
    Arch::new().dispatch(Transmittances(deltas, sigma))
}

/// A sample's part in what its ray shows.
pub(crate) struct Step {
    pub(crate) index: usize,
    /// Share of light that it lets through.
    passed: f32,
    /// Share of light that reaches it.
    transmittance: f32,
    pub(crate) weight: f32,
}

/// Samples of a ray, near to far, each of which lets `passed` through.
#[inline(always)]
pub(crate) fn steps(
    samples: impl Iterator<Item = usize>,
    passed: &[f32],
) -> impl Iterator<Item = Step> {
    let mut reaching = 1.0;
    samples.map(move |index| {
        let (passed, transmittance) = (passed[index], reaching);
        reaching *= passed + TRANSMITTANCE_EPS;
        Step {
            index,
            passed,
            transmittance,
            weight: (1.0 - passed) * transmittance,
        }
    })
}

/// Weight of each sample, `(1 − e^(−σδ)) · T`.
///
/// # Shapes
/// `sigma`: one non-negative density per sample; result: one weight per sample.
pub fn weights(layout: &CompositeLayout, sigma: &[f32]) -> Vec<f32> {
    let mut weights = vec![0.0; sigma.len()];
    let passed = transmittances(&layout.deltas, sigma);
    for step in (layout.rays.iter()).flat_map(|span| steps(span.samples(), &passed)) {
        weights[step.index] = step.weight;
    }
    weights
}

/// Composites colours along each ray.
///
/// # Shapes
/// `sigma`: `n`, non-negative; `colours`: `n × channels`; result:
/// `rays × (channels + 3)` = colours, opacity, Σ w·depth, distortion.
///
/// # Panics
/// If a slice does not have its stated length.
pub fn forward(
    layout: &CompositeLayout,
    sigma: &[f32],
    colours: &[f32],
    channels: usize,
) -> Vec<f32> {
    layout.check(sigma.len(), colours.len(), channels);
    let width = CompositeLayout::outputs(channels);
    let mut out = vec![0.0; layout.rays.len() * width];
    let samples = ShadedSamples::new(layout, sigma, colours, channels);
    out.par_chunks_mut(width)
        .with_min_len(64)
        .zip(&layout.rays)
        .for_each(|(out, span)| samples.forward(span, out));
    out
}

/// Share of its gradient that a sample at a contracted distance `d / (1 + d)` gets: `(d / from)²` up
/// to 1. Near a camera space is sampled as much more densely, and by that camera alone: left to
/// itself, it explains its picture by specks in front of its lens (Philip & Deschaintre 2023,
/// "Floaters No More: Radiance Field Gradient Scaling for Improved Near-Camera Training").
///
/// With `from` 0, all of it everywhere.
#[inline(always)]
pub fn learned(contracted: f32, from: f32) -> f32 {
    let distance = contracted / (1.0 - contracted).max(1e-6);
    // Written so that 0 / 0 is a whole gradient.
    if distance >= from {
        1.0
    } else {
        (distance / from).powi(2)
    }
}

/// Samples with all that compositing needs of them.
pub(crate) struct ShadedSamples<'a> {
    layout: &'a CompositeLayout,
    passed: Vec<f32>,
    colours: &'a [f32],
    channels: usize,
    learned_from: f32,
}

impl<'a> ShadedSamples<'a> {
    pub(crate) fn new(
        layout: &'a CompositeLayout,
        sigma: &[f32],
        colours: &'a [f32],
        channels: usize,
    ) -> Self {
        Self {
            layout,
            passed: transmittances(&layout.deltas, sigma),
            colours,
            channels,
            learned_from: 0.0,
        }
    }

    /// The same with smaller gradients near the camera: see [`learned`].
    pub(crate) fn learned_from(self, learned_from: f32) -> Self {
        Self {
            learned_from,
            ..self
        }
    }

    /// Adds one ray's samples to `out`, zeros before.
    pub(crate) fn forward(&self, span: &RaySpan, out: &mut [f32]) {
        let (layout, channels) = (self.layout, self.channels);
        let (mut mass, mut moment) = (0.0f32, 0.0f32);
        for Step { index, weight, .. } in steps(span.samples(), &self.passed) {
            let colours = &self.colours[index * channels..][..channels];
            for (out, colour) in out.iter_mut().zip(colours) {
                *out += weight * colour;
            }
            let s = layout.distances[index];
            out[channels] += weight;
            out[channels + 1] += weight * layout.depths[index];
            // Σ_ij w_i w_j |s_i − s_j| for sorted s, accumulated in one pass.
            out[channels + 2] += 2.0 * weight * (s * mass - moment);
            mass += weight;
            moment += weight * s;
        }
    }

    /// Writes one ray's gradients; `all` is scratch.
    pub(crate) fn backward(
        &self,
        span: &RaySpan,
        grad: &[f32],
        all: &mut Vec<Step>,
        out: &mut [SpanGrads<'_>; 2],
    ) {
        let (layout, channels) = (self.layout, self.channels);
        all.clear();
        all.extend(steps(span.samples(), &self.passed));
        let (mut mass, mut moment) = (0.0f32, 0.0f32);
        for step in &*all {
            mass += step.weight;
            moment += step.weight * layout.distances[step.index];
        }
        let (colour_out, rest) = grad.split_at(channels);
        let (mut mass_before, mut moment_before) = (mass, moment);
        // dL/dT of the transmittance that leaves the sample, from far to near.
        let mut behind = 0.0f32;
        for (position, step) in all.iter().enumerate().rev() {
            let i = step.index;
            let (out, at) = match position.checked_sub(span.inner.len()) {
                None => (&mut out[0], position),
                Some(at) => (&mut out[1], at),
            };
            let s = layout.distances[i];
            let share = learned(s, self.learned_from);
            mass_before -= step.weight;
            moment_before -= step.weight * s;
            let mass_after = mass - mass_before - step.weight;
            let moment_after = moment - moment_before - step.weight * s;
            let spread = s * mass_before - moment_before + moment_after - s * mass_after;
            let mut weight_grad = rest[0] + rest[1] * layout.depths[i] + 2.0 * rest[2] * spread;
            let colours = self.colours[i * channels..].iter().zip(colour_out);
            let out_colours = &mut out.colours[at * channels..][..channels];
            for (to, (colour, grad)) in out_colours.iter_mut().zip(colours) {
                weight_grad += grad * colour;
                *to = grad * step.weight * share;
            }
            let alpha_grad = step.transmittance * (weight_grad - behind);
            let delta = layout.deltas[i];
            // A huge last step saturates e^(−σδ) at 0; 0 · 1e10 must stay 0.
            let slope = step.passed * delta;
            out.sigma[at] = if slope > 0.0 {
                alpha_grad * slope * share
            } else {
                0.0
            };
            behind = (1.0 - step.passed) * weight_grad + (step.passed + TRANSMITTANCE_EPS) * behind;
        }
    }
}

/// Gradients of [`forward`] for densities and colours; deltas, depths and distances are constants.
///
/// # Shapes
/// `grad`: `rays × (channels + 3)`; results: `n` and `n × channels`.
///
/// # Panics
/// If a slice does not have its stated length, or a sample belongs to two rays.
pub fn backward(
    layout: &CompositeLayout,
    sigma: &[f32],
    colours: &[f32],
    channels: usize,
    grad: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    layout.check(sigma.len(), colours.len(), channels);
    let width = CompositeLayout::outputs(channels);
    assert_eq!(
        grad.len(),
        layout.rays.len() * width,
        "gradient of a composite"
    );
    let mut sigma_grad = vec![0.0; sigma.len()];
    let mut colour_grad = vec![0.0; colours.len()];
    let samples = ShadedSamples::new(layout, sigma, colours, channels);
    split_by_ray(layout, &mut sigma_grad, &mut colour_grad, channels)
        .par_iter_mut()
        .zip(&layout.rays)
        .zip(grad.par_chunks_exact(width))
        .with_min_len(64)
        .for_each_init(Vec::new, |steps, ((out, span), grad)| {
            samples.backward(span, grad, steps, out);
        });
    (sigma_grad, colour_grad)
}

/// The parts of the gradient arrays that belong to one span of samples.
#[derive(Default)]
pub(crate) struct SpanGrads<'a> {
    pub(crate) sigma: &'a mut [f32],
    pub(crate) colours: &'a mut [f32],
}

/// Cuts the gradient arrays into each ray's inner and outer part.
fn split_by_ray<'a>(
    layout: &CompositeLayout,
    mut sigma: &'a mut [f32],
    mut colours: &'a mut [f32],
    channels: usize,
) -> Vec<[SpanGrads<'a>; 2]> {
    let mut split = Vec::new();
    split.resize_with(layout.rays.len(), <[SpanGrads<'a>; 2]>::default);
    let mut end = 0;
    for (range, ray, side) in layout.in_order() {
        let gap = range.start - end;
        let (own_sigma, rest_sigma) = sigma.split_at_mut(gap).1.split_at_mut(range.len());
        let (own_colours, rest_colours) = colours
            .split_at_mut(gap * channels)
            .1
            .split_at_mut(range.len() * channels);
        split[ray][side] = SpanGrads {
            sigma: own_sigma,
            colours: own_colours,
        };
        (sigma, colours, end) = (rest_sigma, rest_colours, range.end);
    }
    split
}
