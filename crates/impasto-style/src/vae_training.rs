//! Training of the style-VAE (PAPER §5).

use crate::Network;
use crate::components::{Components, principal_components};
use crate::hypernetwork::normal;
use crate::perceptual::Statistics;
use crate::vae::{StyleCode, StyleInput, StyleVae, WIDTH, decoder_spec, encoder_spec};
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::cpu;
use impasto_kernels::ops::{self, AdamParam};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// How to train a style-VAE.
#[derive(Debug, Clone, Copy)]
pub struct VaeTraining {
    /// What it reads.
    pub input: StyleInput,
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

/// Trains on statistics vectors, from their principal components on, which are what a linear VAE
/// would end as; `report` gets the step and the reconstruction error.
///
/// # Panics
/// If `set` is empty.
pub fn train_vae(
    set: &[Statistics],
    training: &VaeTraining,
    device: &Device,
    mut report: impl FnMut(u64, f32),
) -> StyleVae {
    assert!(
        !set.is_empty(),
        "a style-VAE learns from at least one style"
    );
    let mut rng = Pcg64::seed_from_u64(training.seed);
    let mut vae = linear_vae(training.input, set, &mut rng, device);
    let mut params = [&vae.encoder, &vae.decoder]
        .map(|flat| AdamParam::new(Tensor::from_data(flat.as_slice(), device)));
    for step in 0..training.steps {
        let batch: Vec<f32> = (0..training.batch)
            .flat_map(|_| vae.standardised(&pick(set, training.mixed, &mut rng)))
            .collect();
        let leaves = [params[0].tracked(), params[1].tracked()];
        let (loss, error) = losses(&leaves, batch, training, &mut rng, device);
        let mut gradients = loss.backward();
        let progress = step as f32 / training.steps as f32;
        let rate = training.rate * 0.01f32.powf(progress);
        let grads = leaves.map(|leaf| leaf.grad_remove(&mut gradients));
        for (param, grad) in params.iter_mut().zip(grads) {
            if let Some(grad) = grad {
                param.step(grad, rate, None);
            }
        }
        report(step, error);
    }
    let numbers = |p: &AdamParam| p.value().try_into_vec_as::<f32>().unwrap_or_default();
    vae.encoder = numbers(&params[0]);
    vae.decoder = numbers(&params[1]);
    vae.gain = gains(&vae, set);
    vae
}

/// Loss of a batch of standardised statistics, and its reconstruction error alone.
fn losses(
    [encoder, decoder]: &[Tensor<1>; 2],
    batch: Vec<f32>,
    training: &VaeTraining,
    rng: &mut Pcg64,
    device: &Device,
) -> (Tensor<1>, f32) {
    let matrix = |data: Vec<f32>, width: usize| {
        Tensor::<2>::from_data(TensorData::new(data, [training.batch, width]), device).autodiff()
    };
    let noise = (0..training.batch * StyleCode::LEN)
        .map(|_| normal(rng))
        .collect();
    let (input, noise) = (
        matrix(batch, training.input.numbers()),
        matrix(noise, StyleCode::LEN),
    );
    let latent = ops::mlp(
        input.clone(),
        encoder.clone(),
        &encoder_spec(training.input),
    );
    let mu = latent.clone().slice([0..training.batch, 0..StyleCode::LEN]);
    let log_variance = latent
        .slice([0..training.batch, StyleCode::LEN..2 * StyleCode::LEN])
        .clamp(-10.0, 10.0);
    let code = mu.clone() + (log_variance.clone() * 0.5).exp() * noise;
    let rebuilt = ops::mlp(code, decoder.clone(), &decoder_spec(training.input));
    let error = (rebuilt - input).square().mean();
    let divergence = (mu.square() + log_variance.clone().exp() - log_variance - 1.0).mean() * 0.5;
    let loss = error.clone() * training.reconstruction + divergence * training.divergence;
    (loss, error.inner().into_scalar::<f32>())
}

fn pick(set: &[Statistics], mixed: f64, rng: &mut Pcg64) -> Statistics {
    let one = &set[rng.random_range(0..set.len())];
    if rng.random_bool(mixed) {
        one.mixed(&set[rng.random_range(0..set.len())], rng.random())
    } else {
        one.clone()
    }
}

/// Statistics that hardly differ are not blown up more than this much.
const LEAST_SCALE: f32 = 1e-3;
/// Nor are directions that hardly vary: standard deviation, of standardised statistics.
const LEAST_DEVIATION: f32 = 1e-2;
/// Log-variance that codes start with: nearly no noise, so that the decoder has something to
/// learn from.
const FIRST_LOG_VARIANCE: f32 = -4.0;

/// An encoder that projects on principal components and whitens, a decoder that undoes it, written
/// as networks of relus: each hidden layer holds every score twice, with both signs.
fn linear_vae(input: StyleInput, set: &[Statistics], rng: &mut Pcg64, device: &Device) -> StyleVae {
    let mut vae = standardisation(input, set);
    let inputs = input.numbers();
    let rows: Vec<f32> = set.iter().flat_map(|s| vae.standardised(s)).collect();
    let Components {
        directions,
        variances,
    } = principal_components(&rows, inputs, StyleCode::LEN, rng, device);
    let deviation = |score: usize| variances[score].sqrt().max(LEAST_DEVIATION);
    let direction = |score: usize, axis: usize| directions[score * inputs + axis];
    let mut encoder = Layers::default();
    encoder.push(WIDTH, inputs, |row, column| {
        let (score, sign) = signed(row);
        sign * direction(score, column) / deviation(score)
    });
    encoder.push(WIDTH, WIDTH, passed_on);
    encoder.push(2 * StyleCode::LEN, WIDTH, |row, column| {
        if row < StyleCode::LEN {
            passed_on(row, column)
        } else {
            0.0
        }
    });
    let biases = encoder.0.len() - StyleCode::LEN;
    encoder.0[biases..].fill(FIRST_LOG_VARIANCE);
    let mut decoder = Layers::default();
    decoder.push(WIDTH, StyleCode::LEN, |row, column| {
        let (score, sign) = signed(row);
        if score == column { sign } else { 0.0 }
    });
    decoder.push(WIDTH, WIDTH, passed_on);
    decoder.push(inputs, WIDTH, |row, column| {
        let (score, sign) = signed(column);
        sign * direction(score, row) * deviation(score)
    });
    vae.encoder = encoder.0;
    vae.decoder = decoder.0;
    vae
}

/// Mean and deviation of every statistic, with empty networks.
fn standardisation(input: StyleInput, set: &[Statistics]) -> StyleVae {
    let n = set.len() as f32;
    let parts = || set.iter().map(|s| input.part(s));
    let mean: Vec<f32> = (0..input.numbers())
        .map(|i| parts().map(|s| s[i]).sum::<f32>() / n)
        .collect();
    let variance = |i: usize| parts().map(|s| (s[i] - mean[i]).powi(2)).sum::<f32>() / n;
    let scale = (0..input.numbers())
        .map(|i| variance(i).sqrt().max(LEAST_SCALE))
        .collect();
    StyleVae {
        network: Network::default(),
        input,
        mean,
        scale,
        gain: vec![1.0; StyleCode::LEN],
        encoder: Vec::new(),
        decoder: Vec::new(),
    }
}

/// Score and sign that a unit of a hidden layer stands for.
fn signed(unit: usize) -> (usize, f32) {
    match unit.checked_sub(StyleCode::LEN) {
        None => (unit, 1.0),
        Some(score) => (score, -1.0),
    }
}

/// Weight between two units that makes the next layer hold the same scores.
fn passed_on(row: usize, column: usize) -> f32 {
    let ((score, sign), (input, side)) = (signed(row), signed(column));
    if score == input { sign * side } else { 0.0 }
}

/// Flat parameters, layer by layer.
#[derive(Default)]
struct Layers(Vec<f32>);

impl Layers {
    /// Adds a layer, its weight given by row (output) and column (input), and zero biases.
    fn push(&mut self, outputs: usize, inputs: usize, weight: impl Fn(usize, usize) -> f32) {
        for row in 0..outputs {
            self.0.extend((0..inputs).map(|column| weight(row, column)));
        }
        self.0.extend(std::iter::repeat_n(0.0, outputs));
    }
}

/// Change under which a number of μ counts as unused.
const LEAST_CHANGE: f32 = 1e-3;

/// How much each number of μ changes the decoded statistics around the set's middle, scaled so
/// that the set's codes have a mean square of 1.
fn gains(vae: &StyleVae, set: &[Statistics]) -> Vec<f32> {
    let mut probes = vec![0.0; 2 * StyleCode::LEN * StyleCode::LEN];
    for (i, pair) in probes.chunks_exact_mut(2 * StyleCode::LEN).enumerate() {
        (pair[i], pair[StyleCode::LEN + i]) = (0.5, -0.5);
    }
    let decoded = cpu::mlp::forward(&decoder_spec(vae.input), &probes, &vae.decoder);
    let mut gains: Vec<f32> = decoded
        .chunks_exact(2 * vae.input.numbers())
        .map(|pair| {
            let (up, down) = pair.split_at(vae.input.numbers());
            let change: f32 = up.iter().zip(down).map(|(a, b)| (a - b).powi(2)).sum();
            change.sqrt().max(LEAST_CHANGE)
        })
        .collect();
    let square: f32 = set
        .iter()
        .flat_map(|s| vae.encode(s).0)
        .zip(gains.iter().cycle())
        .map(|(mu, gain)| (mu * gain).powi(2))
        .sum();
    let size = (square / (set.len() * StyleCode::LEN) as f32)
        .sqrt()
        .max(1e-6);
    gains.iter_mut().for_each(|g| *g /= size);
    gains
}
