//! The style-VAE: as trained from scratch, and as shipped.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use impasto_kernels::device::tested;
use impasto_paintings::{Recipe, paint};
use impasto_style::{
    Perceptual, Statistics, StyleCode, StyleInput, StyleVae, VaeTraining, picture, train_vae,
    write_f16,
};
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
    for input in [StyleInput::All, StyleInput::Relu4_1] {
        trains_from_principal_components(input);
    }
}

fn trains_from_principal_components(input: StyleInput) {
    let set = vectors(60, 8);
    let training = VaeTraining {
        input,
        steps: 2,
        batch: 8,
        rate: 1e-5,
        divergence: 2e-3,
        reconstruction: 5.0,
        mixed: 0.5,
        seed: 1,
    };
    let mut errors = Vec::new();
    let vae = train_vae(&set, &training, &tested(), |_, error| {
        errors.push(error);
    });
    assert_eq!(errors.len(), 2);
    let explained = vae.explained(&set);
    assert!(explained > 0.99, "{explained}");
    let codes = set.iter().flat_map(|s| vae.encode(s).0);
    let square = codes.map(|c| c * c).sum::<f32>() / (set.len() * StyleCode::LEN) as f32;
    assert!((square - 1.0).abs() < 1e-3, "{square}");
    assert_eq!(vae.decode(&vae.encode(&set[0])).len(), input.numbers());
    let read = StyleVae::from_bytes("vae", &vae.to_bytes().unwrap()).unwrap();
    assert_eq!(read.input(), input);
    assert!((read.explained(&set) - explained).abs() < 1e-2);
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

#[test]
fn damaged_encoders_are_refused() {
    let whole = StyleVae::shipped().unwrap().to_bytes().unwrap();
    assert!(StyleVae::from_bytes("cut", &whole[..whole.len() / 2]).is_err());
    let other = write_f16(&[("mean", &[0.0; 7])]).unwrap();
    let message = StyleVae::from_bytes("other.safetensors", &other).unwrap_err();
    let message = message.to_string();
    assert!(
        message.contains("other.safetensors") && message.contains("7 statistics"),
        "{message}"
    );
}
