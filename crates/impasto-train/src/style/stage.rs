//! Paintings → hypernetwork (PAPER §6–8). Geometry is frozen: samples, weights and features
//! depend on the camera only.

use crate::budget::{Clock, Looks};
use crate::checkpoint::{adam_entries, restore_adam};
use crate::config::TrainConfig;
use crate::model_file::{Entry, Reader};
use crate::objective::{Losses, Objective, StyleReport, difference};
use crate::painted;
use crate::patches::{Frozen, FrozenPatch, PatchPool, PoolProgress};
use crate::rays::PhotoRays;
use crate::styles::{Style, StyleSet};
use burn::tensor::{Device, Tensor};
use impasto_field::{Appearance, Canvas, Field};
use impasto_kernels::{device::is_cpu, ops::AdamParam};
use impasto_style::{Hypernetwork, HypernetworkWeights, Perceptual, StyleCode, StyleError};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Everything that predicts a stylised appearance.
#[derive(Debug, Clone)]
pub struct StyleModel {
    /// Hypernetworks of the inner and the outer `app`.
    pub hyper: [Hypernetwork; 2],
    /// Their weights, after those for the first field of a cascade, where there is one.
    pub levels: Vec<[HypernetworkWeights; 2]>,
    /// The canvas encoding, where the appearance has one.
    pub canvas: Option<Canvas>,
}

/// Levels of a cascade, or the only one.
pub fn levels(config: &TrainConfig) -> usize {
    1 + usize::from(config.field.cascade.is_some())
}

/// The hypernetworks' sizes for a configuration.
pub fn hypernetworks(field: &Field, config: &TrainConfig) -> [Hypernetwork; 2] {
    let features = field.features();
    [0, 1].map(|i| {
        let app = config.style_appearance().network(features[i], 3 + i);
        let settings = &config.style;
        Hypernetwork::new(
            StyleCode::LEN,
            settings.hyper_width,
            app.layers(),
            settings.predicted_layers,
        )
    })
}

impl StyleModel {
    /// The appearances that belong to a style code, level by level: the field's is the last.
    pub fn appearances(
        &self,
        config: &TrainConfig,
        code: &StyleCode,
        device: &Device,
    ) -> Vec<Appearance> {
        let code = code.tensor(device);
        let levels = self.levels.iter().map(|[inner, outer]| Appearance {
            config: config.style_appearance(),
            inner: self.hyper[0].predict(inner, &code),
            outer: self.hyper[1].predict(outer, &code),
            canvas: self.canvas.clone(),
            latent: None,
        });
        levels.collect()
    }
}

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
    vae: impasto_style::StyleVae,
    vgg: Perceptual,
    hyper: [Hypernetwork; 2],
    /// Per level, per volume, per layer.
    hyper_params: Vec<[Vec<AdamParam>; 2]>,
    canvas: Option<[AdamParam; 2]>,
    rng: Pcg64,
    device: Device,
    /// Updates with perceptual losses so far.
    updates: u64,
    /// When a GPU's losses are looked at, and what was last seen.
    looks: Looks,
    seen: StyleReport,
}

