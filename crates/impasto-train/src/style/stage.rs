//! Paintings → hypernetwork (PAPER §6–8). Geometry is frozen: samples, weights and features
//! depend on the camera only.

use crate::geometry::{PhotoRays, TrainedGeometry};
use crate::optimizer::{Adam, Rate};
use crate::paintings::{Style, StyleSet};
use crate::readback::ReadbackSchedule;
use crate::style::chunks::loss_of;
use crate::style::objective::{Objective, StyleReport};
use crate::style::patches::{FrozenPatch, PatchPool, PoolProgress};
use burn::tensor::Device;
use impasto_field::{Field, Ground, Parameters, Renderer};
use impasto_kernels::device::is_cpu;
use impasto_model::tensors::{Entry, TensorReader};
use impasto_model::{Clock, CodeNormalisation, PaintingInputs, StyleModel, TrainConfig};
use impasto_style::{Perceptual, StyleError, StyleVae};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// What a checkpoint keeps of the stage beside its tensors.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct StyleProgress {
    rng: Pcg64,
    updates: u64,
    pools: Vec<PoolProgress>,
    /// Of each parameter.
    adam: Vec<u32>,
}

/// Hypernetworks in training.
pub struct StyleStage {
    config: TrainConfig,
    /// Of every scene.
    patches: Vec<PatchPool>,
    styles: StyleSet,
    vae: StyleVae,
    vgg: Perceptual,
    params: Adam<StyleModel>,
    rng: Pcg64,
    device: Device,
    /// Updates so far.
    updates: u64,
    /// When a GPU's losses are read back, and what was last read.
    readback: ReadbackSchedule,
    reported: StyleReport,
}

/// The networks of a style stage.
pub struct StyleNetworks {
    /// The perceptual network.
    pub vgg: Perceptual,
    /// The encoder of styles.
    pub vae: StyleVae,
    /// What to go on from; without, random weights.
    pub first: Option<StyleModel>,
}

impl StyleStage {
    /// Prepares training on frozen geometry.
    ///
    /// # Panics
    /// In [`Self::step`], if there is no photo or no style.
    pub fn new(
        config: &TrainConfig,
        geometry: TrainedGeometry,
        photos: Vec<PhotoRays>,
        networks: StyleNetworks,
        styles: StyleSet,
        seed: u64,
        device: &Device,
    ) -> Self {
        let app = config.style_appearance();
        let TrainedGeometry {
            radiance,
            grids,
            features,
        } = geometry;
        let ground = Ground {
            photo: radiance.app.clone(),
            features,
        };
        let field = Field::new(config.field.clone());
        let renderer = Renderer::open(field, radiance.weights, grids, ground, &app);
        let pool = PatchPool::new(&config.style, app, renderer, radiance.app, photos);
        Self::over(config, vec![pool], networks, styles, seed, device)
    }

