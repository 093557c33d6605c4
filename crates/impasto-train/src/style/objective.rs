//! What the style stage asks of a painted patch (PAPER §8).

use crate::style::patches::{FrozenPatch, PatchPool};
use burn::tensor::Tensor;
use impasto_model::config::StyleConfig;
use impasto_style::{Perceptual, Statistics, losses};

/// Perceptual losses of painted patches.
pub(crate) struct Objective<'a> {
    pub(crate) settings: &'a StyleConfig,
    pub(crate) vgg: &'a Perceptual,
    pub(crate) patches: &'a PatchPool,
}

/// Losses of one update, in its graph.
pub(crate) struct Losses {
    pub(crate) total: Tensor<1>,
    pub(crate) content: Option<Tensor<1>>,
    pub(crate) style: Option<Tensor<1>>,
}

/// What one step did, of a cascade the field's part of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct StyleReport {
    /// Total loss.
    pub loss: f64,
    /// Content loss, once the palette is learned.
    pub content: Option<f64>,
    /// Style loss, once the palette is learned.
    pub style: Option<f64>,
    /// Rays painted.
    pub rays: usize,
}

impl Objective<'_> {
    /// Losses of the colours of a patch's rays, with the style loss only where there is a target
    /// that counts.
    ///
    /// # Shapes
    /// `colours`: `[rays, 3 or more]`.
    pub(crate) fn losses(
        &self,
        colours: Tensor<2>,
        patch: &FrozenPatch,
        target: &Statistics,
        styled: bool,
    ) -> Losses {
        let settings = self.settings;
        let pixels = self.patches.averaged(colours.clone());
        let traced = self.vgg.traced(pixels.clone());
        let (content, likeness) =
            losses::content_and_style(&traced, &patch.content, target, settings.style_reduction);
        let mut total = content.clone() * settings.content_weight;
        if styled {
            let style = likeness.clone() * settings.style_weight;
            let style = if settings.normalize_style_loss {
                style * self.patches.style_loss_scale(target)
            } else {
                style
            };
            total = total + style;
        }
        if settings.photo_weight > 0.0 {
            total = total + difference(pixels, patch.pixels.clone()) * settings.photo_weight;
        }
        if settings.smoothness_weight > 0.0 {
            total = total + self.patches.smoothness(colours) * settings.smoothness_weight;
        }
        Losses {
            total,
            content: Some(content),
            style: Some(likeness),
        }
    }
}

impl Losses {
    pub(crate) fn report(&self, rays: usize) -> StyleReport {
        let number = |t: &Tensor<1>| f64::from(t.clone().inner().into_scalar::<f32>());
        StyleReport {
            loss: number(&self.total),
            content: self.content.as_ref().map(number),
            style: self.style.as_ref().map(number),
            rays,
        }
    }
}

/// Mean squared difference to pixels of the same shape.
pub(crate) fn difference(colours: Tensor<3>, wanted: Tensor<3>) -> Tensor<1> {
    (colours - wanted).square().mean()
}