impl StyleStage {
    /// Prepares training on frozen geometry.
    ///
    /// # Panics
    /// In [`Self::step`], if there is no photo or no style.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        config: &TrainConfig,
        frozen: Frozen,
        photos: Vec<PhotoRays>,
        (vgg, vae): (Perceptual, impasto_style::StyleVae),
        styles: StyleSet,
        seed: u64,
        device: &Device,
    ) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed ^ 0x57_79_6c_65);
        let field = Field::new(config.field.clone());
        let features = field.features();
        let hyper = hypernetworks(&field, config);
        let hyper_params = (0..levels(config)).map(|_| {
            [0, 1].map(|i| {
                let first = hyper[i].init(&mut rng, device).0.into_iter();
                first.map(AdamParam::new).collect()
            })
        });
        let hyper_params = hyper_params.collect();
        let app = config.style_appearance();
        let patches = PatchPool::new((&config.style, &app), field, frozen, photos);
        let canvas = Appearance::init(app, features, &mut rng, device).canvas;
        Self {
            canvas: canvas.map(|c| [AdamParam::new(c.inner), AdamParam::new(c.outer)]),
            patches,
            config: config.clone(),
            styles,
            vae,
            vgg,
            hyper,
            hyper_params,
            rng,
            device: device.clone(),
            updates: 0,
            looks: Looks::new(),
            seen: StyleReport::default(),
        }
    }

    /// The current hypernetworks.
    pub fn snapshot(&self) -> StyleModel {
        self.model(AdamParam::value)
    }

    /// All that [`Self::restore`] needs to go on as if nothing had been.
    pub(crate) fn progress(&self) -> (StyleProgress, Vec<Entry>) {
        let hyper = self.hyper_params.iter().flatten().flatten();
        let (adam, entries) = adam_entries(hyper.chain(self.canvas.iter().flatten()));
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
        from: &Reader<'_>,
    ) -> Result<(), String> {
        let hyper = self.hyper_params.iter_mut().flatten().flatten();
        let params = hyper.chain(self.canvas.iter_mut().flatten());
        restore_adam(params, &progress.adam, from)?;
        let filled = self.patches.restore(&progress.pool, &self.vgg);
        filled.map_err(|e| e.to_string())?;
        self.rng = progress.rng.clone();
        self.updates = progress.updates;
        Ok(())
    }

    fn model(&self, leaf: impl Fn(&AdamParam) -> Tensor<1>) -> StyleModel {
        let weights = |p: &Vec<AdamParam>| HypernetworkWeights(p.iter().map(&leaf).collect());
        let levels = self.hyper_params.iter();
        StyleModel {
            hyper: self.hyper.clone(),
            levels: levels.map(|level| level.each_ref().map(weights)).collect(),
            canvas: self.canvas.as_ref().map(|[inner, outer]| Canvas {
                inner: leaf(inner),
                outer: leaf(outer),
            }),
        }
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
        let model = self.model(AdamParam::tracked);
        let tracked = self.device.clone().autodiff();
        let looks = model.appearances(&self.config, &style.code, &tracked);
        let palette = clock.progress() < f64::from(self.config.style.palette_share);
        if !palette {
            if self.updates == 0 {
                self.forget_moments();
            }
            self.updates += 1;
        }
        let styled = self.updates > self.config.style.style_warmup;
        // Every level has a loss of its own; the field's, which is rendered, is the last.
        let looks_at = self.looks.due() || is_cpu(&self.device);
        let mut report = StyleReport {
            rays: patch.rays(),
            ..self.seen
        };
        let losses = patch.levels.iter().zip(&looks).map(|(parts, look)| {
            painted::loss_of(parts, look, |colours| {
                let losses = match palette {
                    true => self.palette_loss(colours, patch, style),
                    false => self
                        .objective()
                        .losses(colours, patch, (&style.target, styled)),
                };
                if looks_at {
                    report = losses.report(patch.rays());
                }
                losses.total
            })
        });
        let total = losses.reduce(|sum, loss| sum + loss);
        let Some(total) = total else {
            return report;
        };
        let mut gradients = total.backward();
        let mut taken = |leaf: &Tensor<1>| leaf.grad_remove(&mut gradients);
        let layers = model.levels.iter().flatten().flat_map(|w| &w.0);
        let hyper: Vec<_> = layers.map(&mut taken).collect();
        let canvas = model.canvas.iter().flat_map(|c| [&c.inner, &c.outer]);
        let canvas: Vec<_> = canvas.map(&mut taken).collect();
        self.seen = report;
        if looks_at {
            self.looks.done();
        }
        // Adam works in place only on what nobody else holds.
        drop((model, looks));
        let (rate, canvas_rate) = self.rates(clock);
        let params = self.hyper_params.iter_mut().flatten().flatten();
        for (param, grad) in params.zip(hyper) {
            if let Some(grad) = grad {
                param.step(grad, rate, false);
            }
        }
        for (param, grad) in self.canvas.iter_mut().flatten().zip(canvas) {
            if let Some(grad) = grad {
                param.step(grad, canvas_rate, true);
            }
        }
        report
    }

    /// Squared difference to the photo in the painting's colours.
    fn palette_loss(&self, rays: Tensor<2>, patch: &FrozenPatch, style: &Style) -> Losses {
        let colours = self.patches.averaged(rays);
        let recolouring = self.patches.palette().recolouring(&style.palette);
        Losses {
            total: difference(colours, recolouring.applied(patch.pixels.clone())),
            content: None,
            style: None,
        }
    }

    fn objective(&self) -> Objective<'_> {
        Objective {
            settings: &self.config.style,
            vgg: &self.vgg,
            patches: &self.patches,
        }
    }

    /// Adam's moments of the palette updates are useless for perceptual losses, whose gradients
    /// are thousands of times larger.
    fn forget_moments(&mut self) {
        let fresh = |p: &mut AdamParam| *p = AdamParam::new(p.value());
        let hyper = self.hyper_params.iter_mut().flatten().flatten();
        hyper.for_each(fresh);
        self.canvas.iter_mut().flatten().for_each(fresh);
    }

    /// Learning rates of the hypernetworks and of the canvas for the current update.
    fn rates(&self, clock: &Clock) -> (f32, f32) {
        let settings = &self.config.style;
        if self.updates == 0 {
            return (settings.palette_rate, 0.0);
        }
        let warm = (self.updates as f32 / settings.warm_up.max(1) as f32).min(1.0);
        let fade = settings.final_rate.powf(clock.progress() as f32) * warm;
        (settings.rate * fade, settings.canvas_rate * fade)
    }
}
