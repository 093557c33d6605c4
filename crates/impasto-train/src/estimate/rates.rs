//! How fast this machine trains, by a few steps of the real stages on a small part of the work.

use crate::geometry::{GeometryStage, photo_rays};
use crate::paintings::StyleSet;
use crate::style::{StyleNetworks, StyleStage};
use burn::tensor::Device;
use image::imageops::{FilterType, resize};
use impasto_model::{Budget, Clock, STYLE_SIDE, TrainConfig};
use impasto_paintings::{Recipe, paint};
use impasto_scene::{Photo, Scene};
use impasto_style::StyleError;
use std::time::{Duration, Instant};

/// Steps a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Of the geometry stage.
    pub geometry: f64,
    /// Of the style stage, making its patches included.
    pub style: f64,
}

/// Time for the steps of one stage, and the most of them.
const TIME: Duration = Duration::from_millis(300);
const MOST_STEPS: u64 = 25;
/// Photos that are sampled, and their shorter side in pixels: as large as a patch needs.
const PHOTOS: usize = 4;
const SHORTER: u32 = 128;
/// Rays of a step that takes all samples of a cascade: the fewest that keep all threads busy.
const FEWER_RAYS: usize = 256;
const SMALL_PATCH: [usize; 2] = [16, 16];

/// Measures a configuration's rates on the CPU with a capture's own cameras: a second or two. A
/// step that would take longer is measured with fewer rays and scaled up. Other programs that run
/// meanwhile count, as they would in training.
///
/// # Errors
/// If the perceptual network or the style encoder cannot be loaded.
pub fn measure_rates(scene: &Scene, config: &TrainConfig) -> Result<Rates, StyleError> {
    let device = Device::flex();
    let photos: Vec<Photo> = scene.train().take(PHOTOS).map(|(_, p)| small(p)).collect();
    let photos: Vec<&Photo> = photos.iter().collect();
    let (config, scale) = reduced(config);
    let mut geometry = GeometryStage::of_photos(&photos, &config, 0, &device);
    let clock = Clock::start(Budget::Steps(u64::MAX));
    // The first step finds no memory that was used before.
    geometry.step(&clock);
    let geometry_step = timed(MOST_STEPS, || geometry.step(&clock));
    let trained = geometry.snapshot();
    let vgg = config.style.perceptual.load()?;
    let vae = config.encoder(None)?;
    let painting = [paint(&Recipe::random(0), STYLE_SIDE, STYLE_SIDE)];
    let style = &config.style;
    let styles = StyleSet::of_pictures(&vgg, &painting, style.patch, &style.pictures)?;
    let rays = photo_rays(photos.into_iter());
    let networks = StyleNetworks {
        vgg,
        vae,
        first: None,
    };
    let mut style = StyleStage::new(&config, trained, rays, networks, styles, 0, &device);
    let mut failure = None;
    let mut step = || {
        if let Err(error) = style.step(&clock) {
            failure = Some(error);
        }
    };
    let start = Instant::now();
    step();
    let with_patch = start.elapsed().as_secs_f64();
    let uses = config.style.patch_uses;
    let most = uses.saturating_sub(1).clamp(1, MOST_STEPS);
    let update = timed(most, step);
    // Where patches are used once, every step makes one, and the first is like any other.
    let making = match uses {
        1 => 0.0,
        _ => (with_patch - update).max(0.0) / uses as f64,
    };
    match failure {
        Some(error) => Err(error),
        None => Ok(Rates {
            geometry: 1.0 / (geometry_step * scale[0]),
            style: 1.0 / ((update + making) * scale[1]),
        }),
    }
}

/// Seconds of one of several steps.
fn timed<T>(most: u64, mut step: impl FnMut() -> T) -> f64 {
    let start = Instant::now();
    let mut steps = 0;
    while steps < most && (steps == 0 || start.elapsed() < TIME) {
        step();
        steps += 1;
    }
    (start.elapsed().as_secs_f64() / steps.max(1) as f64).max(1e-9)
}

/// The configuration as it is measured, and how many times longer its steps are in truth, of the
/// geometry stage and of the style stage.
fn reduced(config: &TrainConfig) -> (TrainConfig, [f64; 2]) {
    let mut less = config.clone();
    // All losses, as in most of the stage.
    less.style.style_loss_start = 0;
    if config.field.levels() == 1 {
        return (less, [1.0; 2]);
    }
    let fewest = config.geometry.rays[0].min(FEWER_RAYS);
    less.geometry.rays = [fewest; 2];
    less.style.patch = SMALL_PATCH;
    let rays = |c: &TrainConfig| (c.style.patch[0] * c.style.patch[1]) as f64;
    let scale = [
        config.geometry.rays[0] as f64 / fewest as f64,
        rays(config) / rays(&less),
    ];
    (less, scale)
}

/// A photo of a size at which nothing takes long.
fn small(photo: &Photo) -> Photo {
    let (width, height) = photo.pixels.dimensions();
    let scale = f64::from(SHORTER) / f64::from(width.min(height).max(1));
    // Panoramas stay within bounds, too.
    let side = |side: u32| ((f64::from(side) * scale) as u32).clamp(SHORTER, 4 * SHORTER);
    let (width, height) = (side(width), side(height));
    Photo {
        camera: photo.camera.resized(width, height),
        pixels: resize(&photo.pixels, width, height, FilterType::Nearest),
        mask: None,
        ..photo.clone()
    }
}
