//! Finds the directions along which features of paintings, grey and rank-matched, vary most, and
//! writes `assets/vgg16_stroke_directions_f16.safetensors`.
//!
//! `cargo run --release -p impasto-eval --example stroke_directions -- OUT FOLDER…`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use impasto_eval::strokes::{Grid, SIDES};
use impasto_style::{Perceptual, STROKE_DIRECTIONS, square_crop, write_f16};
use nalgebra::{DMatrix, DVector};
use std::path::PathBuf;

fn main() {
    let mut args = std::env::args().skip(1);
    let out = args.next().expect("OUT");
    let mut files: Vec<PathBuf> = args
        .flat_map(|dir| std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()))
        .collect();
    files.sort();
    let vgg = Perceptual::vgg16().unwrap();
    let mut sums = [256, 512].map(|n| (0.0, DVector::zeros(n), DMatrix::zeros(n, n)));
    for (i, file) in files.iter().enumerate() {
        let Ok(picture) = image::open(file) else {
            continue;
        };
        let picture = picture.to_rgb8();
        let side = picture.width().min(picture.height());
        let square = square_crop(&picture, 1.0, (0.5, 0.5), side);
        let grey = Grid::resampled(&square, SIDES[i % SIDES.len()]).rank_matched();
        let [.., third, fourth] = vgg.maps(&grey.rgb(), grey.height, grey.width).unwrap();
        for ((count, mean, square), map) in sums.iter_mut().zip([third, fourth]) {
            let pixels = map.height * map.width;
            let all = DMatrix::from_column_slice(map.channels, pixels, &map.data);
            // Every picture counts alike.
            *count += 1.0;
            *mean += all.column_mean();
            *square += &all * all.transpose() / pixels as f32;
        }
    }
    let found = sums.map(|(count, mean, square)| {
        let (mean, square) = (mean / count, square / count);
        let own = (square - &mean * mean.transpose()).symmetric_eigen();
        let mut order: Vec<usize> = (0..mean.len()).collect();
        order.sort_by(|a, b| own.eigenvalues[*b].total_cmp(&own.eigenvalues[*a]));
        let share = |n: usize| -> f32 { order[..n].iter().map(|i| own.eigenvalues[*i]).sum() };
        println!(
            "{count} pictures: {STROKE_DIRECTIONS} of {} directions hold {:.1} % of the variance",
            mean.len(),
            100.0 * share(STROKE_DIRECTIONS) / share(mean.len()),
        );
        let rows = order[..STROKE_DIRECTIONS].iter();
        rows.flat_map(|i| {
            own.eigenvectors
                .column(*i)
                .iter()
                .copied()
                .collect::<Vec<f32>>()
        })
        .collect::<Vec<f32>>()
    });
    let [third, fourth] = found.each_ref().map(Vec::as_slice);
    let file = write_f16(&[("conv3_1", third), ("conv4_1", fourth)]).unwrap();
    println!("{} bytes", file.len());
    std::fs::write(out, file).unwrap();
}
