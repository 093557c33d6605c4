//! The field on a GPU, where everything stays there: rays in, G-buffers or pixels out. For fields of
//! hash grids sampled by density grids, which is what the default preset trains.

use crate::appearance::Appearance;
use crate::backend::{Backend, BufferSpec};
use crate::branch::{Branch, BranchWeights};
use crate::config::{AppConfig, AppearanceConfig, Shading};
use crate::encoding::frequencies_of;
use crate::field::{Field, FieldWeights};
use crate::grids::OccupancyGrids;
use crate::rays::{RayBatch, jitter};
use crate::volrend::gbuffer::{GBuffer, MergedSurface};
use burn::tensor::{Device, Tensor};
use impasto_kernels::gpu::{
    self, DensityGrids, FieldSamples, FieldSpec, MergedSamples, RaySamples, Rays, surface_layout,
};
use impasto_kernels::sampling::least_weight;
use impasto_kernels::{OccupancySpec, Volume, VolumeSpec, device::is_cpu};
use std::sync::Arc;

/// Most numbers of a tensor: 128 MiB, the largest buffer that a Vulkan device must be able to bind.
const MOST_NUMBERS: usize = 1 << 25;

/// Networks of a field with an appearance, if all can stay on a device.
pub(crate) fn field_spec(
    field: &Field,
    config: &AppearanceConfig,
    device: &Device,
) -> Option<FieldSpec> {
    field.config.occupancy()?;
    if is_cpu(device) || field.config.latent.is_some() {
        return None;
    }
    let volume = |branch: &Branch| branch.volume_spec(&config.network(branch.features()));
    let spec = FieldSpec {
        grids: [field.inner.hash_grid()?, field.outer.hash_grid()?],
        volumes: [volume(&field.inner), volume(&field.outer)],
    };
    spec.fits().then_some(spec)
}

/// Weights in the order of a volume's numbers, hash tables in the place of encodings.
pub(crate) fn volumes(weights: &FieldWeights, apps: [&Tensor<1>; 2]) -> [Volume<Tensor<1>>; 2] {
    let volume = |own: &BranchWeights, app: &Tensor<1>| Volume {
        encoded: own.encoding.clone(),
        base: own.base.clone(),
        geo: own.geo.clone(),
        app: app.clone(),
    };
    [
        volume(&weights.inner, apps[0]),
        volume(&weights.outer, apps[1]),
    ]
}

/// Encoded views of rays for an `app`.
pub(crate) fn encoded_views(directions: &Tensor<2>, app: &AppConfig) -> Option<Tensor<2>> {
    let bands = app.view_bands?;
    Some(frequencies_of(directions, bands))
}

/// What is kept on the device between calls.
pub(crate) struct GpuField {
    spec: FieldSpec,
    grids: DensityGrids,
    /// Most numbers of a sample in one tensor, whatever shades it.
    widest: usize,
}

impl GpuField {
    /// `None` if some of it cannot stay on the device; of the appearances, all but the first have to
    /// be shaded on surfaces.
    pub(crate) fn of(
        field: &Field,
        weights: &FieldWeights,
        grids: &OccupancyGrids,
        apps: [&AppearanceConfig; 2],
    ) -> Option<Self> {
        let device = weights.inner.encoding.device();
        if apps[1].shading == Shading::Samples {
            return None;
        }
        let spec = field_spec(field, apps[0], &device)?;
        let painter = apps[1].network(0);
        let layers = painter.layers().map(|layer| layer.inputs);
        Some(Self {
            widest: layers.fold(spec.widest(), usize::max),
            grids: DensityGrids::new([&grids.inner, &grids.outer], None, &device),
            spec,
        })
    }
}

/// What rays go through.
pub(crate) struct Gpu<'a> {
    field: &'a Field,
    sampling: &'a OccupancySpec,
    gpu: &'a GpuField,
    volumes: [Volume<Tensor<1>>; 2],
}

