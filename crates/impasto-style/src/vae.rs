//! The style-VAE (PAPER §5): a painting's statistics to a code, and back.

use crate::hypernetwork::normal;
use crate::perceptual::Statistics;
use crate::{StyleError, TensorFile, write_f16};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::ops::{self, AdamParam};
use impasto_kernels::{Activation, MlpSpec, cpu};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// The shipped weights, made by `examples/train_encoder.rs`.
const SHIPPED: &[u8] = include_bytes!("../../../assets/style_vae_f16.safetensors");
const WIDTH: usize = 1024;

/// z_S: a painting as the hypernetwork sees it.
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

/// Encoder and decoder with the standardisation of their statistics.
#[derive(Debug, Clone)]
pub struct StyleVae {
    mean: Vec<f32>,
    scale: Vec<f32>,
    encoder: Vec<f32>,
    decoder: Vec<f32>,
}

fn encoder_spec() -> MlpSpec {
    MlpSpec::relu(
        &[Statistics::LEN, WIDTH, WIDTH, 2 * StyleCode::LEN],
        false,
        Activation::Linear,
    )
}

fn decoder_spec() -> MlpSpec {
    MlpSpec::relu(
        &[StyleCode::LEN, WIDTH, WIDTH, Statistics::LEN],
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
        Self::from_bytes("style_vae_f16.safetensors", SHIPPED)
    }

    /// Reads stored weights; `name` is for messages.
    ///
    /// # Errors
    /// If a tensor is missing or has another length.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, StyleError> {
        let file = TensorFile::open(name, bytes)?;
        Ok(Self {
            mean: file.floats_of("mean", Statistics::LEN)?,
            scale: file.floats_of("scale", Statistics::LEN)?,
            encoder: file.floats_of("encoder", encoder_spec().params())?,
            decoder: file.floats_of("decoder", decoder_spec().params())?,
        })
    }

    /// Its weights in half precision.
    ///
    /// # Errors
    /// If safetensors refuses them.
    pub fn to_bytes(&self) -> Result<Vec<u8>, StyleError> {
        write_f16(&[
            ("mean", &self.mean),
            ("scale", &self.scale),
            ("encoder", &self.encoder),
            ("decoder", &self.decoder),
        ])
    }

    fn standardised(&self, statistics: &Statistics) -> Vec<f32> {
        let stats = statistics.0.iter().zip(self.mean.iter().zip(&self.scale));
        stats.map(|(x, (m, s))| (x - m) / s).collect()
    }

    /// The code μ of a painting's statistics.
    pub fn encode(&self, statistics: &Statistics) -> StyleCode {
        let mut code = cpu::mlp::forward(
            &encoder_spec(),
            &self.standardised(statistics),
            &self.encoder,
        );
        code.truncate(StyleCode::LEN);
        StyleCode(code)
    }

    /// The statistics that a code stands for.
    pub fn decode(&self, code: &StyleCode) -> Statistics {
        let out = cpu::mlp::forward(&decoder_spec(), &code.0, &self.decoder);
        let numbers = out.iter().zip(self.mean.iter().zip(&self.scale));
        Statistics(numbers.map(|(x, (m, s))| x * s + m).collect())
    }

    /// Share of the (standardised) variance of `set` that decoding explains: 1 is perfect, 0 is
    /// as good as the mean of the training set.
    pub fn explained(&self, set: &[Statistics]) -> f64 {
        let (mut error, mut variance) = (0.0f64, 0.0f64);
        for statistics in set {
            let truth = self.standardised(statistics);
            let rebuilt = self.standardised(&self.decode(&self.encode(statistics)));
            for (t, r) in truth.iter().zip(rebuilt) {
                error += f64::from(t - r).powi(2);
                variance += f64::from(*t).powi(2);
            }
        }
        1.0 - error / variance.max(1e-12)
    }
}

/// How to train a style-VAE.
#[derive(Debug, Clone, Copy)]
pub struct VaeTraining {
    /// Optimiser steps.
    pub steps: u64,
    /// Vectors a step.
    pub batch: usize,
    /// Learning rate at the start; ends at a hundredth.
    pub rate: f32,
    /// Weight of the divergence from the standard normal, mean over the code.
    pub divergence: f32,
    /// Weight of the squared error, mean over the standardised statistics.
    pub reconstruction: f32,
    /// Share of vectors that are mixed from two.
    pub mixed: f64,
    /// Random numbers.
    pub seed: u64,
}

