//! Measures the mean activation of every VGG-16 filter over photos, paintings and generated
//! pictures, and writes `assets/vgg16_mean_activations_f16.safetensors`.
//!
//! `cargo run --release -p impasto-style --example measure_activations -- OUT FOLDER…`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use impasto_paintings::{Recipe, paint};
use impasto_style::{Perceptual, picture, square_crop, write_f16};
use rayon::prelude::*;
use std::path::PathBuf;

const SIDE: u32 = 160;
const GENERATED: u64 = 150;

fn main() {
    let mut args = std::env::args().skip(1);
    let out = args.next().expect("OUT");
    let mut files: Vec<PathBuf> = args
        .flat_map(|dir| std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()))
        .filter(|p| p.is_file())
        .collect();
    files.sort();
    let mut images: Vec<_> = files
        .par_iter()
        .filter_map(|p| {
            Some(square_crop(
                &image::open(p).ok()?.to_rgb8(),
                1.0,
                (0.5, 0.5),
                SIDE,
            ))
        })
        .collect();
    images.par_extend(
        (0..GENERATED)
            .into_par_iter()
            .map(|seed| paint(&Recipe::random(seed), SIDE, SIDE)),
    );
    println!("{} pictures", images.len());
    let stacks = Perceptual::raw_prefixes().unwrap();
    let means: Vec<(&str, Vec<f32>)> = stacks
        .iter()
        .map(|(name, stack)| {
            let channels = stack.statistics_channels()[0];
            let side = SIDE as usize;
            let content = stack.content_shape(side, side).iter().product::<usize>();
            let mut mean = vec![0.0; channels];
            for image in &images {
                let features = stack.forward(&picture(image), side, side).0;
                for (m, v) in mean.iter_mut().zip(&features[content..]) {
                    *m += v / images.len() as f32;
                }
            }
            println!(
                "{name}: {:.1} on average, {} filters under 1",
                mean.iter().sum::<f32>() / channels as f32,
                mean.iter().filter(|m| **m < 1.0).count()
            );
            (*name, mean)
        })
        .collect();
    let views: Vec<(&str, &[f32])> = means.iter().map(|(n, m)| (*n, m.as_slice())).collect();
    std::fs::write(out, write_f16(&views).unwrap()).unwrap();
}
