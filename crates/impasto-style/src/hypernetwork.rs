//! The hypernetwork Ψ (PAPER §6): one small MLP per predicted layer of `app`.

use burn::tensor::{Device, Tensor};
use impasto_kernels::{Activation, LayerSpec, MlpSpec, ops};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sizes of the hypernetwork of one `app`.
#[derive(Debug, Clone)]
pub struct Hypernetwork {
    layers: Vec<LayerSource>,
}

/// Where the weights of a layer of `app` come from.
#[derive(Debug, Clone)]
enum LayerSource {
    /// A network of its own predicts them from the style code.
    Predicted(MlpSpec),
    /// They are learned, the same for all styles.
    Shared(LayerSpec),
}

impl LayerSource {
    fn params(&self) -> usize {
        match self {
            Self::Predicted(spec) => spec.params(),
            Self::Shared(layer) => layer.params(),
        }
    }
}

/// Its weights, one flat vector per predicted layer.
#[derive(Debug, Clone)]
pub struct HypernetworkWeights(pub Vec<Tensor<1>>);

/// Scale of the last layers' initial weights, so that styles start close to each other.
const LAST_SCALE: f32 = 0.1;

impl Hypernetwork {
    /// Predicts the last `predicted` layers of `app` (the paper: all) from codes of length `code`
    /// through two hidden layers each.
    pub fn new<'a>(
        code: usize,
        hidden: usize,
        app: impl IntoIterator<Item = &'a LayerSpec>,
        predicted: usize,
    ) -> Self {
        let app: Vec<&LayerSpec> = app.into_iter().collect();
        let shared = app.len().saturating_sub(predicted);
        let layers = app.into_iter().enumerate().map(|(i, layer)| {
            if i < shared {
                return LayerSource::Shared(*layer);
            }
            let widths = [code, hidden, hidden, layer.params()];
            LayerSource::Predicted(MlpSpec::relu(&widths, false, Activation::Linear))
        });
        Self {
            layers: layers.collect(),
        }
    }

    /// Lengths of the weight vectors.
    pub fn lengths(&self) -> Vec<usize> {
        self.layers.iter().map(LayerSource::params).collect()
    }

    /// Kaiming-normal weights (fan-in), the last layer's of a predicting network times 0.1; biases
    /// uniform in ±1/√fan_in.
    pub fn init(&self, rng: &mut Pcg64, device: &Device) -> HypernetworkWeights {
        let mut vectors = Vec::with_capacity(self.layers.len());
        for source in &self.layers {
            let mut flat = Vec::with_capacity(source.params());
            match source {
                LayerSource::Shared(layer) => first_weights(layer, 1.0, rng, &mut flat),
                LayerSource::Predicted(spec) => {
                    let last = spec.layers().len() - 1;
                    for (i, layer) in spec.layers().iter().enumerate() {
                        let scale = if i == last { LAST_SCALE } else { 1.0 };
                        first_weights(layer, scale, rng, &mut flat);
                    }
                }
            }
            vectors.push(Tensor::from_data(flat.as_slice(), device));
        }
        HypernetworkWeights(vectors)
    }

    /// W^app of a style code.
    ///
    /// # Shapes
    /// `code`: `[1, code]`; result: the flat parameters of `app`.
    pub fn predict(&self, weights: &HypernetworkWeights, code: &Tensor<2>) -> Tensor<1> {
        let layers = self.layers.iter().zip(&weights.0);
        let parts = layers.map(|(source, w)| match source {
            LayerSource::Predicted(spec) => ops::mlp(code.clone(), w.clone(), spec).squeeze_dim(0),
            LayerSource::Shared(_) => w.clone(),
        });
        Tensor::cat(parts.collect(), 0)
    }
}

fn first_weights(layer: &LayerSpec, scale: f32, rng: &mut Pcg64, into: &mut Vec<f32>) {
    let std = (2.0 / layer.inputs as f32).sqrt() * scale;
    into.extend((0..layer.inputs * layer.outputs).map(|_| normal(rng) * std));
    let bound = (layer.inputs as f32).sqrt().recip();
    into.extend((0..layer.outputs).map(|_| rng.random_range(-bound..bound)));
}

/// A standard normal number (Box–Muller).
pub(crate) fn normal(rng: &mut Pcg64) -> f32 {
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * rng.random::<f32>()).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn layers_that_are_not_predicted_are_the_same_for_all_codes() {
        let app = MlpSpec::relu(&[6, 5, 4, 3], true, Activation::Sigmoid);
        let network = Hypernetwork::new(8, 7, app.layers(), 2);
        let (device, mut rng) = (Device::flex(), Pcg64::seed_from_u64(1));
        let weights = network.init(&mut rng, &device);
        let shared = app.layers()[0].params();
        assert_eq!(network.lengths()[0], shared);
        let [one, other] = [0.5f32, -1.0].map(|x| {
            let code = Tensor::<1>::from_data([x; 8].as_slice(), &device).unsqueeze();
            let predicted = network.predict(&weights, &code);
            predicted.try_into_vec_as::<f32>().unwrap_or_default()
        });
        assert_eq!(one.len(), app.params());
        assert_eq!(one[..shared], other[..shared]);
        let differ = one.iter().zip(&other).skip(shared).filter(|(a, b)| a != b);
        assert!(differ.count() > (app.params() - shared) / 2);
    }
}
