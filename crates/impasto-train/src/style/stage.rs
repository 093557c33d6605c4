//! Paintings → hypernetwork (PAPER §6–8). Geometry is frozen: samples, weights and features
//! depend on the camera only.

use crate::geometry::{PhotoRays, TrainedGeometry};
use crate::optimizer::{Adam, Rate};
use crate::paintings::{Style, StyleSet};
use crate::readback::ReadbackSchedule;
use crate::style::chunks::loss_of;
use crate::style::objective::{Losses, Objective, StyleReport, difference};
use crate::style::patches::{FrozenPatch, PatchPool, PoolProgress};
use burn::tensor::{Device, Tensor};
use impasto_field::{Field, Parameters, Renderer};
use impasto_kernels::device::is_cpu;
use impasto_model::tensors::{Entry, TensorReader};
use impasto_model::{Clock, StyleModel, TrainConfig};
use impasto_style::{Perceptual, StyleError, StyleVae};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// What a checkpoint keeps of the stage beside its tensors.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct StyleProgress {
    rng: Pcg64,
    updates: u64,
    pool: PoolProgress,
    /// Of each parameter.
    adam: Vec<u32>,
}

/// Hypernetworks in training.
pub struct StyleStage {
    config: TrainConfig,
    patches: PatchPool,
    styles: StyleSet,
    vae: StyleVae,
    vgg: Perceptual,
    params: Adam<StyleModel>,
    rng: Pcg64,
    device: Device,
    /// Updates with perceptual losses so far.
    updates: u64,
    /// When a GPU's losses are read back, and what was last read.
    readback: ReadbackSchedule,
    reported: StyleReport,
}

/// What paintings are measured with.
pub struct StyleNetworks {
    /// The perceptual network.
    pub vgg: Perceptual,
    /// The encoder of styles.
    pub vae: StyleVae,
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
        let mut rng = Pcg64::seed_from_u64(seed ^ 0x57_79_6c_65);
        let field = Field::new(config.field.clone());
        let params = Adam::new(&StyleModel::init(&field, config, &mut rng, device));
        let apps = [config.photo_appearance(), config.style_appearance()];
        let TrainedGeometry { radiance, grids } = geometry;
        let renderer = Renderer::open(field, radiance.weights, grids, apps.each_ref());
        let [_, app] = apps;
        let patches = PatchPool::new(&config.style, app, renderer, radiance.app, photos);
        Self {
            patches,
            config: config.clone(),
            styles,
            vae: networks.vae,
            vgg: networks.vgg,
            params,
            rng,
            device: device.clone(),
            updates: 0,
            readback: ReadbackSchedule::new(),
            reported: StyleReport::default(),
        }
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
            pool: self.patches.progress(),
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
        let filled = self.patches.restore(&progress.pool, &self.vgg);
        filled.map_err(|e| e.to_string())?;
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
        let patch = self.patches.draw(&self.vgg, &mut self.rng)?;
        Ok(self.descend(&patch, &style, clock))
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

    fn descend(&mut self, patch: &FrozenPatch, style: &Style, clock: &Clock) -> StyleReport {
        let model = self.params.leaves();
        let tracked = self.device.clone().autodiff();
        let appearances = model.appearances(&self.config, &style.code, &tracked);
        let palette = clock.progress() < f64::from(self.config.style.palette_share);
        if !palette {
            if self.updates == 0 {
                // Useless for perceptual losses, whose gradients are thousands of times larger.
                self.params.forget();
            }
            self.updates += 1;
        }
        let read = self.readback.due() || is_cpu(&self.device);
        let mut report = StyleReport {
            rays: patch.rays(),
            ..self.reported
        };
        // Every level has a loss of its own; the field's, which is rendered, is the last.
        let losses = patch.levels.iter().zip(&appearances);
        let losses = losses.map(|(parts, appearance)| {
            loss_of(parts, appearance, |colours| {
                let losses = self.losses(colours, patch, style, palette);
                if read {
                    report = losses.report(patch.rays());
                }
                losses.total
            })
        });
        let Some(total) = losses.reduce(|sum, loss| sum + loss) else {
            return report;
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
        let (hyper, canvas) = self.rates(clock);
        self.params
            .step(gradients, |name| Rate::of_look(name, canvas, hyper));
        report
    }

    /// What a patch's colours should be: the photo in the painting's colours at first, then like the
    /// painting.
    fn losses(
        &self,
        colours: Tensor<2>,
        patch: &FrozenPatch,
        style: &Style,
        palette: bool,
    ) -> Losses {
        if palette {
            return self.palette_loss(colours, patch, style);
        }
        let objective = Objective {
            settings: &self.config.style,
            vgg: &self.vgg,
            patches: &self.patches,
        };
        let styled = self.updates > self.config.style.style_loss_start;
        objective.losses(colours, patch, &style.target, styled)
    }

    /// Squared difference to the photo in the painting's colours.
    fn palette_loss(&self, rays: Tensor<2>, patch: &FrozenPatch, style: &Style) -> Losses {
        let colours = self.patches.averaged(rays);
        let transfer = self.patches.colors().transfer_to(&style.colors);
        Losses {
            total: difference(colours, transfer.applied(patch.pixels.clone())),
            content: None,
            style: None,
        }
    }

    /// Learning rates of the hypernetworks and of the canvas for the current update.
    fn rates(&self, clock: &Clock) -> (f32, f32) {
        let settings = &self.config.style;
        if self.updates == 0 {
            return (settings.palette_rate, 0.0);
        }
        let warm = (self.updates as f32 / settings.lr_warmup_steps.max(1) as f32).min(1.0);
        let fade = settings.final_rate.powf(clock.progress() as f32) * warm;
        (settings.rate * fade, settings.canvas_rate * fade)
    }
}
