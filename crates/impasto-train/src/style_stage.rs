//! Paintings → hypernetwork (PAPER §6–8). Geometry is frozen: samples, weights and features
//! depend on the camera only.

use crate::budget::Clock;
use crate::config::{StyleConfig, TrainConfig};
use crate::rays::PhotoRays;
use crate::styles::{STYLE_SIDE, Style};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_field::{Appearance, Canvas, Field, FieldWeights, Geometry, Grids, RayBatch};
use impasto_kernels::ops::AdamParam;
use impasto_style::{
    Features, Hypernetwork, Patch, PatchSampler, Perceptual, StyleCode, StyleError, losses,
};
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
        let app = config.style_app.spec(features[i], 3 + i);
        Hypernetwork::new(StyleCode::LEN, config.style.hyper_width, &app)
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
        }
    }
}

/// Hypernetworks in training.
pub struct StyleStage {
    config: TrainConfig,
    field: Field,
    frozen: (FieldWeights, Grids),
    photos: Vec<PhotoRays>,
    styles: Vec<Style>,
    vae: impasto_style::StyleVae,
    vgg: Perceptual,
    hyper: [Hypernetwork; 2],
    /// Per volume, per predicted layer.
    hyper_params: [Vec<AdamParam>; 2],
    canvas: Option<[AdamParam; 2]>,
    sampler: PatchSampler,
    rng: Pcg64,
    device: Device,
    updates: u64,
}

/// What one step did.
#[derive(Debug, Clone, Copy)]
pub struct StyleReport {
    /// Total loss.
    pub loss: f64,
    /// Content loss.
    pub content: f64,
    /// Style loss.
    pub style: f64,
    /// Rays used.
    pub rays: usize,
}

impl StyleStage {
    /// Prepares training on frozen geometry.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        config: &TrainConfig,
        field: Field,
        frozen: (FieldWeights, Grids),
        photos: Vec<PhotoRays>,
        (vgg, vae): (Perceptual, impasto_style::StyleVae),
        styles: Vec<Style>,
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
            sampler: PatchSampler {
                size: config.style.patch,
                strides: config.style.strides,
                reference: STYLE_SIDE as usize,
            },
            config: config.clone(),
            field,
            frozen,
            photos,
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

    /// One optimiser step: one patch, one or more styles.
    ///
    /// # Errors
    /// If the patch is too small for the perceptual network.
    pub fn step(&mut self, clock: &Clock) -> Result<StyleReport, StyleError> {
        let settings = self.config.style.clone();
        let (photo, patch) = self.draw_patch(&settings)?;
        let photo = &self.photos[photo];
        let (_, width) = (patch.size[0], photo.rays.size().0);
        let mut rays = RayBatch::default();
        let mut pixels = Vec::with_capacity(patch.size[0] * patch.size[1] * 3);
        for index in patch.pixels(width) {
            photo.rays.push(index, &mut rays);
            pixels.extend(&photo.pixels[index * 3..index * 3 + 3]);
        }
        let (weights, grids) = &self.frozen;
        let samples = self.field.sample(&rays, grids, Some(self.rng.random()));
        let samples = self
            .field
            .contributing(weights, &samples, settings.least_weight);
        let geometry = self.field.geometry(weights, samples).lifted();
        let content = self.vgg.features(&pixels, patch.size[0], patch.size[1])?;
        let mut report = StyleReport {
            loss: 0.0,
            content: 0.0,
            style: 0.0,
            rays: rays.len(),
        };
        for _ in 0..settings.styles_per_patch.max(1) {
            let style = self.draw_style(settings.virtual_share);
            let one = self.descend(&geometry, (&content, &pixels), &style, patch.size, clock);
            report.loss += one.0;
            report.content += one.1;
            report.style += one.2;
        }
        let count = settings.styles_per_patch.max(1) as f64;
        report.loss /= count;
        report.content /= count;
        report.style /= count;
        Ok(report)
    }

    fn draw_patch(&mut self, settings: &StyleConfig) -> Result<(usize, Patch), StyleError> {
        let photo = self.rng.random_range(0..self.photos.len());
        let (width, height) = self.photos[photo].rays.size();
        let patch = self.sampler.draw(height, width, &mut self.rng);
        patch.map(|p| (photo, p)).ok_or(StyleError::TooSmall {
            width,
            height,
            least: settings.patch[0].max(settings.patch[1]),
        })
    }

    /// A painting, or a mix of two: the loss needs statistics only, and the code that belongs to
    /// mixed statistics is known.
    fn draw_style(&mut self, virtual_share: f32) -> Style {
        let one = self.styles[self.rng.random_range(0..self.styles.len())].clone();
        if self.rng.random::<f32>() >= virtual_share {
            return one;
        }
        let other = &self.styles[self.rng.random_range(0..self.styles.len())];
        let statistics = one.statistics.mixed(&other.statistics, self.rng.random());
        let code = self.vae.encode(&statistics);
        Style { statistics, code }
    }

    fn descend(
        &mut self,
        geometry: &Geometry,
        (content, pixels): (&Features, &[f32]),
        style: &Style,
        [height, width]: [usize; 2],
        clock: &Clock,
    ) -> (f64, f64, f64) {
        let settings = self.config.style.clone();
        let model = self.model(AdamParam::tracked);
        let tracked = self.device.clone().autodiff();
        let appearance = model.appearance(&self.config, &style.code, &tracked);
        let colours = geometry
            .composite(&appearance)
            .slice([0..height * width, 0..3]);
        let traced = self.vgg.traced(colours.clone().reshape([height, width, 3]));
        let (content_loss, style_loss) =
            losses::content_and_style(&traced, content, &style.statistics);
        let mut loss = content_loss.clone() * settings.content_weight
            + style_loss.clone() * settings.style_weight;
        if settings.photo_weight > 0.0 {
            let photo = Tensor::from_data(
                TensorData::new(pixels.to_vec(), [height * width, 3]),
                &tracked,
            );
            loss = loss + (colours - photo).square().mean() * settings.photo_weight;
        }
        self.updates += 1;
        let mut gradients = loss.backward();
        let mut taken = |leaf: &Tensor<1>| leaf.grad_remove(&mut gradients);
        let layers = model.weights.iter().flat_map(|w| &w.0);
        let hyper: Vec<_> = layers.map(&mut taken).collect();
        let canvas = model.canvas.iter().flat_map(|c| [&c.inner, &c.outer]);
        let canvas: Vec<_> = canvas.map(&mut taken).collect();
        // Adam works in place only on what nobody else holds.
        drop((model, appearance));
        let warm = (self.updates as f32 / settings.warm_up.max(1) as f32).min(1.0);
        let fade = settings.final_rate.powf(clock.progress() as f32) * warm;
        for (param, grad) in self.hyper_params.iter_mut().flatten().zip(hyper) {
            if let Some(grad) = grad {
                param.step(grad, settings.rate * fade, false);
            }
        }
        for (param, grad) in self.canvas.iter_mut().flatten().zip(canvas) {
            if let Some(grad) = grad {
                param.step(grad, settings.canvas_rate * fade, true);
            }
        }
        let number = |t: Tensor<1>| f64::from(t.inner().into_scalar::<f32>());
        (number(loss), number(content_loss), number(style_loss))
    }
}
