//! One volume's shape: encoding, `base` and `geo`.

use crate::appearance::AppearanceConfig;
use crate::config::{DensityActivation, VolumeConfig};
use crate::encoding::{Positions, encode};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::{Density, MlpSpec, VolumeSpec, ops};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sizes of one volume.
#[derive(Debug, Clone)]
pub struct Branch {
    config: VolumeConfig,
    dimensions: usize,
    base: MlpSpec,
    geo: MlpSpec,
}

/// A branch's weights, each one flat vector: plain tensors or leaves of an autodiff graph.
#[derive(Debug, Clone)]
pub struct BranchWeights {
    /// Hash table (one number when the encoding has none).
    pub encoding: Tensor<1>,
    /// `base`.
    pub base: Tensor<1>,
    /// `geo`.
    pub geo: Tensor<1>,
}

/// Uniform Kaiming initialisation (fan-in, relu gain) of every layer; zero biases.
pub fn kaiming(spec: &MlpSpec, rng: &mut Pcg64, device: &Device) -> Tensor<1> {
    let mut flat = Vec::with_capacity(spec.params());
    for layer in spec.layers() {
        let bound = (6.0 / layer.inputs as f32).sqrt();
        flat.extend((0..layer.inputs * layer.outputs).map(|_| rng.random_range(-bound..bound)));
        flat.extend(std::iter::repeat_n(0.0, layer.outputs));
    }
    vector(flat, device)
}

/// A flat vector as a tensor.
pub fn vector(data: Vec<f32>, device: &Device) -> Tensor<1> {
    let length = data.len();
    Tensor::from_data(TensorData::new(data, [length]), device)
}

/// Size of a hash table's first entries (Müller et al. 2022).
const FIRST_ENTRIES: f32 = 1e-4;

/// A hash table with entries uniform in ±`size`, or a single unused number for other encodings.
pub fn encoding_weights(
    config: &crate::EncodingConfig,
    size: f32,
    rng: &mut Pcg64,
    device: &Device,
) -> Tensor<1> {
    let length = config.hash_grid().map_or(1, |g| g.params());
    vector(
        (0..length).map(|_| rng.random_range(-size..size)).collect(),
        device,
    )
}

impl Branch {
    /// A branch over positions of `dimensions` coordinates (3 inner, 4 outer).
    pub fn new(config: VolumeConfig, dimensions: usize) -> Self {
        Self {
            base: config.base_spec(dimensions),
            geo: config.geo_spec(),
            config,
            dimensions,
        }
    }

    /// Coordinates of a position.
    pub fn dimensions(&self) -> usize {
        self.dimensions
    }

    /// Width of the features.
    pub fn features(&self) -> usize {
        self.config.features()
    }

    /// Random weights.
    pub fn init(&self, rng: &mut Pcg64, device: &Device) -> BranchWeights {
        BranchWeights {
            encoding: encoding_weights(&self.config.encoding, FIRST_ENTRIES, rng, device),
            base: kaiming(&self.base, rng, device),
            geo: kaiming(&self.geo, rng, device),
        }
    }

    /// Lengths of the three weight vectors, for checking files.
    pub fn lengths(&self) -> [usize; 3] {
        [
            self.config.encoding.hash_grid().map_or(1, |g| g.params()),
            self.base.params(),
            self.geo.params(),
        ]
    }

    /// Layers from encoding to colour, with an `app` on this branch's features.
    pub(crate) fn volume_spec(&self, app: &AppearanceConfig) -> VolumeSpec {
        VolumeSpec {
            base: self.base.clone(),
            geo: self.geo.clone(),
            density: match self.config.density {
                DensityActivation::Exp => Density::Exp,
                DensityActivation::Abs => Density::Abs,
            },
            app: app.spec(self.features(), self.dimensions),
        }
    }

    /// Encoded positions, `[n, width of the encoding]`.
    pub(crate) fn encode(&self, weights: &BranchWeights, positions: &Positions<'_>) -> Tensor<2> {
        encode(&self.config.encoding, &weights.encoding, positions)
    }

    /// Features and density at positions.
    ///
    /// # Shapes
    /// `n` positions; result: `[n, features]` and `[n]`, densities non-negative. Positions are not
    /// differentiated.
    pub fn geometry(
        &self,
        weights: &BranchWeights,
        positions: &Positions<'_>,
    ) -> (Tensor<2>, Tensor<1>) {
        let encoded = self.encode(weights, positions);
        let features = ops::mlp(encoded, weights.base.clone(), &self.base);
        let raw: Tensor<1> =
            ops::mlp(features.clone(), weights.geo.clone(), &self.geo).squeeze_dim(1);
        let density = match self.config.density {
            DensityActivation::Exp => raw.clamp(-15.0, 15.0).exp(),
            DensityActivation::Abs => raw.abs(),
        };
        (features, density)
    }
}
