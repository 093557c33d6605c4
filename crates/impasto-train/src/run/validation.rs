//! Held-out views, rendered and compared with their photos.

use crate::geometry::{calibration, photo_rays};
use image::{RgbImage, imageops};
use impasto_field::{RayBatch, contracted_distance};
use impasto_model::{Grain, Model, Quality, StyleEmbedding};
use impasto_scene::{Camera, Photo, Scene, Split, metrics, paths};
use impasto_style::picture;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::time::{Duration, Instant};

/// Longest side of a preview's views.
const PREVIEW_SIDE: u32 = 320;

/// Steps that a held-out view's pose is refined by.
const ALIGNMENTS: usize = 12;
/// Views between photos that are looked at for grain.
const BETWEEN: usize = 6;

/// Compares held-out views with their photos, all of them unless `limit` runs out (then those
/// that fit, at least one), and looks for grain; also returns photo and render of the first, side by
/// side.
///
/// Where poses of training photos were refined (`aligned`), those of held-out ones are too, to be
/// compared once more.
pub fn validate(
    model: &Model,
    scene: &Scene,
    aligned: bool,
    limit: Duration,
) -> (Quality, Option<RgbImage>) {
    let clock = Limit::new(limit);
    let photo_appearance = model.photo_appearance();
    let mut quality = Quality::default();
    let mut preview = None;
    let mut wrong = Vec::new();
    for (_, photo) in scene.test() {
        if !clock.has_room(quality.views) {
            break;
        }
        let view = model.render(&photo.camera, &[&photo_appearance]);
        let truth = picture(&photo.pixels);
        let size = [view.width, view.height];
        let mask = photo.mask.as_deref();
        let pixels = &view.pixels[0];
        let (psnr, ssim) = compare([pixels, &truth], size, mask);
        let fitted = metrics::affine_fit(pixels, &truth, mask);
        quality.psnr += storable(psnr);
        quality.ssim += storable(ssim);
        quality.fitted_psnr += storable(compare([&fitted, &truth], size, mask).0);
        if aligned {
            let camera = align(model, photo);
            let view = model.render(&camera, &[&photo_appearance]);
            let (psnr, _) = compare([&view.pixels[0], &truth], size, mask);
            *quality.aligned_psnr.get_or_insert_default() += storable(psnr);
        }
        quality.views += 1;
        wrong.push(metrics::wrong_pixels(pixels, view.width));
        preview.get_or_insert_with(|| beside(&[photo.pixels.clone(), view.image(0)]));
    }
    let n = quality.views.max(1) as f64;
    quality.psnr /= n;
    quality.ssim /= n;
    quality.fitted_psnr /= n;
    quality.aligned_psnr = quality.aligned_psnr.map(|sum| sum / n);
    quality.grain = grain(model, scene, wrong, &clock);
    (quality, preview)
}

/// A photo's camera where its pixels look most like the model.
fn align(model: &Model, photo: &Photo) -> Camera {
    let app = model.file.photo_app();
    let render = |rays: &RayBatch| model.renderer().render(rays, &[app]);
    let mut rays = photo_rays(std::iter::once(photo));
    let mut rng = Pcg64::seed_from_u64(model.file.seed);
    for photo in &mut rays {
        for _ in 0..ALIGNMENTS {
            calibration::align(photo, &render, &mut rng);
        }
    }
    rays.first().map_or(photo.camera, |photo| photo.camera)
}

/// Time that views may take.
struct Limit {
    start: Instant,
    limit: Duration,
}

impl Limit {
    fn new(limit: Duration) -> Self {
        Self {
            start: Instant::now(),
            limit,
        }
    }

    /// Whether one more view fits after `done` ones: the first does, and others take about as long
    /// as the ones before.
    fn has_room(&self, done: usize) -> bool {
        let spent = self.start.elapsed();
        done == 0 || spent + spent / done as u32 <= self.limit
    }
}

