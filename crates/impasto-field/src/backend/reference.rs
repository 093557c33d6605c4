//! The field by plain tensor operations, on any device: the slow, obvious twin of the other
//! backends, and the only one for frequency encodings and cascades.

use crate::appearance::Appearance;
use crate::backend::{Backend, BufferSpec};
use crate::config::{AppearanceConfig, SamplingConfig, Shading};
use crate::encoding::host;
use crate::field::{Field, FieldWeights};
use crate::grids::OccupancyGrids;
use crate::rays::RayBatch;
use crate::sampling::{Samples, hierarchical};
use crate::volrend::accumulate::{FeatureRows, accumulate};
use crate::volrend::gbuffer::GBuffer;
use crate::volrend::weights::{median_depth, pruned, visibility_mask};
use burn::tensor::Tensor;
use impasto_kernels::cpu::composite;
use impasto_kernels::device::is_cpu;
use std::sync::Arc;

/// Rays rendered together by one thread of a CPU: their features stay in its cache.
pub(crate) const CPU_RAYS: usize = 128;
/// Rays rendered together by a GPU, to keep all of it busy.
const GPU_RAYS: usize = 1 << 14;

/// A field with its weights and grids.
pub(crate) struct Reference<'a> {
    pub(crate) field: &'a Field,
    pub(crate) weights: &'a FieldWeights,
    pub(crate) grids: Option<&'a OccupancyGrids>,
}

/// Features and densities of samples.
#[derive(Debug, Clone)]
pub struct FieldValues {
    /// The samples.
    pub samples: Samples,
    /// FeatureRows of each volume, `[n, width]`, absent when no ray has a sample there.
    pub features: [Option<Tensor<2>>; 2],
    /// Density of each sample.
    pub density: Tensor<1>,
}

impl FieldValues {
    /// Weight of each sample in its ray.
    pub fn weights(&self) -> Vec<f32> {
        composite::weights(&self.samples.layout, &host(self.density.clone()))
    }

    /// All samples, for appearances of a configuration that is shaded at samples; gradients flow
    /// through.
    pub fn gbuffer(&self, config: &AppearanceConfig) -> GBuffer {
        GBuffer::of_samples(
            Arc::clone(&self.samples.layout),
            self.features.clone(),
            self.density.clone(),
            &self.samples.views,
            config,
        )
    }
}

impl Field {
    /// Features and densities of samples.
    pub fn evaluate(&self, weights: &FieldWeights, samples: Samples) -> FieldValues {
        let latent = weights.latent.as_ref();
        let positions = samples.outer.positions(4);
        let (outer, behind) = self.outer.evaluate(&weights.outer, latent, &positions);
        let (inner, density) = if samples.inner.is_empty() {
            (None, behind)
        } else {
            let positions = samples.inner.positions(3);
            let (inner, density) = self.inner.evaluate(&weights.inner, latent, &positions);
            (Some(inner), Tensor::cat(vec![density, behind], 0))
        };
        FieldValues {
            samples,
            features: [inner, Some(outer)],
            density,
        }
    }

    /// The cascade's second samples, given the densities of its first ones; the same samples where
    /// there is no cascade.
    pub fn resample(
        &self,
        rays: &RayBatch,
        first: Samples,
        densities: &[f32],
        seed: Option<u64>,
    ) -> Samples {
        match &self.config.sampling {
            SamplingConfig::Occupancy(_) => first,
            SamplingConfig::Hierarchical(config) => {
                hierarchical::refined(rays, &first, densities, config, seed)
            }
        }
    }
}

/// What the field says of samples, with what that makes of their rays.
pub(crate) struct WeightedValues {
    values: FieldValues,
    weights: Vec<f32>,
}

impl From<FieldValues> for WeightedValues {
    fn from(values: FieldValues) -> Self {
        Self {
            weights: values.weights(),
            values,
        }
    }
}

