//! A field in training on a GPU, from which nothing comes back but what is asked for.

use crate::appearance::Appearance;
use crate::backend::gpu::{encoded_views, field_spec, volumes};
use crate::branch::BranchWeights;
use crate::config::{AppearanceConfig, Shading};
use crate::field::{Field, FieldWeights, RadianceField};
use crate::grids::{DENSE, OccupancyGrids, VisibleCells};
use crate::rays::{RayBatch, contracted_distance, jitter};
use crate::training::RayTargets;
use burn::tensor::{Device, Tensor};
use impasto_kernels::gpu::{self, DensityGrids, FieldSpec, Rays, Targets};
use impasto_kernels::sampling::least_weight;
use impasto_kernels::{OccupancySpec, Volume};

/// A field in training on a GPU.
#[derive(Debug)]
pub struct GpuTraining {
    spec: FieldSpec,
    grids: DensityGrids,
    sampling: OccupancySpec,
    app: AppearanceConfig,
}

/// What one step found.
#[derive(Debug, Clone)]
pub struct GpuDescent {
    /// The loss and its mean squared difference of colours, `[2]`.
    pub loss: Tensor<1>,
    /// Gradients, in the place of parameters.
    pub gradients: RadianceField,
}

impl GpuTraining {
    /// `None` if the field, with an `app` on its samples, cannot stay on the device.
    pub fn new(
        field: &Field,
        app: &AppearanceConfig,
        grids: &OccupancyGrids,
        visible: &VisibleCells,
        device: &Device,
    ) -> Option<Self> {
        // Gradients are of plain layers, at samples.
        let plain = !app.app.remap && app.latent.is_none() && app.shading == Shading::Samples;
        let spec = field_spec(field, app, device).filter(|_| plain)?;
        let flags = [&visible.inner[..], &visible.outer];
        Some(Self {
            spec,
            grids: DensityGrids::new([&grids.inner, &grids.outer], Some(flags), device),
            sampling: field.config.occupancy()?.clone(),
            app: app.clone(),
        })
    }

    /// What [`OccupancyGrids::update`] does.
    pub fn update_grids(&self, weights: &FieldWeights, shares: [f32; 2], seed: u32) {
        // What comes before `app` does not need its weights.
        let none = &weights.inner.geo;
        let sides = [self.sampling.inner_grid, self.sampling.outer_grid];
        let dense = sides.map(|side| DENSE * side as f32);
        let weights = volumes(weights, [none, none]);
        self.grids
            .update(&self.spec, &weights, (shares, dense), seed);
    }

    /// The loss of rays, as [`Field::loss`] gives it, and its gradients; grids take note of the
    /// densities. `surfaces` are distances of surfaces that are known on some of the rays, from
    /// which depths are measured; directions have any length.
    pub fn descend(
        &self,
        level: &RadianceField,
        rays: &RayBatch,
        surfaces: &[Option<f32>],
        targets: RayTargets,
        seed: u64,
    ) -> GpuDescent {
        let mut uploaded = Rays::default();
        let pairs = rays.origins.iter().zip(&rays.directions).zip(surfaces);
        for (ray, ((origin, direction), surface)) in pairs.enumerate() {
            let surface = surface.map(contracted_distance);
            uploaded.push(*origin, *direction, jitter(Some(seed), ray), surface);
        }
        let least = least_weight(Some(seed));
        let samples = self.grids.march(&uploaded, &self.sampling, least);
        let targets = Targets {
            views: encoded_views(&samples.directions(), &self.app.app),
            colours: targets.colours,
            depth: targets.depth,
            distortion: targets.distortion,
        };
        let weights = volumes(&level.weights, [&level.app.inner, &level.app.outer]);
        let descent = gpu::descend(&self.spec, &samples, &weights, &targets);
        self.grids.observe(&samples, &descent.densities);
        GpuDescent {
            loss: descent.loss,
            gradients: gradients(&self.app, descent.gradients),
        }
    }

    /// The grids as they are now; `None` if the device is lost.
    pub fn grids(&self) -> Option<OccupancyGrids> {
        let [inner, outer] = self.grids.read();
        Some(OccupancyGrids::new(inner?, outer?))
    }
}

fn gradients(app: &AppearanceConfig, volumes: [Volume<Tensor<1>>; 2]) -> RadianceField {
    let [inner, outer] = volumes;
    let branch = |encoding, base, geo| BranchWeights {
        encoding,
        base,
        geo,
    };
    let app = Appearance {
        config: app.clone(),
        inner: inner.app,
        outer: outer.app,
        canvas: None,
        latent: None,
    };
    let weights = FieldWeights {
        latent: None,
        inner: branch(inner.encoded, inner.base, inner.geo),
        outer: branch(outer.encoded, outer.base, outer.geo),
        coarse: None,
    };
    RadianceField { weights, app }
}
