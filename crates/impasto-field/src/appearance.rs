//! `app`: from features to colour, with weights that are data.

use crate::branch::kaiming;
use crate::config::AppearanceConfig;
use crate::encoding::hash_table;
use crate::parameters::Parameters;
use burn::tensor::{Device, Tensor};
use rand_pcg::Pcg64;

/// Size of a canvas's first entries at its coarsest level: noise at all its scales, from which `app`
/// can make strokes before the canvas itself has learned any. It falls with the root of the size of
/// cells: few patches reach a fine one, and what they leave would be grain.
const FIRST_PAINT: f32 = 0.5;

/// Weights of the canvas encoding in both volumes.
#[derive(Debug, Clone)]
pub struct CanvasWeights {
    /// Inner volume.
    pub inner: Tensor<1>,
    /// Outer volume.
    pub outer: Tensor<1>,
}

/// Everything that turns features into colours: W^app of both volumes.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// Sizes.
    pub config: AppearanceConfig,
    /// W^app of the inner volume, flat.
    pub inner: Tensor<1>,
    /// W^app of the outer volume, flat.
    pub outer: Tensor<1>,
    /// The canvas encoding's weights, where the configuration has one.
    pub canvas: Option<CanvasWeights>,
    /// The field's learned vector, where the configuration asks for one. The field's, no parameter
    /// of the appearance.
    pub latent: Option<Tensor<1>>,
}

impl Appearance {
    /// Random weights; no learned vector, which belongs to the field.
    pub fn init(
        config: AppearanceConfig,
        features: [usize; 2],
        rng: &mut Pcg64,
        device: &Device,
    ) -> Self {
        let mut app = |width| kaiming(config.network(width).layers(), rng, device);
        let [inner, outer] = [app(features[0]), app(features[1])];
        let canvas = config.shading.canvas().map(|grid| {
            let size = |level| FIRST_PAINT * (grid.coarsest / grid.resolution(level)).sqrt();
            CanvasWeights {
                inner: hash_table(grid, size, rng, device),
                outer: hash_table(grid, size, rng, device),
            }
        });
        Self {
            config,
            inner,
            outer,
            canvas,
            latent: None,
        }
    }

    /// Zero weights, for reading.
    pub fn zeros(config: AppearanceConfig, features: [usize; 2], device: &Device) -> Self {
        let app = |width| Tensor::zeros([config.network(width).params()], device);
        let canvas = config.shading.canvas().map(|grid| CanvasWeights {
            inner: Tensor::zeros([grid.params()], device),
            outer: Tensor::zeros([grid.params()], device),
        });
        Self {
            inner: app(features[0]),
            outer: app(features[1]),
            canvas,
            latent: None,
            config,
        }
    }
}

impl Parameters for CanvasWeights {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        Ok(Self {
            inner: f("inner.canvas", &self.inner)?,
            outer: f("outer.canvas", &self.outer)?,
        })
    }
}

impl Parameters for Appearance {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        Ok(Self {
            config: self.config.clone(),
            inner: f("inner.app", &self.inner)?,
            outer: f("outer.app", &self.outer)?,
            canvas: self.canvas.as_ref().map(|c| c.try_map(f)).transpose()?,
            latent: self.latent.clone(),
        })
    }
}
