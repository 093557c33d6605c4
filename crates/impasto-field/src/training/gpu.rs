//! A field in training on a GPU, from which nothing comes back but what is asked for.

use super::step::{LossWeights, StepGradients, TargetRays};
use crate::appearance::Appearance;
use crate::backend::gpu::{encoded_views, field_spec, volumes};
use crate::branch::BranchWeights;
use crate::config::{AppearanceConfig, Shading};
use crate::field::{Field, FieldWeights, RadianceField};
use crate::grids::{DENSE, OccupancyGrids, VisibleCells};
use crate::parameters::Parameters;
use crate::rays::{contracted_distance, jitter};
use burn::tensor::{Device, Tensor};
use impasto_kernels::gpu::{self, DensityGrids, FieldSpec, Rays, Targets};
use impasto_kernels::sampling::least_weight;
use impasto_kernels::{OccupancySpec, Volume};

/// A field in training on a GPU.
pub(crate) struct GpuTraining {
    spec: FieldSpec,
    grids: DensityGrids,
    sampling: OccupancySpec,
    app: AppearanceConfig,
}

impl GpuTraining {
    /// `None` if the field, with an `app` on its samples, cannot stay on the device.
    pub(crate) fn new(
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
    pub(crate) fn update_grids(&self, weights: &FieldWeights, shares: [f32; 2], seed: u32) {
        // What comes before `app` does not need its weights.
        let none = &weights.inner.geo;
        let sides = [self.sampling.inner_grid, self.sampling.outer_grid];
        let dense = sides.map(|side| DENSE * side as f32);
        let weights = volumes(weights, [none, none]);
        self.grids
            .update(&self.spec, &weights, (shares, dense), seed);
    }

    /// What [`super::FieldTraining::descend`] finds for a field that is one level.
    pub(crate) fn descend(
        &self,
        level: &RadianceField,
        seen: &TargetRays,
        weights: LossWeights,
        seed: u64,
    ) -> StepGradients {
        let mut uploaded = Rays::default();
        let rays = seen.rays.origins.iter().zip(&seen.rays.directions);
        for (ray, ((origin, direction), surface)) in rays.zip(&seen.distances).enumerate() {
            let surface = surface.map(contracted_distance);
            uploaded.push(*origin, *direction, jitter(Some(seed), ray), surface);
        }
        let least = least_weight(Some(seed));
        let samples = self.grids.march(&uploaded, &self.sampling, least);
        let targets = Targets {
            views: encoded_views(&samples.directions(), &self.app.app),
            colours: seen.colours.clone(),
            depth: weights.surface,
            distortion: weights.distortion,
            learned_from: weights.learned_from,
        };
        let weights = volumes(&level.weights, [&level.app.inner, &level.app.outer]);
        let found = gpu::descend(&self.spec, &samples, &weights, &targets);
        self.grids.observe(&samples, &found.densities);
        let gradients = gradients(&self.app, found.gradients).named().into_iter();
        StepGradients {
            error: found.loss.slice_dim(0, 1..2),
            gradients: vec![gradients.map(|(_, gradient)| Some(gradient)).collect()],
        }
    }

    /// The grids as they are now; `None` if the device is lost.
    pub(crate) fn grids(&self) -> Option<OccupancyGrids> {
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
        paint: None,
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
