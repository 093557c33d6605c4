//! Finds the directions along which features of photos vary most, and writes
//! `assets/vgg16_descriptor_directions_f16.safetensors`.
//!
//! `cargo run --release -p impasto-eval --example descriptor_directions -- OUT FOLDER…`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use impasto_style::{
    DESCRIPTOR_LAYERS, GREATEST_FEATURE, Perceptual, picture, square_crop, write_f16,
};
use nalgebra::{DMatrix, DVector};
use std::path::PathBuf;

const SIDE: u32 = 192;

fn main() {
    let mut args = std::env::args().skip(1);
    let out = args.next().expect("OUT");
    let mut files: Vec<PathBuf> = args
        .flat_map(|dir| std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()))
        .collect();
    files.sort();
    let vgg = Perceptual::vgg16().unwrap();
    let mut sums =
        DESCRIPTOR_LAYERS.map(|(_, n, _)| (0.0, DVector::zeros(n), DMatrix::zeros(n, n)));
    for file in &files {
        let Ok(photo) = image::open(file) else {
            continue;
        };
        let square = square_crop(&photo.to_rgb8(), 1.0, (0.5, 0.5), SIDE);
        let side = SIDE as usize;
        let [_, second, third, _] = vgg.maps(&picture(&square), side, side).unwrap();
        for ((count, mean, square), map) in sums.iter_mut().zip([second, third]) {
            let pixels = map.height * map.width;
            let mut all = DMatrix::from_column_slice(map.channels, pixels, &map.data);
            all.apply(|x| *x = x.min(GREATEST_FEATURE));
            *count += 1.0;
            *mean += all.column_mean();
            *square += &all * all.transpose() / pixels as f32;
        }
    }
    let mut named: Vec<(String, Vec<f32>)> = Vec::new();
    for ((count, mean, square), (name, channels, kept)) in sums.into_iter().zip(DESCRIPTOR_LAYERS) {
        let (mean, square): (DVector<f32>, DMatrix<f32>) = (mean / count, square / count);
        let own = (square - &mean * mean.transpose()).symmetric_eigen();
        let mut order: Vec<usize> = (0..channels).collect();
        order.sort_by(|a, b| own.eigenvalues[*b].total_cmp(&own.eigenvalues[*a]));
        let share = |n: usize| -> f32 { order[..n].iter().map(|i| own.eigenvalues[*i]).sum() };
        println!(
            "{count} photos, {name}: {kept} of {channels} directions hold {:.1} % of the variance",
            100.0 * share(kept) / share(channels),
        );
        // To deviation 1.
        let rows = order[..kept]
            .iter()
            .map(|i| own.eigenvectors.column(*i) / own.eigenvalues[*i].sqrt());
        let rows = rows.flat_map(|row| row.iter().copied().collect::<Vec<f32>>());
        named.push((format!("{name}.rows"), rows.collect()));
        named.push((format!("{name}.mean"), mean.iter().copied().collect()));
    }
    let named: Vec<(&str, &[f32])> = named
        .iter()
        .map(|(n, v)| (n.as_str(), v.as_slice()))
        .collect();
    let file = write_f16(&named).unwrap();
    println!("{} bytes", file.len());
    std::fs::write(out, file).unwrap();
}
