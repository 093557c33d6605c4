//! Held-out views, rendered and compared with their photos.

use image::{RgbImage, imageops};
use impasto_model::{Model, Quality, StyleEmbedding};
use impasto_scene::{Scene, Split, metrics};
use impasto_style::picture;
use std::time::{Duration, Instant};

/// Longest side of a preview's views.
const PREVIEW_SIDE: u32 = 320;

/// Compares held-out views with their photos, all of them unless `limit` runs out (then those
/// that fit, at least one); also returns photo and render of the first, side by side.
pub fn validate(model: &Model, scene: &Scene, limit: Duration) -> (Quality, Option<RgbImage>) {
    let start = Instant::now();
    let photo_appearance = model.photo_appearance();
    let mut quality = Quality::default();
    let mut preview = None;
    for (_, photo) in scene.test() {
        // One more view takes about as long as the ones before it did.
        let ahead = start.elapsed() / quality.views.max(1) as u32;
        if quality.views > 0 && start.elapsed() + ahead > limit {
            break;
        }
        let view = model.render(&photo.camera, &[&photo_appearance]);
        let truth = picture(&photo.pixels);
        let pair = [&view.pixels[0], &truth].map(Vec::as_slice);
        let size = [view.width, view.height];
        let (psnr, ssim) = compare(pair, size, photo.mask.as_deref());
        quality.psnr += storable(psnr);
        quality.ssim += storable(ssim);
        quality.views += 1;
        preview.get_or_insert_with(|| beside(&[photo.pixels.clone(), view.image(0)]));
    }
    let n = quality.views.max(1) as f64;
    quality.psnr /= n;
    quality.ssim /= n;
    (quality, preview)
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
