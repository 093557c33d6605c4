//! The decoder: VGG-16's first eight convolutions mirrored, from relu4_1 to a picture.

use impasto_kernels::{ConvChain, ConvLayer, Resample};
use impasto_style::{StyleError, TensorFile, write_f16};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Channels of relu4_1.
pub(crate) const CHANNELS: usize = 512;

/// Convolutions with what comes before each, and their channels.
const LAYERS: [(&str, Resample, usize, usize); 8] = [
    ("conv4_1", Resample::Keep, CHANNELS, 256),
    ("conv3_3", Resample::Double, 256, 256),
    ("conv3_2", Resample::Keep, 256, 256),
    ("conv3_1", Resample::Keep, 256, 128),
    ("conv2_2", Resample::Double, 128, 128),
    ("conv2_1", Resample::Keep, 128, 64),
    ("conv1_2", Resample::Double, 64, 64),
    ("conv1_1", Resample::Keep, 64, 3),
];
/// The colour that an untrained decoder paints, nearly.
const GREY: f32 = 0.5;
/// Spread of an untrained last layer relative to the others': colours far outside `[0, 1]` would
/// give losses in their thousands.
const LAST_SPREAD: f32 = 0.02;

/// All numbers of the decoder: of each convolution its weight, then its bias.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decoder {
    pub(crate) params: Vec<f32>,
}

impl Decoder {
    /// Untrained (He et al. 2015).
    pub(crate) fn random(rng: &mut Pcg64) -> Self {
        let mut params = Vec::new();
        for (_, _, inputs, outputs) in LAYERS {
            // Uniform numbers of variance 2 / inputs.
            let (spread, colour) = match outputs {
                3 => (LAST_SPREAD, GREY),
                _ => (1.0, 0.0),
            };
            let bound = spread * (6.0 / (9 * inputs) as f32).sqrt();
            params.extend((0..9 * inputs * outputs).map(|_| rng.random_range(-bound..bound)));
            params.extend(vec![colour; outputs]);
        }
        Self { params }
    }

    /// Reads a safetensors file; `name` is for messages.
    pub(crate) fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, StyleError> {
        let file = TensorFile::open(name, bytes)?;
        let mut params = Vec::new();
        for (layer, _, inputs, outputs) in LAYERS {
            let [weight, bias] = names(layer);
            params.extend(file.floats_of(&weight, 9 * inputs * outputs)?);
            params.extend(file.floats_of(&bias, outputs)?);
        }
        Ok(Self { params })
    }

    /// The file that [`Self::from_bytes`] reads, in half precision.
    pub(crate) fn to_bytes(&self) -> Result<Vec<u8>, StyleError> {
        let names = LAYERS.map(|(layer, ..)| names(layer));
        let mut tensors = Vec::new();
        for ([weight, bias], (_, own_weight, own_bias)) in names.iter().zip(self.layers()) {
            tensors.push((weight.as_str(), own_weight));
            tensors.push((bias.as_str(), own_bias));
        }
        write_f16(&tensors)
    }

    /// The network that these numbers make.
    pub(crate) fn chain(&self) -> ConvChain {
        let layers = self.layers().map(|(resample, weight, bias)| {
            let layer = ConvLayer::new(weight, bias.to_vec(), false, false);
            (resample, layer)
        });
        ConvChain::new(layers.collect()).ending_linear()
    }

    fn layers(&self) -> impl Iterator<Item = (Resample, &[f32], &[f32])> {
        let mut rest = &self.params[..];
        LAYERS
            .into_iter()
            .map(move |(_, resample, inputs, outputs)| {
                let (weight, others) = rest.split_at(9 * inputs * outputs);
                let (bias, others) = others.split_at(outputs);
                rest = others;
                (resample, weight, bias)
            })
    }
}

fn names(layer: &str) -> [String; 2] {
    ["weight", "bias"].map(|part| format!("decoder.{layer}.{part}"))
}