impl<'a> Gpu<'a> {
    /// `None` if a cascade says where samples are.
    pub(crate) fn new(field: &'a Field, weights: &FieldWeights, gpu: &'a GpuField) -> Option<Self> {
        // What comes before `app` does not need its weights.
        let none = Tensor::zeros([1], &weights.inner.encoding.device());
        Some(Self {
            sampling: field.config.occupancy()?,
            volumes: volumes(weights, [&none, &none]),
            field,
            gpu,
        })
    }
}

/// Features and densities of samples, and what they are merged to.
pub(crate) struct GpuValues {
    samples: FieldSamples,
    merged: MergedSamples,
    directions: Tensor<2>,
}

/// `app` of both volumes.
pub(crate) struct GpuShader {
    volumes: [VolumeSpec; 2],
    apps: [Tensor<1>; 2],
    app: AppConfig,
}

impl Backend for Gpu<'_> {
    type Samples = RaySamples;
    type Evaluated = GpuValues;
    type Shader = GpuShader;

    /// As many as every device has room for, which keeps a large one busy.
    fn rays_together(&self, most: usize) -> usize {
        let room = MOST_NUMBERS / self.gpu.widest / self.sampling.samples.max(1);
        most.clamp(1, room.max(1))
    }

    fn on_host(&self) -> bool {
        false
    }

    fn sample(&self, rays: &RayBatch, seed: Option<u64>) -> RaySamples {
        let mut uploaded = Rays::default();
        for (ray, (origin, direction)) in rays.origins.iter().zip(&rays.directions).enumerate() {
            uploaded.push(*origin, *direction, jitter(seed, ray), None);
        }
        self.gpu
            .grids
            .march(&uploaded, self.sampling, least_weight(seed))
    }

    fn evaluate(&self, _: &RayBatch, samples: RaySamples, _: Option<u64>) -> Vec<GpuValues> {
        let directions = samples.directions();
        let samples = gpu::evaluate(&self.gpu.spec, samples, &self.volumes);
        vec![GpuValues {
            merged: samples.accumulate(),
            samples,
            directions,
        }]
    }

    fn depth(&self, evaluated: &GpuValues) -> Tensor<1> {
        evaluated.merged.depth.clone()
    }

    fn accumulate(&self, evaluated: &GpuValues, spec: BufferSpec<'_>) -> GBuffer {
        let (merged, directions) = (&evaluated.merged, &evaluated.directions);
        let [count, _] = directions.dims();
        let (rays, views) = ((0..count).collect::<Vec<_>>(), spec.rays.views());
        let volume = |v: usize| {
            let surface = MergedSurface {
                features: merged.features[v].clone(),
                points: merged.points[v].clone(),
                stretch: merged.footprint[v].clone(),
                rays: &rays,
                outer: v == 1,
            };
            Some(surface.painted(spec.ground, spec.rays, &views))
        };
        GBuffer {
            layout: Arc::new(surface_layout(count)),
            volumes: [volume(0), volume(1)],
            density: merged.density.clone(),
        }
    }

    fn shader(&self, appearance: &Appearance) -> GpuShader {
        let (field, config) = (self.field, &appearance.config);
        let latent = appearance.latent.as_ref();
        let branches = [
            (&field.inner, &appearance.inner),
            (&field.outer, &appearance.outer),
        ];
        GpuShader {
            volumes: branches.map(|(b, _)| b.volume_spec(&config.network(b.features()))),
            apps: branches.map(|(b, weights)| config.network(b.features()).folded(weights, latent)),
            app: config.app.clone(),
        }
    }

    /// Shades all samples: leaving some out would cost more than it saves.
    fn shade(&self, evaluated: &GpuValues, shader: &GpuShader, _: f32) -> Tensor<2> {
        let views = encoded_views(&evaluated.directions, &shader.app);
        evaluated
            .samples
            .composite(&shader.volumes, shader.apps.clone(), views)
    }
}