/// Trains on statistics vectors; `report` gets the step and the reconstruction error.
pub fn train_vae(
    set: &[Statistics],
    training: &VaeTraining,
    device: &Device,
    mut report: impl FnMut(u64, f32),
) -> StyleVae {
    let mut rng = Pcg64::seed_from_u64(training.seed);
    let n = set.len().max(1) as f32;
    let mean: Vec<f32> = (0..Statistics::LEN)
        .map(|i| set.iter().map(|s| s.0[i]).sum::<f32>() / n)
        .collect();
    let scale: Vec<f32> = (0..Statistics::LEN)
        .map(|i| {
            (set.iter().map(|s| (s.0[i] - mean[i]).powi(2)).sum::<f32>() / n)
                .sqrt()
                .max(1e-3)
        })
        .collect();
    let mut vae = StyleVae {
        mean,
        scale,
        encoder: Vec::new(),
        decoder: Vec::new(),
    };
    let mut encoder = kaiming(&encoder_spec(), &mut rng);
    quieten(&mut encoder);
    let decoder = kaiming(&decoder_spec(), &mut rng);
    let mut params = [encoder, decoder].map(|flat| AdamParam::new(tensor(flat, device)));
    for step in 0..training.steps {
        let progress = step as f32 / training.steps as f32;
        let batch: Vec<f32> = (0..training.batch)
            .flat_map(|_| vae.standardised(&pick(set, training.mixed, &mut rng)))
            .collect();
        let input = Tensor::<2>::from_data(
            TensorData::new(batch, [training.batch, Statistics::LEN]),
            device,
        )
        .autodiff();
        let noise: Vec<f32> = (0..training.batch * StyleCode::LEN)
            .map(|_| normal(&mut rng))
            .collect();
        let noise = Tensor::<2>::from_data(
            TensorData::new(noise, [training.batch, StyleCode::LEN]),
            device,
        )
        .autodiff();
        let leaves = [params[0].tracked(), params[1].tracked()];
        let latent = ops::mlp(input.clone(), leaves[0].clone(), &encoder_spec());
        let mu = latent.clone().slice([0..training.batch, 0..StyleCode::LEN]);
        let log_variance = latent
            .slice([0..training.batch, StyleCode::LEN..2 * StyleCode::LEN])
            .clamp(-10.0, 10.0);
        let code = mu.clone() + (log_variance.clone() * 0.5).exp() * noise;
        let rebuilt = ops::mlp(code, leaves[1].clone(), &decoder_spec());
        let error = (rebuilt - input).square().mean();
        let divergence =
            (mu.square() + log_variance.clone().exp() - log_variance - 1.0).mean() * 0.5;
        let loss = error.clone() * training.reconstruction + divergence * training.divergence;
        let mut gradients = loss.backward();
        let rate = training.rate * 0.01f32.powf(progress);
        for (param, leaf) in params.iter_mut().zip(&leaves) {
            if let Some(grad) = leaf.grad_remove(&mut gradients) {
                param.step(grad, rate, false);
            }
        }
        report(step, error.inner().into_scalar::<f32>());
    }
    let numbers = |p: &AdamParam| p.value().try_into_vec_as::<f32>().unwrap_or_default();
    vae.encoder = numbers(&params[0]);
    vae.decoder = numbers(&params[1]);
    vae
}

fn pick(set: &[Statistics], mixed: f64, rng: &mut Pcg64) -> Statistics {
    let one = &set[rng.random_range(0..set.len())];
    if rng.random_bool(mixed) {
        one.mixed(&set[rng.random_range(0..set.len())], rng.random())
    } else {
        one.clone()
    }
}

/// Log-variance that codes start with: nearly no noise, so that the decoder has something to
/// learn from.
const FIRST_LOG_VARIANCE: f32 = -4.0;
/// Scale of the log-variances' initial weights.
const QUIET: f32 = 0.05;

/// Makes a fresh encoder's log-variances small and nearly constant.
fn quieten(encoder: &mut [f32]) {
    let layer = encoder_spec().layers()[2];
    let start = encoder.len() - layer.params();
    let (weights, biases) = encoder[start..].split_at_mut(layer.inputs * layer.outputs);
    weights[layer.inputs * StyleCode::LEN..]
        .iter_mut()
        .for_each(|w| *w *= QUIET);
    biases[StyleCode::LEN..].fill(FIRST_LOG_VARIANCE);
}

fn kaiming(spec: &MlpSpec, rng: &mut Pcg64) -> Vec<f32> {
    let mut flat = Vec::with_capacity(spec.params());
    for layer in spec.layers() {
        let std = (2.0 / layer.inputs as f32).sqrt();
        flat.extend((0..layer.inputs * layer.outputs).map(|_| normal(rng) * std));
        flat.extend(std::iter::repeat_n(0.0, layer.outputs));
    }
    flat
}

fn tensor(flat: Vec<f32>, device: &Device) -> Tensor<1> {
    let length = flat.len();
    Tensor::from_data(TensorData::new(flat, [length]), device)
}
