//! Appearances that go on learning from their own painting.

use crate::optimizer::{Adam, Rate};
use crate::paintings::window_statistics;
use crate::readback::ReadbackSchedule;
use crate::style::chunks::loss_of;
use crate::style::objective::Objective;
use crate::style::patches::PatchPool;
use image::RgbImage;
use impasto_field::{Appearance, Palette, Parameters, host};
use impasto_kernels::Sparse;
use impasto_model::config::{ContentTarget, StyleConfig};
use impasto_model::{Budget, Clock, Model, StyleEmbedding, StyledAppearance, square_statistics};
use impasto_scene::Split;
use impasto_style::{Perceptual, Statistics, StyleError, square_crop};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// Brings appearances closer to their paintings than hypernetworks do that have to know all of them: from
/// the weights W^app that these predict and from the painting's own detail, both go on learning for one
/// painting alone, by the style stage's losses on patches of the training views and of views between
/// them. Strokes can take shapes then that suit the scene: `app` alone can only choose among those that
/// are there.
///
/// Not part of the paper, whose appearances are predicted only: what this gains is the price of painting
/// any picture at once, and it costs seconds for each.
pub struct Refinement<'a> {
    model: &'a Model,
    settings: StyleConfig,
    patches: PatchPool,
    vgg: Perceptual,
    rng: Pcg64,
}

/// Learning rate of W^app: several times the hypernetworks', since few updates remain.
const APP_RATE: f32 = 4e-3;
/// Learning rate of the painting's detail.
const DETAIL_RATE: f32 = 2e-2;
/// Updates over which the rate rises: Adam's first steps are as long as any.
const WARM_UP: f32 = 20.0;

impl<'a> Refinement<'a> {
    /// Prepares a model; `None` if the style stage has not run or there are no training views.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn new(model: &'a Model) -> Result<Option<Self>, StyleError> {
        let file = &model.file;
        if file.scene.cameras(Split::Train).is_empty() || !model.has_style() {
            return Ok(None);
        }
        // A model holds no photos to compare with. What smoothness costs is strokes, which are what
        // is asked for here.
        let settings = StyleConfig {
            content_target: ContentTarget::Render,
            photo_weight: 0.0,
            smoothness_weight: 0.0,
            ..file.config.style.clone()
        };
        let app = file.config.style_appearance();
        Ok(Some(Self {
            patches: PatchPool::of_model(model, &settings, app),
            vgg: settings.perceptual.load()?,
            rng: Pcg64::seed_from_u64(file.seed),
            settings,
            model,
        }))
    }

    /// The appearance of a painting, or of several mixed by weight, after as many updates as the budget
    /// allows; `progress` hears of the share of it that is used, after each. `None` if no weight is
    /// positive.
    ///
    /// # Errors
    /// If an asset is damaged or a training view is smaller than a patch.
    pub fn appearance(
        &mut self,
        paintings: &[(&RgbImage, f32)],
        budget: Budget,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Option<StyledAppearance>, StyleError> {
        let embeddings = self.model.embeddings(paintings.iter().copied())?;
        let Some(embedding) = StyleEmbedding::mix(&embeddings) else {
            return Ok(None);
        };
        let Some(predicted) = self.model.predicted(&embedding) else {
            return Ok(None);
        };
        let target = self.target(paintings)?;
        let palette = self.model.photo_colors().palette_of(&embedding.colors);
        let appearance = self.descended(&predicted, &target, palette, budget, progress)?;
        Ok(Some(StyledAppearance::new(appearance)))
    }

    /// What patches are compared with: the weighted mean of the paintings' statistics. At least one
    /// weight is positive.
    fn target(&self, paintings: &[(&RgbImage, f32)]) -> Result<Statistics, StyleError> {
        let pictures = &self.settings.pictures;
        let mut mean = Statistics(vec![0.0; Statistics::LEN]);
        let mut sum = 0.0;
        for (painting, weight) in paintings.iter().filter(|(_, weight)| *weight > 0.0) {
            let square = square_crop(painting, 1.0, (0.5, 0.5), pictures.side);
            let one = if pictures.windowed {
                window_statistics(&self.vgg, &square, self.settings.patch)?
            } else {
                square_statistics(&self.vgg, &square)?
            };
            sum += weight;
            mean = mean.mixed(&one, weight / sum);
        }
        Ok(mean)
    }

    /// The appearance after gradient descent on its weights and on its detail.
    fn descended(
        &mut self,
        first: &Appearance,
        target: &Statistics,
        palette: Palette,
        budget: Budget,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Appearance, StyleError> {
        let mut params = Adam::new(first);
        let (mut clock, mut readback) = (Clock::start(budget), ReadbackSchedule::new());
        while !clock.is_over() {
            let patch = self.patches.draw(&self.vgg, &mut self.rng)?;
            // What is rendered is the last level.
            let Some(parts) = patch.levels.last() else {
                break;
            };
            let leaves = params.leaves();
            let objective = Objective {
                settings: &self.settings,
                vgg: &self.vgg,
                patches: &self.patches,
            };
            let loss = loss_of(parts, &leaves, |colours| {
                let losses = objective.losses(colours, &patch, target, palette, true)?;
                Ok::<_, StyleError>(losses.total)
            })?;
            let value = loss.clone().inner();
            let mut gradients = loss.backward();
            let named = leaves.named().into_iter();
            let found: Vec<_> = named
                .map(|(_, leaf)| leaf.grad_remove(&mut gradients))
                .collect();
            // Adam works in place only on what nobody else holds.
            drop(leaves);
            let fade = self.settings.final_rate.powf(clock.progress() as f32);
            let warm = ((clock.steps + 1) as f32 / WARM_UP).min(1.0);
            let now = fade * warm;
            params.step(found, |name| match name {
                "exemplar" => Rate {
                    rate: DETAIL_RATE * now,
                    sparse: Some(Sparse { decay: 0.0 }),
                },
                _ => Rate::dense(APP_RATE * now),
            });
            clock.steps += 1;
            if readback.due() {
                host(value);
                readback.done();
            }
            progress(clock.progress());
        }
        Ok(params.values())
    }
}
