//! What the style stage asks of a painted patch (PAPER §8).

use crate::style::patches::{FrozenPatch, PatchPool};
use burn::tensor::Tensor;
use impasto_field::Palette;
use impasto_model::config::StyleConfig;
use impasto_style::{Perceptual, Statistics, StyleError, losses};

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
    /// Content loss, once there is one.
    pub content: Option<f64>,
    /// Style loss, once there is one.
    pub style: Option<f64>,
    /// Rays painted.
    pub rays: usize,
}

impl Objective<'_> {
    /// Losses of the colours of a patch's rays, with the style loss only where there is a target
    /// that counts; `palette` leads from the scene's colours to the painting's.
    ///
    /// # Errors
    /// If the patch is too small for the perceptual network.
    ///
    /// # Shapes
    /// `colours`: `[rays, 3 or more]`.
    pub(crate) fn losses(
        &self,
        colours: Tensor<2>,
        patch: &FrozenPatch,
        target: &Statistics,
        palette: Palette,
        styled: bool,
    ) -> Result<Losses, StyleError> {
        let settings = self.settings;
        let pixels = self.patches.averaged(colours.clone());
        let traced = self.vgg.traced(pixels.clone());
        let unpainted = self.unpainted(patch, palette)?;
        let (content, likeness) = losses::content_and_style(
            &traced,
            &unpainted.content,
            target,
            settings.style_reduction,
        );
        let mut total = content.clone() * settings.content_weight;
        if styled {
            let style = likeness.clone() * settings.style_weight;
            let style = if settings.normalize_style_loss {
                style * unpainted.style_scale(target)
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
        Ok(Losses {
            total,
            content: Some(content),
            style: Some(likeness),
        })
    }

    /// The patch before anything is painted: as it is, or where paint is in whitened colours in the
    /// painting's colours. What content is compared with, and how far paint has to go, has nothing to
    /// do with the palette then.
    fn unpainted(&self, patch: &FrozenPatch, palette: Palette) -> Result<Unpainted, StyleError> {
        if self.settings.shading.paint().is_none() {
            return Ok(Unpainted {
                content: patch.content.clone(),
                statistics: patch.statistics.clone(),
            });
        }
        let [height, width, _] = patch.pixels.dims();
        let pixels = patch.pixels.clone().inner().reshape([height * width, 3]);
        let recoloured = palette.recoloured(pixels).reshape([height, width, 3]);
        let [content, statistics] = self.vgg.features_of(recoloured)?.map(Tensor::from_inner);
        Ok(Unpainted {
            content,
            statistics,
        })
    }
}

/// What the perceptual network says of a patch before anything is painted, constants of an autodiff graph.
struct Unpainted {
    content: Tensor<1>,
    statistics: Tensor<1>,
}

/// Style distance between photos and a painting, as seen for captures of streets and gardens and
/// for 100 paintings.
const TYPICAL_DISTANCE: f32 = 0.8;
/// Paintings nearer to the photos than this count no more than one at this distance.
const LEAST_DISTANCE: f32 = 0.2;

impl Unpainted {
    /// What the style loss of a painting is multiplied with, so that all paintings count alike: the inverse
    /// of its distance, in units of [`TYPICAL_DISTANCE`]. One number, a constant.
    fn style_scale(&self, target: &Statistics) -> Tensor<1> {
        let target = target.tensor(&self.statistics.device());
        let distance = (self.statistics.clone() - target).square().mean();
        distance.clamp_min(LEAST_DISTANCE).recip() * TYPICAL_DISTANCE
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
