//! One volume's shape: encoding, `base` and `geo`.

use crate::config::VolumeConfig;
use crate::encoding::{Positions, encode, first_entries, vector};
use crate::network::{AppNetwork, Trunk};
use burn::tensor::{Device, Tensor};
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

impl Branch {
    /// A branch over positions of `dimensions` coordinates (3 inner, 4 outer), with a learned vector
    /// of `latent` numbers where the trunk is residual.
    pub fn new(config: VolumeConfig, dimensions: usize, latent: Option<usize>) -> Self {
        Self {
            trunk: config.trunk(dimensions, latent),
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
        // Unused by frequencies, but drawn: every encoding has a vector.
        let length = self.hash_grid().map_or(1, |grid| grid.params());
        let encoding = first_entries(length, rng, device);
        BranchWeights {
            encoding,
            base: kaiming(self.trunk.layers(), rng, device),
            geo: kaiming(self.geo.layers(), rng, device),
        }
    }

    /// Zero weights, for reading.
    pub fn zeros(&self, device: &Device) -> BranchWeights {
        let zeros = |length| Tensor::zeros([length], device);
        BranchWeights {
            encoding: zeros(self.hash_grid().map_or(1, |grid| grid.params())),
            base: zeros(self.trunk.params()),
            geo: zeros(self.geo.params()),
        }
    }

    /// The hash grid, if that is the encoding.
    pub(crate) fn hash_grid(&self) -> Option<HashGridSpec> {
        self.config.encoding.hash_grid()
    }

    /// Layers of `base` and `geo`, and what the last number says.
    pub(crate) fn layers(&self) -> (&MlpSpec, &MlpSpec, Density) {
        (self.trunk.chain(), &self.geo, self.config.density)
    }

    /// Weights of the layers of `base`; `latent` is the field's learned vector.
    pub(crate) fn folded(&self, weights: &BranchWeights, latent: Option<&Tensor<1>>) -> Tensor<1> {
        self.trunk.folded(&weights.base, latent)
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
        latent: Option<&Tensor<1>>,
        positions: &Positions<'_>,
        app: Tensor<1>,
    ) -> Volume<Tensor<1>> {
        let encoded = self.encode(weights, positions);
        let [rows, width] = encoded.dims();
        Volume {
            encoded: encoded.reshape([rows * width]),
            base: self.folded(weights, latent),
            geo: weights.geo.clone(),
            app,
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
    pub fn evaluate(
        &self,
        weights: &BranchWeights,
        latent: Option<&Tensor<1>>,
        positions: &Positions<'_>,
    ) -> (Tensor<2>, Tensor<1>) {
        let encoded = self.encode(weights, positions);
        let features = self.trunk.forward(encoded, &weights.base, latent);
        let raw: Tensor<1> =
            ops::mlp(features.clone(), weights.geo.clone(), &self.geo).squeeze_dim(1);
        let density = match self.config.density {
            Density::Exp => raw.clamp(-15.0, 15.0).exp(),
            Density::Abs => raw.abs(),
        };
        (features, density)
    }
}