impl Backend for Reference<'_> {
    type Samples = Samples;
    type Evaluated = WeightedValues;
    type Shader = Appearance;

    fn rays_together(&self, most: usize) -> usize {
        if self.on_host() {
            CPU_RAYS
        } else {
            most.clamp(CPU_RAYS, GPU_RAYS)
        }
    }

    fn on_host(&self) -> bool {
        is_cpu(&self.weights.inner.encoding.device())
    }

    fn sample(&self, rays: &RayBatch, seed: Option<u64>) -> Samples {
        self.field.sample(rays, self.grids, seed)
    }

    fn evaluate(
        &self,
        rays: &RayBatch,
        samples: Samples,
        seed: Option<u64>,
    ) -> Vec<WeightedValues> {
        let Some(coarse) = &self.weights.coarse else {
            return vec![self.field.evaluate(self.weights, samples).into()];
        };
        let first = self.field.evaluate(coarse, samples.clone());
        let densities = host(first.density.clone());
        let samples = self.field.resample(rays, samples, &densities, seed);
        let fine = self.field.evaluate(self.weights, samples);
        vec![first.into(), fine.into()]
    }

    fn depth(&self, evaluated: &WeightedValues) -> Tensor<1> {
        let depth = median_depth(&evaluated.values.samples.layout, &evaluated.weights);
        Tensor::from_data(depth.as_slice(), &evaluated.values.density.device())
    }

    fn accumulate(&self, evaluated: &WeightedValues, spec: BufferSpec<'_>) -> GBuffer {
        let WeightedValues { values, weights } = evaluated;
        let samples = &values.samples;
        let device = values.density.device();
        if spec.config.shading == Shading::Samples {
            let keep = visibility_mask(&samples.layout, weights, spec.least_weight);
            return kept(values, &keep, spec.config);
        }
        let rows = values.features.each_ref().map(|features| {
            let rows = features.clone().map(host);
            (
                rows.unwrap_or_default(),
                features.as_ref().map_or(1, |f| f.dims()[1]),
            )
        });
        let features = rows.each_ref().map(|(rows, width)| FeatureRows {
            rows,
            width: *width,
        });
        let merged = accumulate(samples, features, weights);
        GBuffer::of_merged(merged, spec.ground, spec.rays, &device)
    }

    fn shader(&self, appearance: &Appearance) -> Appearance {
        appearance.clone()
    }

    fn shade(
        &self,
        evaluated: &WeightedValues,
        shader: &Appearance,
        least_weight: f32,
    ) -> Tensor<2> {
        let samples = &evaluated.values.samples;
        let keep = visibility_mask(&samples.layout, &evaluated.weights, least_weight);
        kept(&evaluated.values, &keep, &shader.config).shade(shader)
    }
}

/// Of samples that `keep` says, one flag per sample in layout order.
fn kept(values: &FieldValues, keep: &[bool], config: &AppearanceConfig) -> GBuffer {
    let FieldValues {
        samples,
        features,
        density,
    } = values;
    let views = &samples.views;
    if !keep.contains(&false) {
        return values.gbuffer(config);
    }
    let rows = |keep: &[bool]| {
        let kept = (0i32..).zip(keep).filter(|(_, keep)| **keep);
        let kept: Vec<i32> = kept.map(|(row, _)| row).collect();
        (!kept.is_empty()).then(|| Tensor::from_data(kept.as_slice(), &density.device()))
    };
    let (inner, outer) = keep.split_at(samples.inner.len());
    let kept = [(&features[0], inner), (&features[1], outer)]
        .map(|(features, keep)| Some(features.clone()?.select(0, rows(keep)?)));
    let density = match rows(keep) {
        Some(rows) => density.clone().select(0, rows),
        None => density.clone().slice_dim(0, 0..0),
    };
    let layout = Arc::new(pruned(&samples.layout, keep));
    GBuffer::of_samples(layout, kept, density, views, config)
}
