//! The paintings that a run learns from: statistics and codes, computed once.

use image::RgbImage;
use impasto_paintings::{Recipe, paint};
use impasto_style::{
    Perceptual, Statistics, StyleCode, StyleError, StyleVae, picture, square_crop,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Side of the square pictures that statistics are taken of.
pub const STYLE_SIDE: u32 = 160;
/// Random crops per painting, beside the whole.
const CROPS: u64 = 4;
/// Smallest share of the side that a random crop keeps: smaller crops have larger strokes.
const LEAST_CROP: f32 = 0.5;
/// Share of random crops whose colours are changed: palettes vary more than 100 paintings do.
const RECOLOURED: f64 = 0.5;
/// First seed of generated training pictures; the ones below are free for other uses.
pub const FIRST_GENERATED: u64 = 10_000;

/// A painting as training sees it.
#[derive(Debug, Clone)]
pub struct Style {
    /// Its statistics.
    pub statistics: Statistics,
    /// The code that belongs to them.
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

/// Statistics and codes of all paintings (whole and random crops) and of `generated` pictures.
///
/// With a `deadline`, generated pictures and crops still missing then are left out; the whole
/// paintings always come first.
///
/// # Errors
/// If the network refuses a picture.
pub fn style_set(
    (vgg, vae): (&Perceptual, &StyleVae),
    paintings: &[(String, RgbImage)],
    generated: usize,
    seed: u64,
    deadline: Option<Instant>,
) -> Result<Vec<Style>, StyleError> {
    let jobs: Vec<Job> = (0..=CROPS)
        .flat_map(|crop| (0..paintings.len()).map(move |painting| Job::Crop { painting, crop }))
        .collect();
    let (whole, crops) = jobs.split_at(paintings.len());
    let made: Vec<Job> = (0..generated as u64).map(Job::Generated).collect();
    let rest: Vec<Job> = interleaved(crops, &made);
    let style = |job: &Job| {
        let statistics = statistics(vgg, &job.square(paintings, seed))?;
        let code = vae.encode(&statistics);
        Ok(Style { statistics, code })
    };
    let mut styles = whole
        .par_iter()
        .map(style)
        .collect::<Result<Vec<_>, StyleError>>()?;
    for chunk in rest.chunks(BATCH) {
        if deadline.is_some_and(|d| Instant::now() >= d) && styles.len() >= BATCH {
            break;
        }
        styles.extend(
            chunk
                .par_iter()
                .map(style)
                .collect::<Result<Vec<_>, StyleError>>()?,
        );
    }
    Ok(styles)
}

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

/// Turns hues, and changes saturation, contrast and brightness, by random amounts.
fn recolour(image: &mut RgbImage, rng: &mut Pcg64) {
    let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
    let saturation = rng.random_range(0.4f32..1.5);
    let contrast = rng.random_range(0.7f32..1.3);
    let shift = rng.random_range(-25.0f32..25.0);
    for pixel in image.pixels_mut() {
        let [r, g, b] = pixel.0.map(f32::from);
        // Luma and two opponent colours (YIQ), in which a hue is an angle.
        let luma = 0.299 * r + 0.587 * g + 0.114 * b;
        let i = 0.596 * r - 0.274 * g - 0.322 * b;
        let q = 0.211 * r - 0.523 * g + 0.312 * b;
        let (i, q) = (
            saturation * (cos * i - sin * q),
            saturation * (sin * i + cos * q),
        );
        let luma = (luma - 128.0) * contrast + 128.0 + shift;
        let rgb = [
            luma + 0.956 * i + 0.621 * q,
            luma - 0.272 * i - 0.647 * q,
            luma - 1.106 * i + 1.703 * q,
        ];
        // A float's cast to a byte saturates.
        pixel.0 = rgb.map(|c| c.round() as u8);
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
