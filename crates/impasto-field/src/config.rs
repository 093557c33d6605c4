//! Sizes of the field. Presets are values of these types; no code asks for a preset's name.

use crate::network::Trunk;
use impasto_kernels::{Activation, HashGridSpec, MlpSpec};
use serde::{Deserialize, Serialize};

/// How a position becomes network input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum EncodingConfig {
    /// Multi-resolution hash grid over the cube around the volume.
    HashGrid {
        /// Resolutions.
        levels: usize,
        /// Numbers per entry.
        features: usize,
        /// log₂ of the entries per level.
        log2_entries: u32,
        /// Cells along an axis, coarsest level.
        coarsest: f32,
        /// Cells along an axis, finest level.
        finest: f32,
    },
    /// `[x, sin 2⁰x, cos 2⁰x, …]` of the 3-D (inner) or 4-D (outer) position.
    Frequency {
        /// Number of octaves.
        bands: usize,
    },
}

impl EncodingConfig {
    /// The kernel's sizes, if this is a hash grid.
    pub fn hash_grid(&self) -> Option<HashGridSpec> {
        match *self {
            Self::HashGrid {
                levels,
                features,
                log2_entries,
                coarsest,
                finest,
            } => Some(HashGridSpec {
                levels,
                features,
                log2_entries,
                coarsest,
                finest,
            }),
            Self::Frequency { .. } => None,
        }
    }

    /// Width of an encoded position of `dimensions` coordinates.
    pub fn outputs(&self, dimensions: usize) -> usize {
        match self {
            Self::HashGrid {
                levels, features, ..
            } => levels * features,
            Self::Frequency { bands } => dimensions * (1 + 2 * bands),
        }
    }
}

/// How the last number of `geo` becomes a density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DensityActivation {
    /// `e^x`, with x limited to ±15.
    Exp,
    /// `|x|`, the paper's.
    Abs,
}

/// Sizes of one volume's `base` and `geo`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeConfig {
    /// Encoding of positions.
    pub encoding: EncodingConfig,
    /// Widths of `base` after its input; the last is the width of the features.
    pub base: Vec<usize>,
    /// Length of the learned vector that makes `base` the paper's residual trunk: a first layer,
    /// then blocks of two layers, all of one width. `None`: a plain chain.
    #[serde(default)]
    pub latent: Option<usize>,
    /// Hidden widths of `geo`.
    pub geo: Vec<usize>,
    /// Density activation.
    pub density: DensityActivation,
}

impl VolumeConfig {
    /// Layers of `base`: relu throughout, features included.
    pub fn trunk(&self, dimensions: usize) -> Trunk {
        let inputs = self.encoding.outputs(dimensions);
        if let Some(latent) = self.latent {
            let blocks = self.base.len().saturating_sub(1) / 2;
            return Trunk::residual(inputs, self.features(), blocks, latent);
        }
        let mut widths = vec![inputs];
        widths.extend(&self.base);
        Trunk::plain(&widths)
    }

    /// Layers of `geo`, from features to one number.
    pub fn geo_spec(&self) -> MlpSpec {
        let mut widths = vec![self.features()];
        widths.extend(&self.geo);
        widths.push(1);
        MlpSpec::relu(&widths, false, Activation::Linear)
    }

    /// Width of the features that `base` hands to `geo` and `app`.
    pub fn features(&self) -> usize {
        self.base.last().copied().unwrap_or(0)
    }
}

/// Where samples are taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplingConfig {
    /// Samples a ray, in both volumes together.
    pub samples: usize,
    /// Weight of spreading them evenly, where sending them to the light that the density grids
    /// expect has weight 1.
    pub explore: f32,
    /// Distance between two looks at the inner density grid, scene units.
    pub inner_step: f32,
    /// Looks at the outer density grid, equal steps of inverse radius.
    pub outer_steps: usize,
    /// Cells along an axis of the inner density grid.
    pub inner_grid: usize,
    /// Cells along an axis of the outer density grid.
    pub outer_grid: usize,
    /// Depth before which nothing is sampled, scene units.
    pub near: f32,
}

/// The paper's cascade: a field of its own says where the samples of the field are to be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CascadeConfig {
    /// Samples a ray in either volume, spread evenly, for the first field.
    pub first: usize,
    /// Samples a ray in either volume that the second field gets beside those.
    pub more: usize,
}

/// The whole field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// The unit ball.
    pub inner: VolumeConfig,
    /// Everything beyond it.
    pub outer: VolumeConfig,
    /// Sampling.
    pub sampling: SamplingConfig,
    /// Replaces sampling by density grids, but for its `near`.
    #[serde(default)]
    pub cascade: Option<CascadeConfig>,
}

impl FieldConfig {
    /// Samples a ray that have to be looked at, in both volumes together.
    pub fn samples(&self) -> usize {
        match &self.cascade {
            None => self.sampling.samples,
            Some(cascade) => 2 * (2 * cascade.first + cascade.more),
        }
    }
}
