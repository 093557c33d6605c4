//! A field in training (PAPER §4): where its samples go, the loss of rays and its gradients.

#[cfg(feature = "gpu")]
mod gpu;
mod loss;
mod step;

pub use step::{BatchSize, LossWeights, StepGradients, TargetRays};

use crate::config::AppearanceConfig;
use crate::encoding::host;
use crate::field::{Field, FieldWeights, RadianceField};
use crate::grids::{OccupancyGrids, VisibleCells};
use crate::parameters::Parameters;
use crate::sampling::Samples;
use burn::tensor::{Device, Tensor};
#[cfg(feature = "gpu")]
use gpu::GpuTraining;
use loss::measure_from_surfaces;
use rand_pcg::Pcg64;
use std::borrow::Cow;
use std::sync::Arc;

/// Share of a grid's cells queried, at each update: of all, and of those that hold something.
const GRID_SHARES: [f32; 2] = [0.03, 0.2];
/// Density that grids start from: none is known better than any other.
const FIRST_DENSITY: f32 = 1.0;
/// How many times as many rays a step a GPU gets: fewer do not keep it busy. A guess.
#[cfg(feature = "gpu")]
const GPU_RAYS: usize = 8;

/// A field in training, without its weights: what learns along with them, and where.
pub struct FieldTraining {
    field: Field,
    /// Of the colours of the photos.
    #[cfg(feature = "gpu")]
    app: AppearanceConfig,
    /// Where samples go by density grids.
    occupancy: Option<Occupancy>,
    batch: BatchSize,
    #[cfg(feature = "gpu")]
    gpu: Option<GpuTraining>,
}

struct Occupancy {
    /// While a GPU trains on its own, what there was before.
    grids: OccupancyGrids,
    visible: VisibleCells,
}

impl FieldTraining {
    /// A field whose colours of the photos have the configuration `app`; `sees` says where in space
    /// any photo looks, as [`VisibleCells::new`] asks.
    pub fn new(
        field: Field,
        app: &AppearanceConfig,
        sees: impl Fn([f32; 4]) -> bool + Sync,
        batch: BatchSize,
        device: &Device,
    ) -> Self {
        #[cfg(not(feature = "gpu"))]
        let _ = app;
        let occupancy = field.config.occupancy().map(|spec| {
            let visible = VisibleCells::new(spec, sees);
            let grids = OccupancyGrids::uniform(spec, FIRST_DENSITY).only(&visible);
            Occupancy { grids, visible }
        });
        let mut training = Self {
            field,
            #[cfg(feature = "gpu")]
            app: app.clone(),
            occupancy,
            batch,
            #[cfg(feature = "gpu")]
            gpu: None,
        };
        training.open_gpu(device);
        training
    }

