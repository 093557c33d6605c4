//! Training of AdaIN's decoder on photos and paintings.

use crate::methods::adain::decoder::Decoder;
use crate::methods::adain::{features, renormalised};
use crate::resize;
use burn::tensor::{Device, Tensor, TensorData};
use image::RgbImage;
use image::imageops::{FilterType, flip_horizontal_in_place};
use impasto_kernels::{AdamStep, ConvChain, FeatureMap, cpu::adam};
use impasto_style::losses::content_and_style;
use impasto_style::{Features, Perceptual, StyleError, StyleReduction, square_crop};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// How to train a decoder.
#[derive(Debug, Clone, Copy)]
pub struct AdaInTraining {
    /// Optimiser steps.
    pub steps: u64,
    /// Pairs of a photo and a painting a step.
    pub batch: usize,
    /// Adam's rate at the beginning; it falls to nothing along half a cosine.
    pub rate: f32,
    /// Weight of the style loss, a mean over all statistics; the content loss weighs 1. Huang &
    /// Belongie sum up means over eight parts and weigh them 10.
    pub style_weight: f32,
    /// Of pictures, pairs and first weights.
    pub seed: u64,
}

impl Default for AdaInTraining {
    /// What the built-in decoder was trained with.
    fn default() -> Self {
        Self {
            steps: 3500,
            batch: 2,
            rate: 3e-4,
            style_weight: 80.0,
            seed: 1,
        }
    }
}

/// What one step came to, mean over its pairs.
#[derive(Debug, Clone, Copy, Default)]
pub struct AdaInReport {
    /// Mean squared difference of relu4_1 to what was to be decoded.
    pub content: f32,
    /// Style distance to the painting.
    pub style: f32,
}

/// Pixels a side of the squares that are cut out of pictures.
const SIDE: u32 = 128;
/// Steps until the rate is what it should be.
const WARM_UP: f32 = 100.0;
/// Larger pictures are reduced to this many pixels a shorter side before anything else.
const LARGEST: u32 = 384;
/// Smallest part of a picture's shorter side that a square shows.
const LEAST_PART: f32 = 0.4;

/// Trains a decoder and returns its file: squares of photos are given the features' mean and
/// deviation of squares of paintings; the decoded picture shall have these features, and the
/// painting's statistics at all four layers.
///
/// `report` is called after every step.
///
/// # Errors
/// If an asset is damaged.
///
/// # Panics
/// If there is no photo or no painting.
pub fn train_adain(
    photos: &[RgbImage],
    paintings: &[RgbImage],
    training: &AdaInTraining,
    report: &mut dyn FnMut(u64, AdaInReport),
) -> Result<Vec<u8>, StyleError> {
    assert!(
        !photos.is_empty() && !paintings.is_empty(),
        "a decoder learns from at least one photo and one painting"
    );
    let [photos, paintings] = [photos, paintings].map(|pictures| {
        let small = pictures.par_iter().map(reduced);
        small.collect::<Vec<_>>()
    });
    let mut rng = Pcg64::seed_from_u64(training.seed);
    let mut decoder = Decoder::random(&mut rng);
    let mut moments = [(); 2].map(|()| vec![0.0; decoder.params.len()]);
    let objective = Objective {
        vgg: Perceptual::vgg16()?,
        style_weight: training.style_weight,
    };
    for step in 0..training.steps {
        let chain = decoder.chain();
        let mut gradient = vec![0.0; decoder.params.len()];
        let mut mean = AdaInReport::default();
        for _ in 0..training.batch {
            let pair = [&photos, &paintings].map(|pictures| square(pictures, &mut rng));
            let (found, own) = objective.pair(&chain, &pair)?;
            let share = 1.0 / training.batch as f32;
            mean.content += found.content * share;
            mean.style += found.style * share;
            for (sum, own) in gradient.iter_mut().zip(own.into_iter().flatten()) {
                *sum += own * share;
            }
        }
        let [first, second] = &mut moments;
        let adam = training.adam(step);
        adam::update(&mut decoder.params, first, second, &gradient, &adam);
        report(step, mean);
    }
    decoder.to_bytes()
}

