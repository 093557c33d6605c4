//! `app`: from features to colour, with weights that are data.

use crate::branch::{encoding_weights, kaiming};
use crate::config::EncodingConfig;
use crate::network::AppNetwork;
use burn::tensor::{Device, Tensor};
use impasto_kernels::{Activation, MlpSpec};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Where `app` is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shading {
    /// At every sample (the paper's volume rendering).
    Samples,
    /// Once per ray and volume, on the samples' mean features and position. Several times cheaper,
    /// and paint keeps its contrast where a surface is a haze of several samples.
    Surface,
}

/// Sizes of `app`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppearanceConfig {
    /// Hidden widths.
    pub hidden: Vec<usize>,
    /// LayerNorm before each hidden relu (the paper's choice for predicted weights).
    pub layer_norm: bool,
    /// Octaves of the unit view direction that `app` sees; `None` hides the direction.
    pub view_bands: Option<usize>,
    /// A position encoding of `app`'s own, learned with it and shared by all styles: where brush
    /// strokes live that the smooth base features cannot place. Shaded once per ray, its levels fade
    /// where the ray's light comes from a stretch wider than their cells.
    pub canvas: Option<EncodingConfig>,
    /// Where it is evaluated.
    pub shading: Shading,
    /// Whether a linear layer, as wide as the features, comes before anything joins them (the
    /// paper's).
    #[serde(default)]
    pub remap: bool,
    /// Length of the learned vector that shifts the features before anything joins them (the
    /// paper's geometry stage).
    #[serde(default)]
    pub latent: Option<usize>,
}

impl AppearanceConfig {
    /// Whether there is a canvas that is no hash grid.
    pub(crate) fn paints_by_position(&self) -> bool {
        let canvas = self.canvas.as_ref();
        canvas.is_some_and(|canvas| canvas.hash_grid().is_none())
    }

    /// Layers of `app` on features of width `features` and positions of `dimensions` coordinates.
    pub fn network(&self, features: usize, dimensions: usize) -> AppNetwork {
        let view = self.view_bands.map_or(0, |bands| 3 * (1 + 2 * bands));
        let canvas = self.canvas.as_ref().map_or(0, |c| c.outputs(dimensions));
        let mut widths = vec![features + view + canvas];
        widths.extend(&self.hidden);
        widths.push(3);
        let linear = |inputs| MlpSpec::relu(&[inputs, features], false, Activation::Linear);
        AppNetwork {
            features,
            remap: self.remap.then(|| linear(features)),
            chain: MlpSpec::relu(&widths, self.layer_norm, Activation::Sigmoid),
            shift: self.latent.map(linear),
        }
    }
}

/// Size of a canvas's first entries: noise at all its scales, from which `app` can make strokes
/// before the canvas itself has learned any.
const FIRST_PAINT: f32 = 0.5;

/// Weights of the canvas encoding in both volumes.
#[derive(Debug, Clone)]
pub struct Canvas {
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
    pub canvas: Option<Canvas>,
    /// The field's learned vector, where the configuration asks for one.
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
        Self {
            inner: kaiming(config.network(features[0], 3).layers(), rng, device),
            outer: kaiming(config.network(features[1], 4).layers(), rng, device),
            latent: None,
            canvas: config.canvas.as_ref().map(|c| Canvas {
                inner: encoding_weights(c, FIRST_PAINT, rng, device),
                outer: encoding_weights(c, FIRST_PAINT, rng, device),
            }),
            config,
        }
    }
}