    /// Lets a GPU train on its own, where there is one that can.
    #[cfg_attr(
        not(feature = "gpu"),
        allow(clippy::unused_self, reason = "there is no GPU")
    )]
    fn open_gpu(&mut self, _device: &Device) {
        #[cfg(feature = "gpu")]
        {
            // More rays than may be evaluated together are a matter for the host.
            let fits = self.rays_of(self.batch.samples * GPU_RAYS) <= self.batch.rays_at_once;
            self.gpu = self
                .occupancy
                .as_ref()
                .filter(|_| fits)
                .and_then(|occupancy| {
                    let Occupancy { grids, visible } = occupancy;
                    GpuTraining::new(&self.field, &self.app, grids, visible, _device)
                });
        }
    }

    /// The field's sizes.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Rays of one step.
    pub fn rays_of_step(&self) -> usize {
        #[cfg(feature = "gpu")]
        if self.gpu.is_some() {
            return self.rays_of(self.batch.samples * GPU_RAYS);
        }
        self.rays_of(self.batch.samples)
    }

    /// Rays that have about so many samples.
    fn rays_of(&self, samples: usize) -> usize {
        let [fewest, most] = self.batch.rays;
        (samples / self.field.config.samples().max(1)).clamp(fewest, most)
    }

    /// Whether a descent's numbers are at hand at once, and not a wait for a GPU away.
    pub fn on_host(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.gpu.is_none();
        #[cfg(not(feature = "gpu"))]
        true
    }

    /// Density grids, where samples go by those.
    pub fn grids(&self) -> Option<OccupancyGrids> {
        #[cfg(feature = "gpu")]
        if let Some(grids) = self.gpu.as_ref().and_then(GpuTraining::grids) {
            return Some(grids);
        }
        self.occupancy
            .as_ref()
            .map(|occupancy| occupancy.grids.clone())
    }

    /// Goes on with other density grids; nothing where samples do not go by any.
    pub fn set_grids(&mut self, grids: OccupancyGrids, device: &Device) {
        if let Some(occupancy) = &mut self.occupancy {
            occupancy.grids = grids;
        }
        self.open_gpu(device);
    }

    /// Evaluates the field at some random places and updates density grids, where there are any.
    pub fn update_grids(&mut self, weights: &FieldWeights, rng: &mut Pcg64) {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            gpu.update_grids(weights, GRID_SHARES, rand::RngExt::random(rng));
            return;
        }
        if let Some(Occupancy { grids, visible }) = &mut self.occupancy {
            grids.update(&self.field, weights, visible, GRID_SHARES, rng);
        }
    }

    /// The loss of rays against what was seen along them, at random places by a seed, and its
    /// gradients for all levels: the field itself, after the first field of a cascade. Density grids
    /// take note of the densities found.
    pub fn descend(
        &mut self,
        levels: &[RadianceField],
        targets: &TargetRays,
        weights: LossWeights,
        seed: u64,
    ) -> StepGradients {
        #[cfg(feature = "gpu")]
        if let (Some(gpu), [level]) = (&self.gpu, levels) {
            return gpu.descend(level, targets, weights, seed);
        }
        let grids = self.occupancy.as_ref().map(|occupancy| &occupancy.grids);
        let mut samples = self.field.sample(&targets.rays, grids, Some(seed));
        let (mut gradients, mut error) = (Vec::new(), 0.0);
        for (level, radiance) in levels.iter().enumerate() {
            let last = level + 1 == levels.len();
            let depths = (!last).then(|| Arc::clone(&samples.layout));
            measure_from_surfaces(&mut samples, &targets.distances);
            let found = self.descend_level(radiance, &samples, targets, weights);
            gradients.push(found.gradients);
            error = found.error;
            let densities = found.densities.concat();
            if let Some(Occupancy { grids, .. }) = &mut self.occupancy {
                grids.observe(&samples, &densities);
            }
            if let Some(depths) = depths {
                samples.layout = depths;
                let rays = &targets.rays;
                samples = self.field.resample(rays, samples, &densities, Some(seed));
            }
        }
        StepGradients {
            error: Tensor::from_data([error], &Device::flex()),
            gradients,
        }
    }

    /// One level, chunk by chunk.
    fn descend_level(
        &self,
        level: &RadianceField,
        samples: &Samples,
        targets: &TargetRays,
        weights: LossWeights,
    ) -> Found {
        let leaves = level.map(|_, tensor| Tensor::from_inner(tensor.clone()).require_grad());
        let named = leaves.named();
        let mut found = Found {
            error: 0.0,
            densities: [Vec::new(), Vec::new()],
            gradients: vec![None; named.len()],
        };
        let all = targets.rays.len();
        for start in (0..all).step_by(self.batch.rays_at_once) {
            let rays = start..(start + self.batch.rays_at_once).min(all);
            let share = rays.len() as f32 / all as f32;
            let part = if rays.len() == all {
                Cow::Borrowed(samples)
            } else {
                Cow::Owned(samples.of_rays(rays.clone()))
            };
            let colours = targets.colours[rays.start * 3..rays.end * 3].to_vec();
            let loss = self.field.loss(&leaves, &part, colours, weights);
            found.add(&host(loss.clone().inner()), part.inner.len(), share);
            let loss = loss.slice_dim(0, 0..1);
            let loss = if share < 1.0 { loss * share } else { loss };
            let mut own = loss.backward();
            for (sum, (_, leaf)) in found.gradients.iter_mut().zip(&named) {
                *sum = match (sum.take(), leaf.grad_remove(&mut own)) {
                    (Some(sum), Some(own)) => Some(sum + own),
                    (sum, own) => sum.or(own),
                };
            }
        }
        found
    }
}

/// What a level's step found.
struct Found {
    /// Mean squared error of colours.
    error: f32,
    /// Densities of both volumes' samples.
    densities: [Vec<f32>; 2],
    gradients: Vec<Option<Tensor<1>>>,
}

impl Found {
    /// Adds the loss of some rays, `share` of all, of which the first `inner` densities belong to
    /// the inner volume.
    fn add(&mut self, loss: &[f32], inner: usize, share: f32) {
        self.error += loss[1] * share;
        let (near, far) = loss[2..].split_at(inner);
        self.densities[0].extend(near);
        self.densities[1].extend(far);
    }
}
