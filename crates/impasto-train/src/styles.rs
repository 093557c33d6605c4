//! The paintings that a run learns from: statistics and codes, computed once.

use crate::palette::Palette;
use image::RgbImage;
use image::imageops::crop_imm;
use impasto_paintings::{Recipe, paint};
use impasto_style::{
    Perceptual, Statistics, StyleCode, StyleError, StyleVae, picture, recolour, square_crop,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Side of the square pictures that statistics are taken of.
pub const STYLE_SIDE: u32 = 160;
/// Random crops per painting, beside the whole.
const CROPS: u64 = 8;
/// Smallest share of the side that a random crop keeps: smaller crops have larger strokes.
const LEAST_CROP: f32 = 0.5;
/// Share of random crops whose colours are changed: palettes vary more than 100 paintings do.
const RECOLOURED: f64 = 0.5;
/// First seed of generated training pictures; the ones below are free for other uses.
pub const FIRST_GENERATED: u64 = 10_000;

/// A painting as training sees it.
#[derive(Debug, Clone)]
pub struct Style {
    /// Statistics of the whole picture: what its code is made of.
    pub statistics: Statistics,
    /// Mean statistics of patch-sized windows: what a patch can be compared with. A window has
    /// less variety than the whole, and more border for its pixels.
    pub target: Statistics,
    /// Its colours.
    pub palette: Palette,
    /// The code.
    pub code: StyleCode,
}

/// What a folder of paintings turned into.
#[derive(Debug, Clone, Default)]
pub struct Paintings {
    /// Readable pictures with their file names, in name order.
    pub named: Vec<(String, RgbImage)>,
    /// Files that could not be read, with the reason.
    pub unreadable: Vec<(PathBuf, String)>,
}

/// Reads every image of a folder.
///
/// # Errors
/// If the folder cannot be listed.
pub fn read_paintings(dir: &Path) -> std::io::Result<Paintings> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(dir)?
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.is_file())
        .collect();
    files.sort();
    let read: Vec<_> = files
        .into_par_iter()
        .map(|path| (impasto_scene::read_rgb(&path), path))
        .collect();
    let mut paintings = Paintings::default();
    for (image, path) in read {
        match image {
            Ok(image) => paintings.named.push((file_name(&path), image)),
            Err(error) => paintings.unreadable.push((path, error.to_string())),
        }
    }
    Ok(paintings)
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// The crop that stands for a painting whenever it is not training: its middle square.
///
/// # Errors
/// Never for pictures of at least 1×1 pixel.
pub fn whole(vgg: &Perceptual, painting: &RgbImage) -> Result<Statistics, StyleError> {
    statistics(vgg, &square_crop(painting, 1.0, (0.5, 0.5), STYLE_SIDE))
}

fn statistics(vgg: &Perceptual, square: &RgbImage) -> Result<Statistics, StyleError> {
    let side = STYLE_SIDE as usize;
    Ok(vgg.features(&picture(square), side, side)?.statistics)
}

/// Mean statistics of windows of `height × width` pixels that cover the picture.
fn window_statistics(
    vgg: &Perceptual,
    square: &RgbImage,
    patch: [usize; 2],
) -> Result<Statistics, StyleError> {
    let side = STYLE_SIDE as usize;
    let [height, width] = patch.map(|p| p.clamp(1, side));
    let starts = |size: usize| {
        let count = side.div_ceil(size);
        (0..count).map(move |i| (side - size) * i / (count - 1).max(1))
    };
    let mut sum = vec![0.0; Statistics::LEN];
    let mut windows = 0.0;
    for top in starts(height) {
        for left in starts(width) {
            let size = (width as u32, height as u32);
            let window = crop_imm(square, left as u32, top as u32, size.0, size.1).to_image();
            let statistics = vgg.features(&picture(&window), height, width)?.statistics;
            sum.iter_mut().zip(&statistics.0).for_each(|(s, x)| *s += x);
            windows += 1.0;
        }
    }
    sum.iter_mut().for_each(|s| *s /= windows);
    Ok(Statistics(sum))
}

