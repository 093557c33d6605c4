//! `app`: from features to colour, with weights that are data.

use crate::branch::{encoding_weights, kaiming};
use crate::config::EncodingConfig;
use crate::encoding::{Positions, encode, frequencies, matrix};
use crate::network::AppNetwork;
use burn::tensor::{Device, Tensor};
use impasto_kernels::{Activation, HashGridSpec, MlpSpec};
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

impl Appearance {
    /// Colours of one volume's samples, or `known` ones with the gradients that computing them
    /// would have.
    ///
    /// # Shapes
    /// `features`: `[n, f]`; `spreads`: `n`, or none for single points, see
    /// [`VolumeSamples::spreads`](crate::sampling::VolumeSamples); `views`: `n × 3` unit vectors; result and `known`: `[n, 3]` in
    /// `(0, 1)`.
    pub(crate) fn shade(
        &self,
        features: Tensor<2>,
        (positions, spreads): (&Positions<'_>, &[f32]),
        views: &[f32],
        known: Option<Tensor<2>>,
    ) -> Tensor<2> {
        let (config, canvas) = (&self.config, self.canvas.as_ref());
        let (weights, canvas) = match positions.dimensions {
            4 => (&self.outer, canvas.map(|c| &c.outer)),
            _ => (&self.inner, canvas.map(|c| &c.inner)),
        };
        let network = config.network(features.dims()[1], positions.dimensions);
        let device = weights.device();
        let mut inputs = Vec::new();
        if let Some(bands) = config.view_bands {
            inputs.push(matrix(
                frequencies(views, 3, bands),
                3 * (1 + 2 * bands),
                &device,
            ));
        }
        if let (Some(encoding), Some(canvas)) = (&config.canvas, canvas) {
            let strokes = encode(encoding, canvas, positions);
            inputs.push(match encoding.hash_grid() {
                Some(grid) if !spreads.is_empty() => strokes * faded(&grid, spreads, &device),
                _ => strokes,
            });
        }
        network.forward(features, inputs, (weights, self.latent.as_ref()), known)
    }
}

/// How much of a canvas is left for a ray whose light comes from a stretch of it: what is finer than
/// the stretch would average out, and read at the mean place instead it is something else for every
/// view. Half of a level is left where the standard deviation of the stretch is one of its cells.
///
/// # Shapes
/// `spreads`: `n`, in the unit cube; result: `[n, levels × features]` in `(0, 1]`. Constants: nothing
/// flows back to where light comes from.
fn faded(grid: &HashGridSpec, spreads: &[f32], device: &Device) -> Tensor<2> {
    let cells: Vec<f32> = (0..grid.levels)
        .map(|level| grid.resolution(level))
        .collect();
    let mut shares = Vec::with_capacity(spreads.len() * grid.outputs());
    for spread in spreads {
        for resolution in &cells {
            let share = 1.0 / (1.0 + (spread * resolution).powi(2));
            shares.extend(std::iter::repeat_n(share, grid.features));
        }
    }
    matrix(shares, grid.outputs(), device)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn fine_levels_fade_before_coarse_ones() {
        let grid = HashGridSpec {
            levels: 2,
            features: 2,
            log2_entries: 8,
            coarsest: 10.0,
            finest: 100.0,
        };
        let found = faded(&grid, &[0.0, 0.01, 0.1], &Device::flex());
        assert_eq!(found.dims(), [3, 4]);
        let found = found.into_data().try_to_vec_as::<f32>().unwrap();
        let wanted = [
            [1.0; 4],
            [1.0 / 1.01, 1.0 / 1.01, 0.5, 0.5],
            [0.5, 0.5, 1.0 / 101.0, 1.0 / 101.0],
        ];
        for (found, wanted) in found.iter().zip(wanted.as_flattened()) {
            assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
        }
    }
}
