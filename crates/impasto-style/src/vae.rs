//! The style-VAE (PAPER §5): a painting's statistics to a code, and back.

use crate::Network;
use crate::perceptual::Statistics;
use crate::{StyleError, TensorFile, write_f16};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::{Activation, MlpSpec, cpu};
use serde::{Deserialize, Serialize};

/// The shipped weights, made by `impasto train-encoder`.
pub(crate) static SHIPPED: [u8; 15_227_520] =
    *include_bytes!("../../../assets/style_vae_f16.safetensors");
pub(crate) const WIDTH: usize = 1024;

/// z_S: a painting as the hypernetwork sees it.
///
/// The VAE's μ, each number times a fixed gain that grows with what it changes about the decoded
/// statistics. μ itself is white: the trifles that the last hundred numbers describe would weigh
/// as much as the palette, and paintings never seen would land far from all known ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StyleCode(pub Vec<f32>);

impl StyleCode {
    /// Length of every code.
    pub const LEN: usize = 512;

    /// The weighted mean of codes; weights need not sum to one. `None` if their sum is not
    /// positive.
    pub fn mix(codes: &[(Self, f32)]) -> Option<Self> {
        let total: f32 = codes.iter().map(|(_, w)| w).sum();
        (total > 0.0 && total.is_finite()).then(|| {
            let mut sum = vec![0.0; Self::LEN];
            for (code, weight) in codes {
                for (s, c) in sum.iter_mut().zip(&code.0) {
                    *s += c * weight / total;
                }
            }
            Self(sum)
        })
    }

    /// As a network input, `[1, 512]`.
    pub fn tensor(&self, device: &Device) -> Tensor<2> {
        Tensor::from_data(TensorData::new(self.0.clone(), [1, Self::LEN]), device)
    }
}

/// Which statistics a style-VAE reads and rebuilds: always the last ones of [`Statistics`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StyleInput {
    /// All four layers, 1,920 numbers: deeper layers say little about colours and fine texture.
    All,
    /// Mean and deviation at relu4_1 alone, 1,024 numbers, as in the paper.
    #[serde(rename = "relu4_1")]
    Relu4_1,
}

impl StyleInput {
    /// How many of the last statistics are read.
    pub const fn numbers(self) -> usize {
        match self {
            Self::All => Statistics::LEN,
            Self::Relu4_1 => 2 * 512,
        }
    }

    fn of(numbers: usize) -> Option<Self> {
        let both = [Self::All, Self::Relu4_1];
        both.into_iter().find(|input| input.numbers() == numbers)
    }

    /// The part that is read.
    pub(crate) fn part(self, statistics: &Statistics) -> &[f32] {
        &statistics.0[Statistics::LEN - self.numbers()..]
    }
}

/// Encoder and decoder with the standardisation of their statistics.
#[derive(Debug, Clone)]
pub struct StyleVae {
    pub(crate) network: Network,
    pub(crate) input: StyleInput,
    pub(crate) mean: Vec<f32>,
    pub(crate) scale: Vec<f32>,
    /// What μ is multiplied with to give a code.
    pub(crate) gain: Vec<f32>,
    pub(crate) encoder: Vec<f32>,
    pub(crate) decoder: Vec<f32>,
}

pub(crate) fn encoder_spec(input: StyleInput) -> MlpSpec {
    MlpSpec::relu(
        &[input.numbers(), WIDTH, WIDTH, 2 * StyleCode::LEN],
        false,
        Activation::Linear,
    )
}

pub(crate) fn decoder_spec(input: StyleInput) -> MlpSpec {
    MlpSpec::relu(
        &[StyleCode::LEN, WIDTH, WIDTH, input.numbers()],
        false,
        Activation::Linear,
    )
}

impl StyleVae {
    /// The shipped encoder.
    ///
    /// # Errors
    /// If the asset is damaged.
    pub fn shipped() -> Result<Self, StyleError> {
        Self::from_bytes("style_vae_f16.safetensors", &SHIPPED)
    }

