//! Trains the shipped style-VAE on paintings and generated pictures and writes
//! `assets/style_vae_f16.safetensors`.
//!
//! `cargo run --release -p impasto-style --example train_encoder -- OUT PAINTINGS HELDOUT [STEPS]`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use burn::tensor::Device;
use image::RgbImage;
use impasto_paintings::{Recipe, paint};
use impasto_style::{
    Perceptual, Statistics, VaeTraining, picture, recolour, square_crop, train_vae,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::path::Path;

const SIDE: u32 = 160;
const HELDOUT: usize = 20;
const CROPS: usize = 14;
const GENERATED: u64 = 1600;

fn paintings(dir: &str) -> Vec<RgbImage> {
    let mut files: Vec<_> = std::fs::read_dir(Path::new(dir))
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    files
        .par_iter()
        .filter_map(|p| Some(image::open(p).ok()?.to_rgb8()))
        .collect()
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let (set, heldout) = statistics_sets(&args);
    let training = VaeTraining {
        steps: args.get(4).map_or(1200, |s| s.parse().unwrap()),
        batch: 64,
        rate: 1e-4,
        divergence: 2e-3,
        reconstruction: 5.0,
        mixed: 0.5,
        seed: 1,
    };
    let mut smooth = 1.0;
    let vae = train_vae(&set, &training, &Device::flex(), |step, error| {
        smooth = 0.98 * smooth + 0.02 * error;
        if step % 250 == 0 {
            println!("step {step}: error {smooth:.4}");
        }
    });
    println!(
        "explained: {:.4} of training, {:.4} of held-out variance",
        vae.explained(&set),
        vae.explained(&heldout)
    );
    std::fs::write(&args[1], vae.to_bytes().unwrap()).unwrap();
}

/// Statistics of the training and of the held-out pictures, kept between runs in a temporary file.
fn statistics_sets(args: &[String]) -> (Vec<Statistics>, Vec<Statistics>) {
    let cache = std::env::temp_dir().join("impasto_style_statistics_2.bin");
    if let Ok(bytes) = std::fs::read(&cache) {
        let floats: Vec<f32> = bytes
            .as_chunks::<4>()
            .0
            .iter()
            .map(|b| f32::from_le_bytes(*b))
            .collect();
        let mut set: Vec<Statistics> = floats
            .chunks_exact(Statistics::LEN)
            .map(|c| Statistics(c.to_vec()))
            .collect();
        let heldout = set.split_off(set.len() - HELDOUT);
        return (set, heldout);
    }
    let vgg = Perceptual::vgg16().unwrap();
    let statistics = |image: &RgbImage| {
        vgg.features(&picture(image), SIDE as usize, SIDE as usize)
            .unwrap()
            .statistics
    };
    let mut rng = Pcg64::seed_from_u64(7);
    let mut crops = Vec::new();
    for painting in paintings(&args[2]) {
        for crop in 0..CROPS {
            let part = if crop == 0 {
                1.0
            } else {
                rng.random_range(0.45f32..1.0)
            };
            let mut image = square_crop(&painting, part, (rng.random(), rng.random()), SIDE);
            if crop % 2 == 1 {
                image::imageops::flip_horizontal_in_place(&mut image);
            }
            if crop >= CROPS / 2 {
                recolour(&mut image, &mut rng);
            }
            crops.push(image);
        }
    }
    let mut set: Vec<Statistics> = crops.par_iter().map(statistics).collect();
    println!("{} crops of paintings", set.len());
    set.par_extend(
        (0..GENERATED)
            .into_par_iter()
            .map(|seed| statistics(&paint(&Recipe::random(1_000_000 + seed), SIDE, SIDE))),
    );
    let heldout: Vec<Statistics> = paintings(&args[3])
        .iter()
        .map(|p| statistics(&square_crop(p, 1.0, (0.5, 0.5), SIDE)))
        .collect();
    println!("{} vectors, {} held out", set.len(), heldout.len());
    let numbers = set
        .iter()
        .chain(&heldout)
        .flat_map(|s| &s.0)
        .flat_map(|v| v.to_le_bytes());
    std::fs::write(cache, numbers.collect::<Vec<u8>>()).unwrap();
    (set, heldout)
}