/// Grain of views between photos, beside that of the photos; `wrong` are shares of wrong pixels
/// in renders so far. `None` without views between photos, or time for one.
fn grain(model: &Model, scene: &Scene, mut wrong: Vec<f64>, clock: &Limit) -> Option<Grain> {
    let cameras = scene.cameras(Split::Train);
    let appearance = model.photo_appearance();
    let mut of_renders = Vec::new();
    let mut of_depths = [Vec::new(), Vec::new()];
    for pair in paths::between(&cameras, BETWEEN) {
        if !clock.has_room(wrong.len()) {
            break;
        }
        let view = model.render(&pair.view, &[&appearance]);
        let pixels = &view.pixels[0];
        of_renders.push(metrics::second_differences(pixels, view.width, 3));
        wrong.push(metrics::wrong_pixels(pixels, view.width));
        let at_photo = model.render(&cameras[pair.first], &[&appearance]);
        for (all, view) in of_depths.iter_mut().zip([view, at_photo]) {
            let near: Vec<f32> = view.depth.iter().map(|d| contracted_distance(*d)).collect();
            all.push(metrics::second_differences(&near, view.width, 1));
        }
    }
    if of_renders.is_empty() {
        return None;
    }
    let photos = scene.train().map(|(_, photo)| {
        let (pixels, width) = (picture(&photo.pixels), photo.pixels.width() as usize);
        let energy = metrics::second_differences(&pixels, width, 3);
        (energy, metrics::wrong_pixels(&pixels, width))
    });
    let (of_photos, wrong_in_photos): (Vec<f64>, Vec<f64>) = photos.unzip();
    // A photo of paper has neither: as many as one pixel in a million count there.
    let over = |a: &[f64], b: &[f64]| storable((mean(a) + 1e-6) / (mean(b) + 1e-6));
    let [between, at_photos] = of_depths;
    Some(Grain {
        colour: over(&of_renders, &of_photos),
        depth: over(&between, &at_photos),
        wrong_pixels: over(&wrong, &wrong_in_photos),
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// PSNR and SSIM of a render and its photo, of the pixels that show the place.
fn compare(pair: [&[f32]; 2], size: [usize; 2], mask: Option<&[bool]>) -> (f64, f64) {
    let ([view, truth], [width, height]) = (pair, size);
    match mask {
        None => (
            metrics::psnr(view, truth),
            metrics::ssim(view, truth, width, height, 3),
        ),
        Some(mask) => (
            metrics::psnr_of(view, truth, mask),
            metrics::ssim_of(view, truth, width, height, 3, mask),
        ),
    }
}

/// JSON has no infinity and no NaN: a perfect view counts as 99 dB, an unmeasurable one as 0.
fn storable(measure: f64) -> f64 {
    if measure.is_nan() {
        0.0
    } else {
        measure.min(99.0)
    }
}

/// The first held-out view in its own look and in some styles, side by side and small.
pub fn style_preview(model: &Model, embeddings: &[StyleEmbedding]) -> Option<RgbImage> {
    let photos = &model.file.scene.photos;
    let camera = photos
        .iter()
        .find(|p| p.split == Split::Test)
        .or(photos.first())?
        .camera;
    let k = camera.intrinsics;
    let scale = f64::from(PREVIEW_SIDE) / f64::from(k.width.max(k.height)).max(1.0);
    let shrink = |side: u32| ((f64::from(side) * scale.min(1.0)) as u32).max(1);
    let camera = camera.resized(shrink(k.width), shrink(k.height));
    let mut appearances = vec![model.photo_appearance()];
    appearances.extend(embeddings.iter().filter_map(|e| model.appearance(e)));
    let view = model.render(&camera, &appearances.iter().collect::<Vec<_>>());
    Some(beside(
        &(0..appearances.len())
            .map(|i| view.image(i))
            .collect::<Vec<_>>(),
    ))
}

fn beside(pictures: &[RgbImage]) -> RgbImage {
    let width = pictures.iter().map(RgbImage::width).sum();
    let height = pictures.iter().map(RgbImage::height).max().unwrap_or(0);
    let mut sheet = RgbImage::new(width, height);
    let mut x = 0;
    for picture in pictures {
        imageops::replace(&mut sheet, picture, x, 0);
        x += i64::from(picture.width());
    }
    sheet
}
