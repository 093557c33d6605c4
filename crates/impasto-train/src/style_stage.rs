//! Paintings → hypernetwork (PAPER §6–8). Geometry is frozen: samples, weights and features
//! depend on the camera only.

use crate::budget::Clock;
use crate::config::TrainConfig;
use crate::patches::{Frozen, FrozenPatch, PatchPool};
use crate::rays::PhotoRays;
use crate::styles::{Style, StyleSet};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_field::{Appearance, Canvas, Field};
use impasto_kernels::ops::AdamParam;
use impasto_style::{Hypernetwork, Perceptual, StyleCode, StyleError, losses};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Everything that predicts a stylised appearance.
#[derive(Debug, Clone)]
pub struct StyleModel {
    /// Hypernetworks of the inner and the outer `app`.
    pub hyper: [Hypernetwork; 2],
    /// Their weights.
    pub weights: [impasto_style::HypernetworkWeights; 2],
    /// The canvas encoding, where the appearance has one.
    pub canvas: Option<Canvas>,
}

/// The hypernetworks' sizes for a configuration.
pub fn hypernetworks(field: &Field, config: &TrainConfig) -> [Hypernetwork; 2] {
    let features = field.features();
    [0, 1].map(|i| {
        let app = config.style_app.network(features[i], 3 + i);
        Hypernetwork::new(StyleCode::LEN, config.style.hyper_width, app.layers())
    })
}

impl StyleModel {
    /// The appearance that belongs to a style code.
    pub fn appearance(
        &self,
        config: &TrainConfig,
        code: &StyleCode,
        device: &Device,
    ) -> Appearance {
        let code = code.tensor(device);
        Appearance {
            config: config.style_app.clone(),
            inner: self.hyper[0].predict(&self.weights[0], &code),
            outer: self.hyper[1].predict(&self.weights[1], &code),
            canvas: self.canvas.clone(),
            latent: None,
        }
    }
}

/// Hypernetworks in training.
pub struct StyleStage {
    config: TrainConfig,
    patches: PatchPool,
    styles: StyleSet,
    vae: impasto_style::StyleVae,
    vgg: Perceptual,
    hyper: [Hypernetwork; 2],
    /// Per volume, per predicted layer.
    hyper_params: [Vec<AdamParam>; 2],
    canvas: Option<[AdamParam; 2]>,
    rng: Pcg64,
    device: Device,
    /// Updates with perceptual losses so far.
    updates: u64,
}

/// What one step did.
#[derive(Debug, Clone, Copy)]
pub struct StyleReport {
    /// Total loss.
    pub loss: f64,
    /// Content loss, zero while the palette is learned.
    pub content: f64,
    /// Style loss, zero while the palette is learned.
    pub style: f64,
    /// Rays painted.
    pub rays: usize,
}

