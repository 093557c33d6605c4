//! The field on a CPU, with no tensors between its layers, for fields of hash grids sampled by
//! density grids: what the default preset trains.

use crate::appearance::Appearance;
use crate::backend::reference::CPU_RAYS;
use crate::backend::{Backend, BufferSpec};
use crate::branch::{Branch, BranchWeights};
use crate::config::Shading;
use crate::encoding::{frequencies, host, matrix};
use crate::field::{Field, FieldWeights};
use crate::grids::OccupancyGrids;
use crate::rays::RayBatch;
use crate::sampling::Samples;
use crate::sampling::occupancy::OccupancySampler;
use crate::volrend::accumulate::{FeatureRows, accumulate};
use crate::volrend::gbuffer::GBuffer;
use crate::volrend::weights::{median_depth, pruned, visibility_mask};
use burn::tensor::{Device, Tensor};
use impasto_kernels::cpu::composite;
use impasto_kernels::cpu::passes::{GeometryPass, ShadingPass, ShadingSamples};
use impasto_kernels::ops::OnHost;
use impasto_kernels::{HashGridSpec, MlpSpec, OccupancySpec};
use std::sync::Arc;

/// A field's weights in the CPU's memory.
pub(crate) struct CpuWeights {
    volumes: [VolumeWeights; 2],
    device: Device,
}

struct VolumeWeights {
    grid: HashGridSpec,
    encoding: OnHost,
    base: OnHost,
    geo: OnHost,
}

impl CpuWeights {
    /// `None` if some of it is on no CPU or not made of a hash grid, or a cascade says where samples
    /// are.
    pub(crate) fn of(field: &Field, weights: &FieldWeights) -> Option<Self> {
        field.config.occupancy()?;
        let latent = weights.latent.as_ref();
        let volume = |branch: &Branch, own: &BranchWeights| {
            Some(VolumeWeights {
                grid: branch.hash_grid()?,
                encoding: OnHost::of(&own.encoding)?,
                base: OnHost::of(&branch.folded(own, latent))?,
                geo: OnHost::of(&own.geo)?,
            })
        };
        Some(Self {
            volumes: [
                volume(&field.inner, &weights.inner)?,
                volume(&field.outer, &weights.outer)?,
            ],
            device: weights.inner.encoding.device(),
        })
    }
}

/// What rays go through.
pub(crate) struct Cpu<'a> {
    field: &'a Field,
    spec: &'a OccupancySpec,
    grids: &'a OccupancyGrids,
    geometry: [GeometryPass<'a>; 2],
    device: &'a Device,
}

impl<'a> Cpu<'a> {
    /// `None` if a cascade says where samples are.
    pub(crate) fn new(
        field: &'a Field,
        weights: &'a CpuWeights,
        grids: &'a OccupancyGrids,
    ) -> Option<Self> {
        let pass = |branch: &'a Branch, own: &'a VolumeWeights| {
            let (base, geo, density) = branch.layers();
            let grid = (own.grid, &*own.encoding);
            GeometryPass::new(grid, (base, &own.base), (geo, &own.geo), density)
        };
        let [inner, outer] = &weights.volumes;
        Some(Self {
            spec: field.config.occupancy()?,
            geometry: [pass(&field.inner, inner), pass(&field.outer, outer)],
            device: &weights.device,
            grids,
            field,
        })
    }
}

/// Features, densities and weights of samples.
pub(crate) struct CpuValues {
    samples: Samples,
    features: [Vec<f32>; 2],
    densities: Vec<f32>,
    weights: Vec<f32>,
}

/// `app` of both volumes.
pub(crate) struct CpuShader {
    app: [(MlpSpec, Vec<f32>); 2],
    bands: Option<usize>,
}

