//! Distilled features (Kobayashi et al. 2022, Tschernezki et al. 2022): what a perceptual network sees
//! around a place in renders from many views, as a field of its own, and with it which way surfaces face. A
//! place looks the same from everywhere then, which what the network says of one render does not.

use crate::config::DISTILLED_FEATURES;
use crate::encoding::{first_entries, vector};
use crate::parameters::Parameters;
use burn::tensor::{Device, Tensor};
use impasto_kernels::{Activation, HashGridSpec, MlpSpec, ops};
use rand::RngExt;
use rand_pcg::Pcg64;

/// What is known of places.
#[derive(Debug, Clone)]
pub struct Surroundings {
    /// What the perceptual network sees there, `[n, DistilledFeatures::LEN]`.
    pub features: Tensor<2>,
    /// Normals in contracted space, `[n, 3]`: of length one as they were learned, shorter where views
    /// disagree.
    pub normals: Tensor<2>,
}

/// A hash grid over contracted space, both volumes in one, and a linear layer.
#[derive(Debug, Clone)]
pub struct DistilledFeatures {
    /// Sizes of the hash grid.
    pub spec: HashGridSpec,
    /// Its table.
    pub encoding: Tensor<1>,
    /// The linear layer, flat.
    pub readout: Tensor<1>,
}

impl DistilledFeatures {
    /// Numbers of the perceptual network that are known of a place.
    pub const LEN: usize = DISTILLED_FEATURES;
    /// All that is known of a place: those, then a normal.
    pub const NUMBERS: usize = Self::LEN + 3;

    fn layer(spec: &HashGridSpec) -> MlpSpec {
        let widths = [spec.outputs(), Self::NUMBERS];
        MlpSpec::relu(&widths, false, Activation::Linear)
    }

    /// Random numbers, as learning begins with.
    pub fn init(spec: HashGridSpec, rng: &mut Pcg64, device: &Device) -> Self {
        let size = (3.0 / spec.outputs() as f32).sqrt();
        let weights = (0..Self::layer(&spec).params()).map(|_| rng.random_range(-size..size));
        Self {
            readout: vector(weights.collect(), device),
            encoding: first_entries(spec.params(), rng, device),
            spec,
        }
    }

    /// Zeros, for reading.
    pub fn zeros(spec: HashGridSpec, device: &Device) -> Self {
        let zeros = |length| Tensor::zeros([length], device);
        Self {
            encoding: zeros(spec.params()),
            readout: zeros(Self::layer(&spec).params()),
            spec,
        }
    }

    /// What is known of places; differentiable in the parameters only.
    ///
    /// # Shapes
    /// `places`: `[n, 3 or more]`, contracted positions first, in `[-1, 1]`; result: `[n, NUMBERS]`.
    pub fn at(&self, places: Tensor<2>) -> Tensor<2> {
        let cube = places.slice_dim(1, 0..3) * 0.5 + 0.5;
        let encoded = ops::hash_encode(cube, self.encoding.clone(), self.spec);
        ops::mlp(encoded, self.readout.clone(), &Self::layer(&self.spec))
    }

    /// [`Self::at`] in its parts.
    pub(crate) fn around(&self, places: Tensor<2>) -> Surroundings {
        let all = self.at(places);
        Surroundings {
            features: all.clone().slice_dim(1, 0..Self::LEN),
            normals: all.slice_dim(1, Self::LEN..Self::NUMBERS),
        }
    }
}

impl Parameters for DistilledFeatures {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        Ok(Self {
            encoding: f("distilled.encoding", &self.encoding)?,
            readout: f("distilled.readout", &self.readout)?,
            spec: self.spec,
        })
    }
}