    /// Prepares training on patches of several scenes.
    pub(crate) fn over(
        config: &TrainConfig,
        patches: Vec<PatchPool>,
        networks: StyleNetworks,
        styles: StyleSet,
        seed: u64,
        device: &Device,
    ) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed ^ 0x57_79_6c_65);
        let field = Field::new(config.field.clone());
        let first = networks.first.unwrap_or_else(|| {
            let codes = match config.style.pictures.canonical {
                true => styles.code_normalisation(&networks.vae),
                false => CodeNormalisation::none(),
            };
            let random = StyleModel::init(&field, config, &mut rng, device);
            StyleModel { codes, ..random }
        });
        Self {
            patches,
            config: config.clone(),
            styles,
            vae: networks.vae,
            vgg: networks.vgg,
            params: Adam::new(&first),
            rng,
            device: device.clone(),
            updates: 0,
            readback: ReadbackSchedule::new(),
            reported: StyleReport::default(),
        }
    }

    /// Paintings and crops of them that are learned from.
    pub(crate) fn styles(&self) -> usize {
        self.styles.len()
    }

    /// The current hypernetworks.
    pub fn snapshot(&self) -> StyleModel {
        self.params.values()
    }

    /// All that [`Self::restore`] needs to go on as if nothing had been.
    pub(crate) fn progress(&self) -> (StyleProgress, Vec<Entry>) {
        let (adam, entries) = self.params.entries("");
        let progress = StyleProgress {
            rng: self.rng.clone(),
            updates: self.updates,
            pools: self.patches.iter().map(PatchPool::progress).collect(),
            adam,
        };
        (progress, entries)
    }

    /// Goes on where a stage of the same field, photos, paintings and settings was.
    pub(crate) fn restore(
        &mut self,
        progress: &StyleProgress,
        from: &TensorReader<'_>,
    ) -> Result<(), String> {
        self.params.restore("", &progress.adam, from)?;
        for (pool, progress) in self.patches.iter_mut().zip(&progress.pools) {
            let filled = pool.restore(progress, &self.vgg);
            filled.map_err(|e| e.to_string())?;
        }
        self.rng = progress.rng.clone();
        self.updates = progress.updates;
        Ok(())
    }

    /// One optimiser step: one patch, one style.
    ///
    /// # Errors
    /// If a photo is smaller than a patch, or the patch too small for the perceptual network.
    pub fn step(&mut self, clock: &Clock) -> Result<StyleReport, StyleError> {
        let style = self.draw_style(self.config.style.virtual_share);
        let scene = self.rng.random_range(0..self.patches.len());
        let patch = self.patches[scene].draw(&self.vgg, &mut self.rng)?;
        self.descend(scene, &patch, &style, clock)
    }

    /// A painting, or a mix of two.
    fn draw_style(&mut self, virtual_share: f32) -> Style {
        let one = self.rng.random_range(0..self.styles.len());
        let other = (self.rng.random::<f32>() < virtual_share).then(|| {
            let other = self.rng.random_range(0..self.styles.len());
            (other, self.rng.random())
        });
        self.styles.style(&self.vae, one, other)
    }

    fn descend(
        &mut self,
        scene: usize,
        patch: &FrozenPatch,
        style: &Style,
        clock: &Clock,
    ) -> Result<StyleReport, StyleError> {
        let model = self.params.leaves();
        let tracked = self.device.clone().autodiff();
        let palette = self.patches[scene].colors().palette_of(&style.colors);
        let inputs = PaintingInputs {
            code: &style.code,
            exemplar: &style.exemplar,
            palette,
        };
        let appearances = model.appearances(&self.config, &inputs, &tracked);
        self.updates += 1;
        let read = self.readback.due() || is_cpu(&self.device);
        let mut report = StyleReport {
            rays: patch.rays(),
            ..self.reported
        };
        let objective = Objective {
            settings: &self.config.style,
            vgg: &self.vgg,
            patches: &self.patches[scene],
        };
        let styled = self.updates > self.config.style.style_loss_start;
        // Every level has a loss of its own; the field's, which is rendered, is the last.
        let losses = patch.levels.iter().zip(&appearances);
        let losses = losses.map(|(parts, appearance)| {
            loss_of(parts, appearance, |colours| {
                let losses = objective.losses(colours, patch, &style.target, palette, styled)?;
                if read {
                    report = losses.report(patch.rays());
                }
                Ok(losses.total)
            })
        });
        let losses = losses.collect::<Result<Vec<_>, StyleError>>()?.into_iter();
        let Some(total) = losses.reduce(|sum, loss| sum + loss) else {
            return Ok(report);
        };
        let mut gradients = total.backward();
        let leaves = model.named().into_iter();
        let gradients: Vec<_> = leaves
            .map(|(_, leaf)| leaf.grad_remove(&mut gradients))
            .collect();
        self.reported = report;
        if read {
            self.readback.done();
        }
        // Adam works in place only on what nobody else holds.
        drop((model, appearances));
        let rate = Rate::dense(self.rate(clock));
        self.params.step(gradients, |_| rate);
        Ok(report)
    }

    /// The learning rate for the current update.
    fn rate(&self, clock: &Clock) -> f32 {
        let settings = &self.config.style;
        let warm = (self.updates as f32 / settings.lr_warmup_steps.max(1) as f32).min(1.0);
        settings.rate * settings.final_rate.powf(clock.progress() as f32) * warm
    }
}