impl Backend for Cpu<'_> {
    type Samples = Samples;
    type Evaluated = CpuValues;
    type Shader = CpuShader;

    fn rays_together(&self, _: usize) -> usize {
        CPU_RAYS
    }

    fn on_host(&self) -> bool {
        true
    }

    fn sample(&self, rays: &RayBatch, seed: Option<u64>) -> Samples {
        OccupancySampler::new(self.spec, self.grids, seed).few(rays)
    }

    fn evaluate(&self, _: &RayBatch, samples: Samples, _: Option<u64>) -> Vec<CpuValues> {
        let (inner, mut densities) = self.geometry[0].run(&samples.inner.cube);
        let (outer, behind) = self.geometry[1].run(&samples.outer.cube);
        densities.extend(behind);
        vec![CpuValues {
            weights: composite::weights(&samples.layout, &densities),
            features: [inner, outer],
            densities,
            samples,
        }]
    }

    fn depth(&self, evaluated: &CpuValues) -> Tensor<1> {
        let depth = median_depth(&evaluated.samples.layout, &evaluated.weights);
        Tensor::from_data(depth.as_slice(), self.device)
    }

    fn accumulate(&self, evaluated: &CpuValues, spec: BufferSpec<'_>) -> GBuffer {
        let samples = &evaluated.samples;
        let widths = self.field.features();
        if spec.config.shading == Shading::Samples {
            let keep = visibility_mask(&samples.layout, &evaluated.weights, spec.least_weight);
            return self.kept(evaluated, &keep, spec);
        }
        let features = [0, 1].map(|v| FeatureRows {
            rows: &evaluated.features[v],
            width: widths[v],
        });
        let merged = accumulate(samples, features, &evaluated.weights);
        GBuffer::of_merged(merged, spec.ground, spec.rays, self.device)
    }

    fn shader(&self, appearance: &Appearance) -> CpuShader {
        let app = |branch: &Branch, weights: &Tensor<1>| {
            let network = appearance.config.network(branch.features());
            let weights = network.folded(weights, appearance.latent.as_ref());
            (network.chain().clone(), host(weights))
        };
        CpuShader {
            app: [
                app(&self.field.inner, &appearance.inner),
                app(&self.field.outer, &appearance.outer),
            ],
            bands: appearance.config.app.view_bands,
        }
    }

    fn shade(&self, evaluated: &CpuValues, shader: &CpuShader, least_weight: f32) -> Tensor<2> {
        let layout = &*evaluated.samples.layout;
        let app = shader
            .app
            .each_ref()
            .map(|(spec, weights)| (spec, &weights[..]));
        let encoded = |bands| frequencies(&evaluated.samples.views, 3, bands);
        let [inner, outer] = &evaluated.features;
        let colours = ShadingPass::new(app, self.field.features()).run(&ShadingSamples {
            layout,
            densities: &evaluated.densities,
            features: [inner, outer],
            keep: &visibility_mask(layout, &evaluated.weights, least_weight),
            views: &shader.bands.map_or_else(Vec::new, encoded),
        });
        matrix(colours, 3, self.device)
    }
}

impl Cpu<'_> {
    /// Of samples that `keep` says, one flag per sample in layout order.
    fn kept(&self, evaluated: &CpuValues, keep: &[bool], spec: BufferSpec<'_>) -> GBuffer {
        let samples = &evaluated.samples;
        let (inner, outer) = keep.split_at(samples.inner.len());
        let widths = self.field.features();
        let features = [inner, outer].into_iter().enumerate().map(|(v, keep)| {
            let rows = evaluated.features[v].chunks_exact(widths[v]).zip(keep);
            let kept = rows.filter(|(_, keep)| **keep).flat_map(|(row, _)| row);
            let kept: Vec<f32> = kept.copied().collect();
            (!kept.is_empty()).then(|| matrix(kept, widths[v], self.device))
        });
        let features: Vec<_> = features.collect();
        let densities = evaluated.densities.iter().zip(keep);
        let densities = densities
            .filter(|(_, keep)| **keep)
            .map(|(density, _)| *density);
        GBuffer::of_samples(
            Arc::new(pruned(&samples.layout, keep)),
            [features[0].clone(), features[1].clone()],
            Tensor::from_data(&densities.collect::<Vec<f32>>()[..], self.device),
            &samples.views,
            spec.config,
        )
    }
}