impl AdaInTraining {
    fn adam(&self, step: u64) -> AdamStep {
        let progress = step as f32 / self.steps as f32;
        let warm = ((step + 1) as f32 / WARM_UP).min(1.0);
        AdamStep {
            rate: self.rate * warm * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos()),
            beta1: 0.9,
            beta2: 0.99,
            eps: 1e-8,
            step: u32::try_from(step + 1).unwrap_or(u32::MAX),
            sparse: None,
        }
    }
}

fn reduced(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let scale = f64::from(LARGEST) / f64::from(width.min(height).max(1));
    resize::reduced(picture, scale, FilterType::Triangle)
}

/// A random square of a random picture.
fn square(pictures: &[RgbImage], rng: &mut Pcg64) -> RgbImage {
    let picture = &pictures[rng.random_range(0..pictures.len())];
    let part = rng.random_range(LEAST_PART..1.0);
    let mut square = square_crop(picture, part, (rng.random(), rng.random()), SIDE);
    if rng.random() {
        flip_horizontal_in_place(&mut square);
    }
    square
}

struct Objective {
    vgg: Perceptual,
    style_weight: f32,
}

impl Objective {
    /// Losses of a photo and a painting, and their gradient in the order of the decoder's numbers.
    fn pair(
        &self,
        chain: &ConvChain,
        [photo, painting]: &[RgbImage; 2],
    ) -> Result<(AdaInReport, Vec<Vec<f32>>), StyleError> {
        let side = SIDE as usize;
        let painting = features(&self.vgg, painting)?.statistics;
        let wanted = renormalised(&features(&self.vgg, photo)?, &painting, [side; 2]);
        let (decoded, tape) = chain.taped(&wanted);
        let wanted = Features {
            content: wanted.data,
            statistics: painting,
        };
        let (report, grad) = self.losses(&decoded, &wanted);
        let grad = FeatureMap {
            data: grad,
            ..decoded
        };
        let gradients = chain.backward(&tape, &grad).into_iter();
        let gradients = gradients.flat_map(|g| [g.weight, g.bias]);
        Ok((report, gradients.collect()))
    }

    /// Losses of a decoded picture, and their gradient for it.
    fn losses(&self, decoded: &FeatureMap, wanted: &Features) -> (AdaInReport, Vec<f32>) {
        let shape = [decoded.height, decoded.width, decoded.channels];
        let data = TensorData::new(decoded.data.clone(), shape);
        let picture = Tensor::<3>::from_data(data, &Device::flex().autodiff()).require_grad();
        let traced = self.vgg.traced(picture.clone());
        let photo = Tensor::from_data(wanted.content.as_slice(), &traced.device());
        let (content, style) = content_and_style(
            &traced,
            &photo,
            &wanted.statistics,
            StyleReduction::Concatenated,
        );
        let report = AdaInReport {
            content: content.clone().inner().into_scalar::<f32>(),
            style: style.clone().inner().into_scalar::<f32>(),
        };
        let mut gradients = (content + style * self.style_weight).backward();
        let grad = picture.grad_remove(&mut gradients);
        let grad = grad.map(|grad| grad.try_into_vec_as::<f32>().unwrap_or_default());
        (report, grad.unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::methods::adain::tests::waves;

    #[test]
    fn training_makes_a_decoder_that_its_file_gives_back() {
        let photos = [waves(160, 140, [120.0, 100.0, 90.0], 0.2)];
        let paintings = [waves(150, 170, [60.0, 90.0, 160.0], 0.5)];
        let training = AdaInTraining {
            steps: 12,
            batch: 1,
            rate: 4e-3,
            ..AdaInTraining::default()
        };
        let mut losses = Vec::new();
        let mut report = |_, now: AdaInReport| {
            losses.push(now.content + training.style_weight * now.style);
        };
        let bytes = train_adain(&photos, &paintings, &training, &mut report).unwrap();
        assert_eq!(losses.len(), 12);
        let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
        assert!(mean(&losses[9..]) < 0.9 * mean(&losses[..3]), "{losses:?}");
        let again = Decoder::from_bytes("x", &bytes).unwrap();
        assert_eq!(again.to_bytes().unwrap(), bytes);
    }
}
