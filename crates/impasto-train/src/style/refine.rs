//! Looks that go on learning from their own painting.

use crate::budget::{Budget, Clock, Looks};
use crate::config::{ContentTarget, StyleConfig};
use crate::model::{StyleEmbedding, Look, Model};
use crate::objective::Objective;
use crate::painted;
use crate::patches::{Frozen, PatchPool};
use crate::rays::{CameraRays, PhotoRays};
use crate::styles::{statistics, window_statistics};
use burn::tensor::Tensor;
use image::RgbImage;
use impasto_field::{Appearance, Canvas, Field, render::host};
use impasto_kernels::ops::AdamParam;
use impasto_scene::Split;
use impasto_style::{Perceptual, Statistics, StyleError, square_crop};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// Brings looks closer to their paintings than hypernetworks do that have to know all of them: from
/// the weights W^app that these predict, those weights alone go on learning, by the style stage's
/// losses on patches of the training views and of views between them.
///
/// Not part of the paper, whose looks are predicted only: what this gains is the price of painting
/// any picture at once, and it costs seconds for each.
pub struct Refinement<'a> {
    model: &'a Model,
    settings: StyleConfig,
    patches: PatchPool,
    vgg: Perceptual,
    rng: Pcg64,
}

/// Learning rate of W^app: an order of magnitude above the hypernetworks', since few updates
/// remain.
const RATE: f32 = 1e-2;
/// Updates over which the rate rises: Adam's first steps are as long as any.
const WARM_UP: f32 = 20.0;

impl<'a> Refinement<'a> {
    /// Prepares a model; `None` if the style stage has not run or there are no training views.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn new(model: &'a Model) -> Result<Option<Self>, StyleError> {
        let file = &model.file;
        let cameras = file.scene.cameras(Split::Train);
        if cameras.is_empty() || !model.has_style() {
            return Ok(None);
        }
        let photos = cameras.iter().map(|camera| PhotoRays {
            rays: CameraRays::new(camera, None),
            pixels: Vec::new(),
            used: None,
        });
        // A model holds no photos to compare with.
        let settings = StyleConfig {
            content_target: ContentTarget::Render,
            photo_weight: 0.0,
            ..file.config.style.clone()
        };
        let frozen = Frozen {
            weights: file.weights.clone(),
            grids: file.grids.clone(),
            photo_app: file.photo_app.clone(),
        };
        let field = Field::new(file.config.field.clone());
        let app = file.config.style_appearance();
        Ok(Some(Self {
            patches: PatchPool::new((&settings, &app), field, frozen, photos.collect()),
            vgg: settings.perceptual.load()?,
            rng: Pcg64::seed_from_u64(file.seed),
            settings,
            model,
        }))
    }

    /// The look of a painting, or of several mixed by weight, after as many updates as the budget
    /// allows; `progress` hears of the share of it that is used, after each. `None` if no weight is
    /// positive.
    ///
    /// # Errors
    /// If an asset is damaged or a training view is smaller than a patch.
    pub fn look(
        &mut self,
        paintings: &[(&RgbImage, f32)],
        budget: Budget,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Option<Look>, StyleError> {
        let inspirations = self.model.inspirations(paintings.iter().copied())?;
        let Some(inspiration) = StyleEmbedding::mix(&inspirations) else {
            return Ok(None);
        };
        let Some(predicted) = self.model.predicted(&inspiration.code) else {
            return Ok(None);
        };
        let target = self.target(paintings)?;
        let appearance = self.descended(predicted, &target, budget, progress)?;
        Ok(Some(self.model.look_of(appearance, &inspiration.palette)))
    }

    /// What patches are compared with: the weighted mean of the paintings' statistics. At least one
    /// weight is positive.
    fn target(&self, paintings: &[(&RgbImage, f32)]) -> Result<Statistics, StyleError> {
        let pictures = &self.settings.pictures;
        let mut mean = Statistics(vec![0.0; Statistics::LEN]);
        let mut sum = 0.0;
        for (painting, weight) in paintings.iter().filter(|(_, weight)| *weight > 0.0) {
            let square = square_crop(painting, 1.0, (0.5, 0.5), pictures.side);
            let one = match pictures.windowed {
                true => window_statistics(&self.vgg, &square, self.settings.patch)?,
                false => statistics(&self.vgg, &square)?,
            };
            sum += weight;
            mean = mean.mixed(&one, weight / sum);
        }
        Ok(mean)
    }

    /// The appearance after gradient descent on its weights; a canvas is everybody's and stays.
    fn descended(
        &mut self,
        first: Appearance,
        target: &Statistics,
        budget: Budget,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Appearance, StyleError> {
        let mut params = [&first.inner, &first.outer].map(|w| AdamParam::new(w.clone()));
        let (mut clock, mut looks) = (Clock::start(budget), Looks::new());
        while !clock.is_over() {
            let patch = self.patches.draw(&self.vgg, &mut self.rng)?;
            // What is rendered is the last level.
            let Some(parts) = patch.levels.last() else {
                break;
            };
            let [inner, outer] = params.each_ref().map(AdamParam::tracked);
            let look = Appearance {
                inner,
                outer,
                canvas: first.canvas.as_ref().map(lifted),
                ..first.clone()
            };
            let objective = Objective {
                settings: &self.settings,
                vgg: &self.vgg,
                patches: &self.patches,
            };
            let loss = painted::loss_of(parts, &look, |colours| {
                objective.losses(colours, &patch, (target, true)).total
            });
            let value = loss.clone().inner();
            let mut gradients = loss.backward();
            let found = [&look.inner, &look.outer].map(|leaf| leaf.grad_remove(&mut gradients));
            // Adam works in place only on what nobody else holds.
            drop(look);
            let fade = self.settings.final_rate.powf(clock.progress() as f32);
            let warm = ((clock.steps + 1) as f32 / WARM_UP).min(1.0);
            for (param, gradient) in params.iter_mut().zip(found) {
                if let Some(gradient) = gradient {
                    param.step(gradient, RATE * fade * warm, false);
                }
            }
            clock.steps += 1;
            if looks.due() {
                host(value);
                looks.done();
            }
            progress(clock.progress());
        }
        let [inner, outer] = params.each_ref().map(AdamParam::value);
        Ok(Appearance {
            inner,
            outer,
            ..first
        })
    }
}

/// The same as constants of an autodiff graph.
fn lifted(canvas: &Canvas) -> Canvas {
    Canvas {
        inner: Tensor::from_inner(canvas.inner.clone()),
        outer: Tensor::from_inner(canvas.outer.clone()),
    }
}
