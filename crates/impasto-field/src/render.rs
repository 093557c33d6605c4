//! The one ray renderer: samples → features and density → colours → pixels.

use crate::appearance::{Appearance, shade};
use crate::field::{Field, FieldWeights, Grids};
use crate::sampling::{RayBatch, Samples, march};
use burn::tensor::{Int, Tensor, TensorData};
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
    samples: Samples,
    layout: Arc<CompositeLayout>,
    /// Features of the inner volume, absent when no ray has a sample there.
    inner: Option<Tensor<2>>,
    outer: Tensor<2>,
    density: Tensor<1>,
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

    /// The samples that light reaches: those whose transmittance from the camera is at least
    /// `least`, and the farthest of each ray. What lies behind a surface can be left out of a
    /// training step, because nothing in front of it changes its colour.
    pub fn lit_samples(self, least: f32) -> Samples {
        let density = host(self.density);
        let mut keep = vec![true; density.len()];
        for span in &self.layout.rays {
            let mut optical_depth = 0.0;
            for i in span.inner.clone().chain(span.outer.clone()) {
                keep[i] = optical_depth <= -least.ln();
                optical_depth += density[i] * self.layout.deltas[i];
            }
            keep[span.outer.end - 1] = true;
        }
        self.samples.pruned(&keep).0
    }

    /// Drops samples that contribute less than `least`; the farthest of each ray stays. Only for
    /// geometry outside of an autodiff graph.
    pub fn pruned(self, least: f32) -> Self {
        let mut keep: Vec<bool> = self.weights().iter().map(|w| *w >= least).collect();
        for span in &self.layout.rays {
            keep[span.outer.end - 1] = true;
        }
        let (samples, inner, outer) = self.samples.pruned(&keep);
        let device = self.outer.device();
        let index = |indices: Vec<usize>| {
            let indices: Vec<i32> = indices.into_iter().map(|i| i as i32).collect();
            let length = indices.len();
            Tensor::<1, Int>::from_data(TensorData::new(indices, [length]), &device)
        };
        let split = self.samples.inner.len();
        let all = inner.iter().copied().chain(outer.iter().map(|i| i + split)).collect();
        let density = self.density.select(0, index(all));
        Self {
            inner: match self.inner {
                Some(features) if !inner.is_empty() => Some(features.select(0, index(inner))),
                _ => None,
            },
            outer: self.outer.select(0, index(outer)),
            density,
            layout: Arc::new(samples.layout.clone()),
            samples,
        }
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

impl Field {
    /// Marches rays through the grids; see [`march`].
    pub fn sample(&self, rays: &RayBatch, grids: &Grids, seed: Option<u64>) -> Samples {
        march(rays, &self.config.sampling, grids, seed)
    }

    /// The same with steps `coarseness` times as long, for a field that has not formed yet.
    pub fn sample_coarsely(&self, rays: &RayBatch, grids: &Grids, seed: u64, coarseness: f32) -> Samples {
        let mut sampling = self.config.sampling.clone();
        sampling.inner_step *= coarseness;
        sampling.outer_steps = ((sampling.outer_steps as f32 / coarseness) as usize).max(1);
        march(rays, &sampling, grids, Some(seed))
    }

    /// Features and densities of samples.
    pub fn geometry(&self, weights: &FieldWeights, samples: Samples) -> Geometry {
        let (outer, outer_density) = self.outer.geometry(&weights.outer, &samples.outer.positions(4));
        let (inner, density) = if samples.inner.is_empty() {
            (None, outer_density)
        } else {
            let (features, density) = self.inner.geometry(&weights.inner, &samples.inner.positions(3));
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
    /// Colours every sample with `appearance` and composites.
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
            shade(&appearance.config, weights, canvas, features.clone(), inputs)
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
        let geometry = field.geometry(weights, field.sample(&chunk, grids, None)).pruned(SHADE_LEAST);
        out.depth.extend(geometry.median_depth());
        for (colours, appearance) in out.colours.iter_mut().zip(appearances) {
            let pixels = host(geometry.composite(appearance));
            for pixel in pixels.chunks_exact(CompositeLayout::outputs(3)) {
                colours.extend(pixel[..3].iter().map(|c| c.clamp(0.0, 1.0)));
            }
        }
    }
    out
}