impl StyleStage {
    /// Prepares training on frozen geometry.
    ///
    /// # Panics
    /// In [`Self::step`], if there is no photo or no style.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        config: &TrainConfig,
        field: Field,
        frozen: Frozen,
        photos: Vec<PhotoRays>,
        (vgg, vae): (Perceptual, impasto_style::StyleVae),
        styles: StyleSet,
        seed: u64,
        device: &Device,
    ) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed ^ 0x57_79_6c_65);
        let hyper = hypernetworks(&field, config);
        let hyper_params = [0, 1].map(|i| {
            hyper[i]
                .init(&mut rng, device)
                .0
                .into_iter()
                .map(AdamParam::new)
                .collect()
        });
        let canvas =
            Appearance::init(config.style_app.clone(), field.features(), &mut rng, device).canvas;
        Self {
            canvas: canvas.map(|c| [AdamParam::new(c.inner), AdamParam::new(c.outer)]),
            patches: PatchPool::new((&config.style, &config.style_app), field, frozen, photos),
            config: config.clone(),
            styles,
            vae,
            vgg,
            hyper,
            hyper_params,
            rng,
            device: device.clone(),
            updates: 0,
        }
    }

    /// The current hypernetworks.
    pub fn snapshot(&self) -> StyleModel {
        self.model(AdamParam::value)
    }

    fn model(&self, leaf: impl Fn(&AdamParam) -> Tensor<1>) -> StyleModel {
        let weights =
            |p: &Vec<AdamParam>| impasto_style::HypernetworkWeights(p.iter().map(&leaf).collect());
        StyleModel {
            hyper: self.hyper.clone(),
            weights: [
                weights(&self.hyper_params[0]),
                weights(&self.hyper_params[1]),
            ],
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
        let appearance = model.appearance(&self.config, &style.code, &tracked);
        let colours = self.patches.averaged(patch.geometry.composite(&appearance));
        let losses = if clock.progress() < f64::from(self.config.style.palette_share) {
            self.palette_loss(colours, patch, style)
        } else {
            if self.updates == 0 {
                self.forget_moments();
            }
            self.updates += 1;
            self.perceptual_losses(colours, patch, style)
        };
        let mut gradients = losses.total.backward();
        let mut taken = |leaf: &Tensor<1>| leaf.grad_remove(&mut gradients);
        let layers = model.weights.iter().flat_map(|w| &w.0);
        let hyper: Vec<_> = layers.map(&mut taken).collect();
        let canvas = model.canvas.iter().flat_map(|c| [&c.inner, &c.outer]);
        let canvas: Vec<_> = canvas.map(&mut taken).collect();
        // Adam works in place only on what nobody else holds.
        drop((model, appearance));
        let (rate, canvas_rate) = self.rates(clock);
        for (param, grad) in self.hyper_params.iter_mut().flatten().zip(hyper) {
            if let Some(grad) = grad {
                param.step(grad, rate, false);
            }
        }
        for (param, grad) in self.canvas.iter_mut().flatten().zip(canvas) {
            if let Some(grad) = grad {
                param.step(grad, canvas_rate, true);
            }
        }
        losses.report(patch.geometry.layout().rays.len())
    }

    /// Squared difference to the photo in the painting's colours.
    fn palette_loss(&self, colours: Tensor<3>, patch: &FrozenPatch, style: &Style) -> Losses {
        let recolouring = self.patches.palette().recolouring(&style.palette);
        Losses {
            total: difference(colours, recolouring.apply(&patch.pixels)),
            content: None,
            style: None,
        }
    }

    fn perceptual_losses(&self, colours: Tensor<3>, patch: &FrozenPatch, style: &Style) -> Losses {
        let settings = &self.config.style;
        let traced = self.vgg.traced(colours.clone());
        let (content, likeness) =
            losses::content_and_style(&traced, &patch.features, &style.target);
        let style_weight = settings.style_weight * self.patches.ease(&style.target);
        let mut total = content.clone() * settings.content_weight + likeness.clone() * style_weight;
        if settings.photo_weight > 0.0 {
            total = total + difference(colours, patch.pixels.clone()) * settings.photo_weight;
        }
        Losses {
            total,
            content: Some(content),
            style: Some(likeness),
        }
    }

    /// Adam's moments of the palette updates are useless for perceptual losses, whose gradients
    /// are thousands of times larger.
    fn forget_moments(&mut self) {
        let fresh = |p: &mut AdamParam| *p = AdamParam::new(p.value());
        self.hyper_params.iter_mut().flatten().for_each(fresh);
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

/// Losses of one update, in its graph.
struct Losses {
    total: Tensor<1>,
    content: Option<Tensor<1>>,
    style: Option<Tensor<1>>,
}

impl Losses {
    fn report(self, rays: usize) -> StyleReport {
        let number = |t: Tensor<1>| f64::from(t.inner().into_scalar::<f32>());
        StyleReport {
            loss: number(self.total),
            content: self.content.map_or(0.0, number),
            style: self.style.map_or(0.0, number),
            rays,
        }
    }
}

/// Mean squared difference to pixels of the same shape.
fn difference(colours: Tensor<3>, pixels: Vec<f32>) -> Tensor<1> {
    let wanted = Tensor::from_data(TensorData::new(pixels, colours.dims()), &colours.device());
    (colours - wanted).square().mean()
}