/// Statistics and codes of all paintings (whole and random crops) and of `generated` pictures, to
/// be painted on patches of `patch` = `[height, width]` pixels.
///
/// With a `deadline`, generated pictures and crops still missing then are left out; the whole
/// paintings always come first.
///
/// # Errors
/// If the network refuses a picture.
pub fn style_set(
    (vgg, vae): (&Perceptual, &StyleVae),
    patch: [usize; 2],
    paintings: &[(String, RgbImage)],
    generated: usize,
    seed: u64,
    deadline: Option<Instant>,
) -> Result<Vec<Style>, StyleError> {
    let crops = |which: std::ops::RangeInclusive<u64>| {
        which
            .flat_map(|crop| (0..paintings.len()).map(move |painting| Job::Crop { painting, crop }))
    };
    let made: Vec<Job> = (0..generated as u64).map(Job::Generated).collect();
    let jobs: Vec<Job> = crops(0..=0)
        .chain(interleaved(&crops(1..=CROPS).collect::<Vec<_>>(), &made))
        .collect();
    let measured: Vec<(Style, Statistics)> = jobs[..jobs.len().min(MEASURED)]
        .par_iter()
        .map(|job| {
            let square = job.square(paintings, seed);
            let window = window_statistics(vgg, &square, patch)?;
            Ok((described(vgg, vae, &square)?, window))
        })
        .collect::<Result<_, StyleError>>()?;
    let shrinkage = shrinkage(&measured);
    let mut styles: Vec<Style> = Vec::with_capacity(jobs.len());
    styles.extend(measured.into_iter().map(|(style, _)| style));
    let least = paintings.len().max(BATCH);
    for chunk in jobs[styles.len()..].chunks(BATCH) {
        if deadline.is_some_and(|d| Instant::now() >= d) && styles.len() >= least {
            break;
        }
        let more = chunk
            .par_iter()
            .map(|job| described(vgg, vae, &job.square(paintings, seed)))
            .collect::<Result<Vec<_>, StyleError>>()?;
        styles.extend(more);
    }
    for style in &mut styles {
        let statistics = style.statistics.0.iter().zip(&shrinkage);
        style.target = Statistics(statistics.map(|(x, s)| x * s).collect());
    }
    Ok(styles)
}

/// A picture as a style whose patches are taken to look like the whole.
fn described(vgg: &Perceptual, vae: &StyleVae, square: &RgbImage) -> Result<Style, StyleError> {
    let statistics = statistics(vgg, square)?;
    Ok(Style {
        code: vae.encode(&statistics),
        target: statistics.clone(),
        palette: Palette::of(picture(square).chunks_exact(3)),
        statistics,
    })
}

/// How each statistic changes, on average, from whole pictures to windows: measured on a few, it
/// saves the windows of all others.
fn shrinkage(measured: &[(Style, Statistics)]) -> Vec<f32> {
    let sum = |get: fn(&(Style, Statistics)) -> &Statistics, i: usize| {
        measured.iter().map(|m| get(m).0[i]).sum::<f32>()
    };
    (0..Statistics::LEN)
        .map(|i| {
            let (whole, window) = (sum(|m| &m.0.statistics, i), sum(|m| &m.1, i));
            if whole > 0.0 {
                (window / whole).clamp(0.5, 2.0)
            } else {
                1.0
            }
        })
        .collect()
}

/// Pictures whose windows are measured.
const MEASURED: usize = 24;
/// Pictures made between two looks at the clock.
const BATCH: usize = 8;

/// One picture to take statistics of.
#[derive(Debug, Clone, Copy)]
enum Job {
    Crop { painting: usize, crop: u64 },
    Generated(u64),
}

impl Job {
    fn square(self, paintings: &[(String, RgbImage)], seed: u64) -> RgbImage {
        match self {
            Self::Generated(i) => {
                paint(&Recipe::random(FIRST_GENERATED + i), STYLE_SIDE, STYLE_SIDE)
            }
            Self::Crop { painting, crop: 0 } => {
                square_crop(&paintings[painting].1, 1.0, (0.5, 0.5), STYLE_SIDE)
            }
            Self::Crop { painting, crop } => {
                let mut rng = Pcg64::seed_from_u64(seed ^ ((painting as u64) << 8 | crop));
                let part = rng.random_range(LEAST_CROP..1.0);
                let mut square = square_crop(
                    &paintings[painting].1,
                    part,
                    (rng.random(), rng.random()),
                    STYLE_SIDE,
                );
                if rng.random() {
                    image::imageops::flip_horizontal_in_place(&mut square);
                }
                if rng.random_bool(RECOLOURED) {
                    recolour(&mut square, &mut rng);
                }
                square
            }
        }
    }
}

/// Elements of both lists in turn, so that stopping early keeps the balance.
fn interleaved(one: &[Job], other: &[Job]) -> Vec<Job> {
    let longer = one.len().max(other.len());
    (0..longer)
        .flat_map(|i| one.get(i).into_iter().chain(other.get(i)))
        .copied()
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn window_statistics_are_the_mean_over_windows_that_cover_the_picture() {
        let vgg = Perceptual::vgg16().unwrap();
        let square = paint(&Recipe::random(7), STYLE_SIDE, STYLE_SIDE);
        let side = STYLE_SIDE as usize;
        let whole = window_statistics(&vgg, &square, [side, 4 * side]).unwrap();
        assert_eq!(whole, statistics(&vgg, &square).unwrap());

        // 100 of 160 rows: two windows, from rows 0 and 60.
        let found = window_statistics(&vgg, &square, [100, side]).unwrap();
        let window = |top| {
            let part = crop_imm(&square, 0, top, STYLE_SIDE, 100).to_image();
            vgg.features(&picture(&part), 100, side).unwrap().statistics
        };
        let wanted = window(0).mixed(&window(60), 0.5);
        assert!(found.distance(&wanted) < 1e-9);
        assert!(
            found.distance(&whole) > 1e-6,
            "windows differ from the whole"
        );
    }
}
