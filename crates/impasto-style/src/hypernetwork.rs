//! The hypernetwork Ψ (PAPER §6): one small MLP per predicted layer of `app`.

use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::{Activation, LayerSpec, MlpSpec, ops};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sizes of the hypernetwork of one `app`.
#[derive(Debug, Clone)]
pub struct Hypernetwork {
    layers: Vec<MlpSpec>,
}

/// Its weights, one flat vector per predicted layer.
#[derive(Debug, Clone)]
pub struct HypernetworkWeights(pub Vec<Tensor<1>>);

/// Scale of the last layers' initial weights, so that styles start close to each other.
const LAST_SCALE: f32 = 0.1;

impl Hypernetwork {
    /// Predicts the layers of `app` from codes of length `code` through two hidden layers.
    pub fn new<'a>(
        code: usize,
        hidden: usize,
        app: impl IntoIterator<Item = &'a LayerSpec>,
    ) -> Self {
        let layer =
            |outputs| MlpSpec::relu(&[code, hidden, hidden, outputs], false, Activation::Linear);
        Self {
            layers: app.into_iter().map(|l| layer(l.params())).collect(),
        }
    }

    /// Lengths of the weight vectors.
    pub fn lengths(&self) -> Vec<usize> {
        self.layers.iter().map(MlpSpec::params).collect()
    }

    /// Kaiming-normal weights (fan-in), the last layer's times 0.1; biases uniform in
    /// ±1/√fan_in.
    pub fn init(&self, rng: &mut Pcg64, device: &Device) -> HypernetworkWeights {
        let tensors = self.layers.iter().map(|spec| {
            let last = spec.layers().len() - 1;
            let mut flat = Vec::with_capacity(spec.params());
            for (i, layer) in spec.layers().iter().enumerate() {
                let std =
                    (2.0 / layer.inputs as f32).sqrt() * if i == last { LAST_SCALE } else { 1.0 };
                flat.extend((0..layer.inputs * layer.outputs).map(|_| normal(rng) * std));
                let bound = (layer.inputs as f32).sqrt().recip();
                flat.extend((0..layer.outputs).map(|_| rng.random_range(-bound..bound)));
            }
            let length = flat.len();
            Tensor::from_data(TensorData::new(flat, [length]), device)
        });
        HypernetworkWeights(tensors.collect())
    }

    /// W^app of a style code.
    ///
    /// # Shapes
    /// `code`: `[1, code]`; result: the flat parameters of `app`.
    pub fn predict(&self, weights: &HypernetworkWeights, code: &Tensor<2>) -> Tensor<1> {
        let parts = self
            .layers
            .iter()
            .zip(&weights.0)
            .map(|(spec, w)| ops::mlp(code.clone(), w.clone(), spec).squeeze_dim(0))
            .collect();
        Tensor::cat(parts, 0)
    }
}

/// A standard normal number (Box–Muller).
pub(crate) fn normal(rng: &mut Pcg64) -> f32 {
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * rng.random::<f32>()).cos()
}
