//! Sizes of the field. Presets are values of these types; no code asks for a preset's name.

use crate::network::{AppNetwork, Trunk};
use impasto_kernels::cpu::exemplar;
use impasto_kernels::settings::{OutOfRange, usable};
use impasto_kernels::{Activation, Density, HashGridSpec, MlpSpec, OccupancySpec, settings};
use serde::{Deserialize, Serialize};

/// How a position becomes network input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum EncodingConfig {
    /// Multi-resolution hash grid over the cube around the volume.
    HashGrid(HashGridSpec),
    /// `[x, sin 2⁰x, cos 2⁰x, …]` of the 3-D (inner) or 4-D (outer) position.
    Frequency {
        /// Number of octaves, at most 24.
        bands: usize,
    },
}

/// Checks the sizes of a hash grid.
///
/// # Errors
/// If one of them is out of range.
pub fn check_hash_grid(grid: &HashGridSpec, key: &str) -> Result<(), OutOfRange> {
    let fits = (1..=32).contains(&grid.levels)
        && [1, 2, 4, 8].contains(&grid.features)
        && (4..=24).contains(&grid.log2_entries)
        && grid.coarsest >= 1.0
        && grid.coarsest <= grid.finest
        && grid.finest <= 65536.0;
    let allowed = "1 to 32 levels, 1, 2, 4 or 8 features, log2_entries 4 to 24, 1 ≤ coarsest ≤ finest ≤ 65536";
    if fits {
        Ok(())
    } else {
        Err(OutOfRange::new("", key, allowed))
    }
}

impl EncodingConfig {
    /// The sizes, if this is a hash grid.
    pub fn hash_grid(&self) -> Option<HashGridSpec> {
        match *self {
            Self::HashGrid(spec) => Some(spec),
            Self::Frequency { .. } => None,
        }
    }

    /// Width of an encoded position of `dimensions` coordinates.
    pub fn outputs(&self, dimensions: usize) -> usize {
        match self {
            Self::HashGrid(spec) => spec.outputs(),
            Self::Frequency { bands } => dimensions * (1 + 2 * bands),
        }
    }

    fn check(&self, key: &str) -> Result<(), OutOfRange> {
        match self {
            Self::HashGrid(spec) => check_hash_grid(spec, key),
            Self::Frequency { bands } if *bands <= 24 => Ok(()),
            Self::Frequency { .. } => Err(OutOfRange::new("", key, "at most 24 bands")),
        }
    }
}

/// Whether widths of layers are usable.
pub fn widths(all: &[usize]) -> bool {
    all.iter().all(|width| (1..=4096).contains(width))
}

settings! {
    /// Sizes of one volume's `base` and `geo`.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct VolumeConfig {
        /// Encoding of positions.
        pub encoding: EncodingConfig,
        /// Widths of `base` after its input; the last is the width of the features.
        pub base: Vec<usize> where |v| !v.is_empty() && widths(v) => "at least 1 widths of 1 to 4096",
        /// Hidden widths of `geo`.
        pub geo: Vec<usize> where |v| widths(v) => "widths of 1 to 4096",
        /// Density activation.
        pub density: Density,
    }
}

impl VolumeConfig {
    /// Layers of `base`: relu throughout, features included; a plain chain, or with a learned vector
    /// of `latent` numbers the paper's residual trunk.
    pub fn trunk(&self, dimensions: usize, latent: Option<usize>) -> Trunk {
        let inputs = self.encoding.outputs(dimensions);
        if let Some(latent) = latent {
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

settings! {
    /// The paper's cascade: a field of its own says where the samples of the field are to be.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct HierarchicalConfig {
        /// Samples a ray in either volume, spread evenly, for the first field.
        pub first: usize where |v| (3..=4096).contains(v) => "3 to 4096",
        /// Samples a ray in either volume that the second field gets beside those.
        pub more: usize where |v| (1..=4096).contains(v) => "1 to 4096",
        /// Depth before which nothing is sampled, scene units.
        pub near: f32 where |v| usable(*v) => "finite, not negative",
    }
}

/// Where samples are taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SamplingConfig {
    /// Where density grids expect light.
    Occupancy(OccupancySpec),
    /// Where a first field found light (PAPER §3).
    Hierarchical(HierarchicalConfig),
}

/// The whole field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// The unit ball.
    pub inner: VolumeConfig,
    /// Everything beyond it.
    pub outer: VolumeConfig,
    /// Length of the learned vector that both volumes share, which makes `base` the paper's residual
    /// trunk: a first layer, then blocks of two layers, all of one width; and shifts the features
    /// that the photos' `app` sees. `None`: plain chains.
    pub latent: Option<usize>,
    /// Sampling.
    pub sampling: SamplingConfig,
}

impl FieldConfig {
    /// Sampling by density grids, where that is it.
    pub fn occupancy(&self) -> Option<&OccupancySpec> {
        match &self.sampling {
            SamplingConfig::Occupancy(spec) => Some(spec),
            SamplingConfig::Hierarchical(_) => None,
        }
    }

    /// [`Self::occupancy`], to be changed.
    pub fn occupancy_mut(&mut self) -> Option<&mut OccupancySpec> {
        match &mut self.sampling {
            SamplingConfig::Occupancy(spec) => Some(spec),
            SamplingConfig::Hierarchical(_) => None,
        }
    }