    /// Reads stored weights; `name` is for messages.
    ///
    /// # Errors
    /// If a tensor is missing, has another length, or holds what no number can be divided by.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, StyleError> {
        let fault = |reason: String| StyleError::weights(name, reason);
        let file = TensorFile::open(name, bytes)?;
        let mean = file.floats("mean")?;
        let input = StyleInput::of(mean.len()).ok_or_else(|| {
            fault(format!(
                "is made for {} statistics, {} or {} were expected",
                mean.len(),
                StyleInput::All.numbers(),
                StyleInput::Relu4_1.numbers()
            ))
        })?;
        // Older files do not say: there was one network only.
        let number = if file.has("perceptual") {
            file.floats_of("perceptual", 1)?[0]
        } else {
            Network::Vgg16.number()
        };
        let network = [Network::Vgg16, Network::Vgg19]
            .into_iter()
            .find(|network| network.number() == number)
            .ok_or_else(|| fault(format!("is made for an unknown network, {number}")))?;
        let vae = Self {
            network,
            input,
            mean,
            scale: file.floats_of("scale", input.numbers())?,
            gain: file.floats_of("gain", StyleCode::LEN)?,
            encoder: file.floats_of("encoder", encoder_spec(input).params())?,
            decoder: file.floats_of("decoder", decoder_spec(input).params())?,
        };
        let all = [&vae.mean, &vae.scale, &vae.gain, &vae.encoder, &vae.decoder];
        let finite = all.into_iter().flatten().all(|x| x.is_finite());
        if finite && vae.scale.iter().chain(&vae.gain).all(|x| *x > 0.0) {
            Ok(vae)
        } else {
            Err(fault(
                "holds numbers that no encoder has; train it again".into(),
            ))
        }
    }

    /// The same, said to read the statistics of `network`.
    #[must_use]
    pub fn of_network(self, network: Network) -> Self {
        Self { network, ..self }
    }

    /// The network whose statistics it reads.
    pub fn network(&self) -> Network {
        self.network
    }

    /// Which statistics it reads.
    pub fn input(&self) -> StyleInput {
        self.input
    }

    /// The same, with codes that are μ itself.
    #[must_use]
    pub fn unweighed(self) -> Self {
        let gain = vec![1.0; self.gain.len()];
        Self { gain, ..self }
    }

    /// Its weights in half precision.
    ///
    /// # Errors
    /// If safetensors refuses them.
    pub fn to_bytes(&self) -> Result<Vec<u8>, StyleError> {
        write_f16(&[
            ("perceptual", &[self.network.number()]),
            ("mean", &self.mean),
            ("scale", &self.scale),
            ("gain", &self.gain),
            ("encoder", &self.encoder),
            ("decoder", &self.decoder),
        ])
    }

    pub(crate) fn standardised(&self, statistics: &Statistics) -> Vec<f32> {
        self.standardised_part(self.input.part(statistics))
    }

    fn standardised_part(&self, part: &[f32]) -> Vec<f32> {
        let numbers = part.iter().zip(self.mean.iter().zip(&self.scale));
        numbers.map(|(x, (m, s))| (x - m) / s).collect()
    }

    /// The code of a painting's statistics, of which it takes the [part](StyleInput) it reads.
    pub fn encode(&self, statistics: &Statistics) -> StyleCode {
        let mut code = cpu::mlp::forward(
            &encoder_spec(self.input),
            &self.standardised(statistics),
            &self.encoder,
        );
        code.truncate(StyleCode::LEN);
        code.iter_mut().zip(&self.gain).for_each(|(c, g)| *c *= g);
        StyleCode(code)
    }

    /// The statistics that a code stands for: the last ones, as many as the encoder
    /// [reads](Self::input).
    pub fn decode(&self, code: &StyleCode) -> Vec<f32> {
        let mu: Vec<f32> = code.0.iter().zip(&self.gain).map(|(c, g)| c / g).collect();
        let out = cpu::mlp::forward(&decoder_spec(self.input), &mu, &self.decoder);
        let numbers = out.iter().zip(self.mean.iter().zip(&self.scale));
        numbers.map(|(x, (m, s))| x * s + m).collect()
    }

    /// Share of the (standardised) variance of `set` that decoding explains, of the statistics that
    /// are read: 1 is perfect, 0 is as good as the mean of the training set.
    pub fn explained(&self, set: &[Statistics]) -> f64 {
        let (mut error, mut variance) = (0.0f64, 0.0f64);
        for statistics in set {
            let truth = self.standardised(statistics);
            let rebuilt = self.standardised_part(&self.decode(&self.encode(statistics)));
            for (t, r) in truth.iter().zip(rebuilt) {
                error += f64::from(t - r).powi(2);
                variance += f64::from(*t).powi(2);
            }
        }
        1.0 - error / variance.max(1e-12)
    }
}
