//! The one ray renderer: samples → features and density → colours → pixels.

use crate::appearance::{Appearance, AppearanceConfig, Shading, shade};
use crate::field::{Field, FieldWeights, Grids};
use crate::sampling::{RayBatch, Samples, march};
use burn::tensor::Tensor;
use impasto_kernels::cpu::composite;
use impasto_kernels::{CompositeLayout, RaySpan, ops};
use std::sync::Arc;

/// The numbers of a tensor, in row-major order.
pub fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    // Every tensor of this program is f32; a conversion only fails for a lost device.
    tensor.try_into_vec_as::<f32>().unwrap_or_default()
}

/// Everything about a batch of rays that does not depend on the style.
#[derive(Debug, Clone)]
pub struct Geometry {
    pub(crate) samples: Samples,
    pub(crate) layout: Arc<CompositeLayout>,
    /// Features of the inner volume, absent when no ray has a sample there.
    pub(crate) inner: Option<Tensor<2>>,
    pub(crate) outer: Tensor<2>,
    pub(crate) density: Tensor<1>,
}

impl Geometry {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.samples.len()
    }

    /// The fixed part of the composite.
    pub fn layout(&self) -> &CompositeLayout {
        &self.layout
    }

    /// The same as constants of an autodiff graph, for training `app` on frozen geometry.
    pub fn lifted(self) -> Self {
        Self {
            inner: self.inner.map(Tensor::from_inner),
            outer: Tensor::from_inner(self.outer),
            density: Tensor::from_inner(self.density),
            ..self
        }
    }

    /// Contribution of each sample to its ray.
    pub fn weights(&self) -> Vec<f32> {
        composite::weights(&self.layout, &host(self.density.clone()))
    }

    /// Depth along the camera's axis at which half of a ray's light has been gathered.
    pub fn median_depth(&self) -> Vec<f32> {
        let weights = self.weights();
        self.layout
            .rays
            .iter()
            .map(|span| {
                let mut sum = 0.0;
                let mut all = span.inner.clone().chain(span.outer.clone());
                let crossing = all.find(|i| {
                    sum += weights[*i];
                    sum >= 0.5
                });
                crossing.map_or(f32::INFINITY, |i| self.layout.depths[i])
            })
            .collect()
    }
}

/// What light does along marched rays.
#[derive(Debug, Clone)]
pub struct Light {
    /// Contribution of each sample to its ray; zero where no light arrives.
    pub weights: Vec<f32>,
    /// Whether light arrives at each sample.
    pub lit: Vec<bool>,
}

/// Most of a ray's light that leaving out small contributions may move to the background.
const MOST_DROPPED: f32 = 0.02;
/// Ends of the waves in which a ray's samples are looked at, front to back.
const WAVES: [usize; 3] = [16, 48, usize::MAX];

impl Field {
    /// Follows the light front to back and stops where less than `least` of it is left, so that
    /// nothing behind a surface is evaluated. No gradients.
    pub fn light(&self, weights: &FieldWeights, samples: &Samples, least: f32) -> Light {
        let layout = &samples.layout;
        let mut light = Light {
            weights: vec![0.0; samples.len()],
            lit: vec![false; samples.len()],
        };
        let mut density = vec![0.0; samples.len()];
        let mut transmittance = vec![1.0f32; layout.rays.len()];
        let mut start = 0;
        for end in WAVES {
            let mut wave = vec![false; samples.len()];
            let mut any = false;
            for (span, _) in layout
                .rays
                .iter()
                .zip(&transmittance)
                .filter(|(_, t)| **t >= least)
            {
                for i in along(span, start, end) {
                    wave[i] = true;
                    any = true;
                }
            }
            if !any {
                break;
            }
            let subset = samples.pruned(&wave);
            let numbers = self.densities(weights, &subset);
            let indices = wave.iter().enumerate().filter(|(_, w)| **w).map(|(i, _)| i);
            for (i, d) in indices.zip(numbers) {
                density[i] = d;
            }
            for (span, t) in layout
                .rays
                .iter()
                .zip(&mut transmittance)
                .filter(|(_, t)| **t >= least)
            {
                for i in along(span, start, end) {
                    light.lit[i] = *t >= least;
                    let passed = (-density[i] * layout.deltas[i]).exp();
                    light.weights[i] = *t * (1.0 - passed);
                    *t *= passed;
                }
            }
            start = end;
        }
        light
    }

