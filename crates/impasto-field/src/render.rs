//! The one ray renderer: samples → features and density → colours → pixels.

use crate::appearance::{Appearance, AppearanceConfig, Shading, shade};
use crate::encoding::matrix;
use crate::field::{Field, FieldWeights, Grids};
use crate::sampling::{RayBatch, Samples, march};
use burn::tensor::Tensor;
use impasto_kernels::cpu::composite;
use impasto_kernels::{CompositeLayout, ops};
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

    /// Density of each sample.
    pub fn densities(&self) -> Tensor<1> {
        self.density.clone()
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

/// Most of a ray's light that leaving out small contributions may move to the background.
const MOST_DROPPED: f32 = 0.02;

impl Field {
    /// Marches rays through the grids; see [`march`].
    pub fn sample(&self, rays: &RayBatch, grids: &Grids, seed: Option<u64>) -> Samples {
        march(rays, &self.config.sampling, grids, seed)
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
    /// Only the samples that contribute at least `least` of a ray's light, and the farthest of
    /// each ray. Of a ray whose smaller samples add up to more than 2 % of the light, as haze
    /// does, all those that contribute a tenth of `least` are kept. No gradients.
    pub fn contributing(&self, least: f32) -> Self {
        let weights = self.weights();
        let mut keep: Vec<bool> = weights.iter().map(|w| *w >= least).collect();
        for span in &self.layout.rays {
            let all = || span.inner.clone().chain(span.outer.clone());
            let small = all().map(|i| weights[i]).filter(|w| *w < least);
            if small.sum::<f32>() > MOST_DROPPED {
                all().for_each(|i| keep[i] = weights[i] >= 0.1 * least);
            }
            // The composite needs the sample that everything infinitely far belongs to.
            keep[span.outer.end - 1] = true;
        }
        let samples = self.samples.pruned(&keep);
        let split = self.samples.inner.len();
        let device = self.outer.device();
        let rows = |features: &Tensor<2>, keep: &[bool]| {
            let width = features.dims()[1];
            let rows = host(features.clone());
            let kept = rows.chunks_exact(width).zip(keep).filter(|(_, k)| **k);
            matrix(
                kept.flat_map(|(row, _)| row).copied().collect(),
                width,
                &device,
            )
        };
        let densities = host(self.density.clone());
        let kept = densities.iter().zip(&keep).filter(|(_, k)| **k);
        let density: Vec<f32> = kept.map(|(d, _)| *d).collect();
        Self {
            inner: match (&self.inner, samples.inner.is_empty()) {
                (Some(features), false) => Some(rows(features, &keep[..split])),
                _ => None,
            },
            outer: rows(&self.outer, &keep[split..]),
            density: Tensor::from_data(density.as_slice(), &device),
            layout: Arc::new(samples.layout.clone()),
            samples,
        }
    }

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
        let geometry = field.geometry(weights, field.sample(&chunk, grids, None));
        out.depth.extend(geometry.median_depth());
        let needs = |shading| appearances.iter().any(|a| a.config.shading == shading);
        let samples = needs(Shading::Samples).then(|| geometry.contributing(SHADE_LEAST));
        let surface = needs(Shading::Surface).then(|| geometry.clone().merged());
        for (colours, appearance) in out.colours.iter_mut().zip(appearances) {
            let prepared = match appearance.config.shading {
                Shading::Samples => &samples,
                Shading::Surface => &surface,
            };
            let geometry = prepared.as_ref().unwrap_or(&geometry);
            let pixels = host(geometry.composite(appearance));
            for pixel in pixels.chunks_exact(CompositeLayout::outputs(3)) {
                colours.extend(pixel[..3].iter().map(|c| c.clamp(0.0, 1.0)));
            }
        }
    }
    out
}
