//! The style-VAE: as trained from scratch, and as shipped.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use burn::tensor::Device;
use impasto_paintings::{Recipe, paint};
use impasto_style::{Perceptual, Statistics, StyleCode, StyleVae, VaeTraining, picture, train_vae};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Vectors in a space of `rank` dimensions.
fn vectors(count: usize, rank: usize) -> Vec<Statistics> {
    let mut rng = Pcg64::seed_from_u64(1);
    let axes: Vec<Vec<f32>> = (0..rank)
        .map(|_| {
            (0..Statistics::LEN)
                .map(|_| rng.random_range(-1.0..1.0))
                .collect()
        })
        .collect();
    (0..count)
        .map(|_| {
            let scores: Vec<f32> = (0..rank)
                .map(|i| rng.random_range(-1.0..1.0) / (1 + i) as f32)
                .collect();
            let at = |j: usize| scores.iter().zip(&axes).map(|(s, a)| s * a[j]).sum::<f32>();
            Statistics((0..Statistics::LEN).map(|j| 3.0 + at(j)).collect())
        })
        .collect()
}

#[test]
fn training_starts_from_principal_components_and_scales_codes() {
    let set = vectors(60, 8);
    let training = VaeTraining {
        steps: 2,
        batch: 8,
        rate: 1e-5,
        divergence: 2e-3,
        reconstruction: 5.0,
        mixed: 0.5,
        seed: 1,
    };
    let mut errors = Vec::new();
    let vae = train_vae(&set, &training, &Device::flex(), |_, error| {
        errors.push(error);
    });
    assert_eq!(errors.len(), 2);
    let explained = vae.explained(&set);
    assert!(explained > 0.99, "{explained}");
    let codes = set.iter().flat_map(|s| vae.encode(s).0);
    let square = codes.map(|c| c * c).sum::<f32>() / (set.len() * StyleCode::LEN) as f32;
    assert!((square - 1.0).abs() < 1e-3, "{square}");
}

#[test]
fn the_shipped_encoder_explains_pictures_it_never_saw() {
    let (vgg, vae) = (Perceptual::vgg16().unwrap(), StyleVae::shipped().unwrap());
    let unseen: Vec<Statistics> = (0..6)
        .map(|seed| {
            let image = paint(&Recipe::random(seed), 160, 160);
            vgg.features(&picture(&image), 160, 160).unwrap().statistics
        })
        .collect();
    let explained = vae.explained(&unseen);
    assert!(explained > 0.9, "{explained}");
}