    /// Densities of samples, inner first.
    fn densities(&self, weights: &FieldWeights, samples: &Samples) -> Vec<f32> {
        let mut all = Vec::with_capacity(samples.len());
        let volumes = [
            (&self.inner, &weights.inner, &samples.inner),
            (&self.outer, &weights.outer, &samples.outer),
        ];
        for (branch, weights, samples) in volumes {
            if !samples.is_empty() {
                let positions = samples.positions(branch.dimensions());
                all.extend(host(branch.geometry(weights, &positions).1));
            }
        }
        all
    }

    /// The samples that contribute at least `least` of the light, and the farthest of each ray. Of
    /// a ray whose smaller samples add up to more than 2 % of the light, as haze does, all those
    /// that contribute a tenth of `least` are kept.
    pub fn contributing(&self, weights: &FieldWeights, samples: &Samples, least: f32) -> Samples {
        let light = self.light(weights, samples, least);
        let mut keep: Vec<bool> = light.weights.iter().map(|w| *w >= least).collect();
        for span in &samples.layout.rays {
            let small = |i: &usize| light.weights[*i] < least;
            let dropped: f32 = along(span, 0, usize::MAX)
                .filter(small)
                .map(|i| light.weights[i])
                .sum();
            if dropped > MOST_DROPPED {
                for i in along(span, 0, usize::MAX) {
                    keep[i] = light.weights[i] >= 0.1 * least;
                }
            }
        }
        keep_farthest(samples, &mut keep);
        samples.pruned(&keep)
    }

    /// The samples that at least `least` of the light reaches, and the farthest of each ray. What
    /// lies behind a surface can be left out of a training step: nothing in front of it changes
    /// its colour.
    pub fn reached(&self, weights: &FieldWeights, samples: &Samples, least: f32) -> Samples {
        let mut keep = self.light(weights, samples, least).lit;
        keep_farthest(samples, &mut keep);
        samples.pruned(&keep)
    }

    /// Marches rays through the grids; see [`march`].
    pub fn sample(&self, rays: &RayBatch, grids: &Grids, seed: Option<u64>) -> Samples {
        march(rays, &self.config.sampling, grids, seed)
    }

    /// The same with steps `coarseness` times as long, for a field that has not formed yet.
    pub fn sample_coarsely(
        &self,
        rays: &RayBatch,
        grids: &Grids,
        seed: u64,
        coarseness: f32,
    ) -> Samples {
        let mut sampling = self.config.sampling.clone();
        sampling.inner_step *= coarseness;
        sampling.outer_steps = ((sampling.outer_steps as f32 / coarseness) as usize).max(1);
        march(rays, &sampling, grids, Some(seed))
    }

    /// Features and densities of samples.
    pub fn geometry(&self, weights: &FieldWeights, samples: Samples) -> Geometry {
        let (outer, outer_density) = self
            .outer
            .geometry(&weights.outer, &samples.outer.positions(4));
        let (inner, density) = if samples.inner.is_empty() {
            (None, outer_density)
        } else {
            let (features, density) = self
                .inner
                .geometry(&weights.inner, &samples.inner.positions(3));
            (Some(features), Tensor::cat(vec![density, outer_density], 0))
        };
        Geometry {
            layout: Arc::new(samples.layout.clone()),
            samples,
            inner,
            outer,
            density,
        }
    }
}