    /// Whether an encoding wants positions as they are, not in the unit cube.
    pub(crate) fn wants_raw(&self) -> bool {
        [&self.inner, &self.outer]
            .iter()
            .any(|v| v.encoding.hash_grid().is_none())
    }

    /// Fields: two in a cascade, of which the last is rendered.
    pub fn levels(&self) -> usize {
        1 + usize::from(self.occupancy().is_none())
    }

    /// Samples a ray that have to be evaluated, in both volumes together.
    pub fn samples(&self) -> usize {
        match &self.sampling {
            SamplingConfig::Occupancy(spec) => spec.samples,
            SamplingConfig::Hierarchical(c) => 2 * (2 * c.first + c.more),
        }
    }

    /// Checks every size.
    ///
    /// # Errors
    /// The first that is out of range, with its name behind `path`.
    pub fn check(&self, path: &str) -> Result<(), OutOfRange> {
        if !self.latent.is_none_or(|n| (1..=4096).contains(&n)) {
            return Err(OutOfRange::new(path, "latent", "1 to 4096, or null"));
        }
        for (name, volume) in [("inner", &self.inner), ("outer", &self.outer)] {
            let path = format!("{path}.{name}");
            volume.check(&path)?;
            volume.encoding.check(&format!("{path}.encoding"))?;
            let base = &volume.base;
            let residual = base.len() % 2 == 1 && base.iter().all(|w| *w == volume.features());
            if self.latent.is_some() && !residual {
                let allowed = "an odd number of equal widths where there is a latent vector";
                return Err(OutOfRange::new(&path, "base", allowed));
            }
        }
        let path = format!("{path}.sampling");
        match &self.sampling {
            SamplingConfig::Occupancy(spec) => spec.check(&format!("{path}.occupancy")),
            SamplingConfig::Hierarchical(spec) => spec.check(&format!("{path}.hierarchical")),
        }
    }
}

/// Where `app` is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shading {
    /// At every sample, then composited (the paper's volume rendering).
    Samples,
    /// Deferred: once per ray and volume, on the samples' means, which is several times cheaper, and paint
    /// keeps its contrast where a surface is a haze of several samples. `app` sees what means the same in
    /// every scene: the unstylised colour, in the painting's whitened colours, what a perceptual network
    /// sees around the place, and the painting's own detail laid over surfaces. It says how much of that
    /// detail is added to that colour and what else, so that neither palettes nor strokes need be learned.
    Painted(PaintSpec),
}

/// Numbers that distilled features say of a place.
pub const DISTILLED_FEATURES: usize = 20;

/// Bands of a painting's detail, from fine to coarse, three colours each: the first numbers of an exemplar's
/// texels. The painter says how much of each there is.
pub const DETAIL_BANDS: usize = 3;

/// Sizes of what the painter sees beside colours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaintSpec {
    /// Hash grid of the scene's distilled features, by which strokes know what they are on.
    pub distilled: HashGridSpec,
}

impl PaintSpec {
    /// Checks every size.
    ///
    /// # Errors
    /// The first that is out of range, with its name behind `path`.
    pub fn check(&self, path: &str) -> Result<(), OutOfRange> {
        check_hash_grid(&self.distilled, &format!("{path}.distilled"))
    }
}

impl Shading {
    /// What is painted with, where anything is.
    pub fn paint(&self) -> Option<&PaintSpec> {
        match self {
            Self::Painted(paint) => Some(paint),
            Self::Samples => None,
        }
    }
}

settings! {
    /// Sizes of `app`.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct AppConfig {
        /// Hidden widths.
        pub hidden: Vec<usize> where |v| widths(v) => "widths of 1 to 4096",
        /// LayerNorm before each hidden relu (the paper's choice for predicted weights).
        pub layer_norm: bool,
        /// Octaves of the unit view direction that `app` sees; `None` hides the direction. For
        /// styles, a built-in source of disagreement between views.
        pub view_bands: Option<usize> where |v| v.is_none_or(|b| b <= 24) => "at most 24",
        /// Whether a linear layer, as wide as the features, comes before anything joins them (the
        /// paper's).
        pub remap: bool,
    }
}

/// What an appearance is: layers of `app`, and how its weights become pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct AppearanceConfig {
    /// Layers.
    pub app: AppConfig,
    /// Where it is evaluated.
    pub shading: Shading,
    /// Length of the field's learned vector that shifts the features before anything joins them (the
    /// paper's geometry stage).
    pub latent: Option<usize>,
}

impl AppearanceConfig {
    /// Layers of `app`, on features of width `features` where it sees any.
    pub fn network(&self, features: usize) -> AppNetwork {
        let view = self.app.view_bands.map_or(0, |bands| 3 * (1 + 2 * bands));
        // What the painter sees first is a colour.
        let (features, others, outputs, last) = match self.shading {
            Shading::Painted(_) => {
                let others = DISTILLED_FEATURES + exemplar::FEATURES;
                (3, others, 3 + DETAIL_BANDS, Activation::Linear)
            }
            Shading::Samples => (features, view, 3, Activation::Sigmoid),
        };
        let mut widths = vec![features + others];
        widths.extend(&self.app.hidden);
        widths.push(outputs);
        let linear = |inputs| MlpSpec::relu(&[inputs, features], false, Activation::Linear);
        AppNetwork {
            features,
            remap: self.app.remap.then(|| linear(features)),
            chain: MlpSpec::relu(&widths, self.app.layer_norm, last),
            shift: self.latent.map(linear),
        }
    }
}
