//! One volume's shape: encoding, `base` and `geo`.

use crate::config::{DensityActivation, VolumeConfig};
use crate::encoding::{Positions, encode};
use crate::network::{AppNetwork, Trunk};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::{Density, HashGridSpec, LayerSpec, MlpSpec, Volume, VolumeSpec, ops};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sizes of one volume.
#[derive(Debug, Clone)]
pub struct Branch {
    config: VolumeConfig,
    dimensions: usize,
    trunk: Trunk,
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
    /// The learned vector that both volumes share, where the trunk takes one.
    pub latent: Option<Tensor<1>>,
}

/// Uniform Kaiming initialisation (fan-in, relu gain) of layers whose parameters follow each other;
/// zero biases.
pub fn kaiming<'a>(
    layers: impl IntoIterator<Item = &'a LayerSpec>,
    rng: &mut Pcg64,
    device: &Device,
) -> Tensor<1> {
    let mut flat = Vec::new();
    for layer in layers {
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
            trunk: config.trunk(dimensions),
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

    /// Random weights, with the learned vector that both volumes share.
    pub fn init(
        &self,
        rng: &mut Pcg64,
        device: &Device,
        latent: Option<Tensor<1>>,
    ) -> BranchWeights {
        BranchWeights {
            encoding: encoding_weights(&self.config.encoding, FIRST_ENTRIES, rng, device),
            base: kaiming(self.trunk.layers(), rng, device),
            geo: kaiming(self.geo.layers(), rng, device),
            latent,
        }
    }

    /// Lengths of the three weight vectors, for checking files.
    pub fn lengths(&self) -> [usize; 3] {
        [
            self.config.encoding.hash_grid().map_or(1, |g| g.params()),
            self.trunk.params(),
            self.geo.params(),
        ]
    }

    /// Length of the learned vector.
    pub fn latent(&self) -> Option<usize> {
        self.config.latent
    }

    /// The hash grid, if that is the encoding.
    pub(crate) fn hash_grid(&self) -> Option<HashGridSpec> {
        self.config.encoding.hash_grid()
    }

    /// Layers of `base` and `geo`, and what the last number says.
    pub(crate) fn layers(&self) -> (&MlpSpec, &MlpSpec, Density) {
        let density = match self.config.density {
            DensityActivation::Exp => Density::Exp,
            DensityActivation::Abs => Density::Abs,
        };
        (self.trunk.chain(), &self.geo, density)
    }

    /// Weights of the layers of `base`.
    pub(crate) fn folded(&self, weights: &BranchWeights) -> Tensor<1> {
        self.trunk.folded(&weights.base, weights.latent.as_ref())
    }

    /// Layers from encoding to colour, with an `app` on this branch's features.
    pub(crate) fn volume_spec(&self, app: &AppNetwork) -> VolumeSpec {
        let (base, geo, density) = self.layers();
        VolumeSpec {
            base: base.clone(),
            geo: geo.clone(),
            density,
            app: app.chain().clone(),
        }
    }

    /// Encoded positions and the weights of [`Self::volume_spec`]'s layers.
    pub(crate) fn volume(
        &self,
        weights: &BranchWeights,
        positions: &Positions<'_>,
        (app, app_weights): (&AppNetwork, &Tensor<1>),
        app_latent: Option<&Tensor<1>>,
    ) -> Volume<Tensor<1>> {
        let encoded = self.encode(weights, positions);
        let [rows, width] = encoded.dims();
        Volume {
            encoded: encoded.reshape([rows * width]),
            base: self.folded(weights),
            geo: weights.geo.clone(),
            app: app.folded(app_weights, app_latent),
        }
    }

    /// Encoded positions, `[n, width of the encoding]`.
    fn encode(&self, weights: &BranchWeights, positions: &Positions<'_>) -> Tensor<2> {
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
        let features = self
            .trunk
            .forward(encoded, &weights.base, weights.latent.as_ref());
        let raw: Tensor<1> =
            ops::mlp(features.clone(), weights.geo.clone(), &self.geo).squeeze_dim(1);
        let density = match self.config.density {
            DensityActivation::Exp => raw.clamp(-15.0, 15.0).exp(),
            DensityActivation::Abs => raw.abs(),
        };
        (features, density)
    }
}