impl Geometry {
    /// What an appearance of this configuration is shaded on.
    pub fn prepared(self, config: &AppearanceConfig) -> Self {
        match config.shading {
            Shading::Samples => self,
            Shading::Surface => self.merged(),
        }
    }

    /// Colours every sample with `appearance` and composites. The geometry must be
    /// [`Self::prepared`] for it.
    ///
    /// # Shapes
    /// Result: `[rays, 6]` = RGB, opacity, Σ weight·depth, distortion.
    pub fn composite(&self, appearance: &Appearance) -> Tensor<2> {
        let canvas = appearance.canvas.as_ref();
        let colour = |features: &Tensor<2>, outer: bool| {
            let (samples, dimensions, weights) = if outer {
                (&self.samples.outer, 4, &appearance.outer)
            } else {
                (&self.samples.inner, 3, &appearance.inner)
            };
            let canvas = canvas.map(|c| if outer { &c.outer } else { &c.inner });
            let inputs = (&samples.positions(dimensions), samples.views.as_slice());
            shade(
                &appearance.config,
                weights,
                canvas,
                features.clone(),
                inputs,
            )
        };
        let outer = colour(&self.outer, true);
        let colours = match &self.inner {
            Some(features) => Tensor::cat(vec![colour(features, false), outer], 0),
            None => outer,
        };
        ops::composite(self.density.clone(), colours, Arc::clone(&self.layout))
    }
}

/// A ray's samples from the `start`th to before the `end`th, near to far.
fn along(span: &RaySpan, start: usize, end: usize) -> impl Iterator<Item = usize> + use<> {
    span.inner
        .clone()
        .chain(span.outer.clone())
        .skip(start)
        .take(end - start)
}

/// The composite needs the sample that everything infinitely far belongs to.
fn keep_farthest(samples: &Samples, keep: &mut [bool]) {
    for span in &samples.layout.rays {
        keep[span.outer.end - 1] = true;
    }
}

/// What rendering rays yields on the host.
#[derive(Debug, Clone)]
pub struct RenderedRays {
    /// Per appearance, `rays × 3` colours in `[0, 1]`.
    pub colours: Vec<Vec<f32>>,
    /// Median depth per ray, along the camera's axis, scene units.
    pub depth: Vec<f32>,
}

/// Samples with less weight than this are not shaded when rendering.
const SHADE_LEAST: f32 = 1e-3;
/// Rays rendered together: their features stay well under 100 MB.
const RENDER_CHUNK: usize = 4096;

/// Renders rays without gradients; geometry is computed once for all appearances.
pub fn render_rays(
    field: &Field,
    weights: &FieldWeights,
    grids: &Grids,
    appearances: &[&Appearance],
    rays: &RayBatch,
) -> RenderedRays {
    let mut out = RenderedRays {
        colours: vec![Vec::with_capacity(rays.len() * 3); appearances.len()],
        depth: Vec::with_capacity(rays.len()),
    };
    for start in (0..rays.len()).step_by(RENDER_CHUNK) {
        let end = (start + RENDER_CHUNK).min(rays.len());
        let chunk = RayBatch {
            origins: rays.origins[start..end].to_vec(),
            directions: rays.directions[start..end].to_vec(),
        };
        let samples = field.contributing(weights, &field.sample(&chunk, grids, None), SHADE_LEAST);
        let geometry = field.geometry(weights, samples);
        out.depth.extend(geometry.median_depth());
        let surface = appearances
            .iter()
            .any(|a| a.config.shading == Shading::Surface)
            .then(|| geometry.clone().merged());
        for (colours, appearance) in out.colours.iter_mut().zip(appearances) {
            let geometry = match (appearance.config.shading, &surface) {
                (Shading::Surface, Some(surface)) => surface,
                _ => &geometry,
            };
            let pixels = host(geometry.composite(appearance));
            for pixel in pixels.chunks_exact(CompositeLayout::outputs(3)) {
                colours.extend(pixel[..3].iter().map(|c| c.clamp(0.0, 1.0)));
            }
        }
    }
    out
}
