//! Held-out views, rendered and compared with their photos.

use crate::model::{Inspiration, Model, RenderedView};
use crate::model_file::Quality;
use image::{RgbImage, imageops};
use impasto_scene::{Scene, Split, metrics};
use impasto_style::picture;
use std::time::{Duration, Instant};

/// Longest side of a preview's views.
const PREVIEW_SIDE: u32 = 320;

/// Compares held-out views with their photos, all of them unless `limit` runs out (then those
/// that fit, at least one); also returns photo and render of the first, side by side.
pub fn validate(model: &Model, scene: &Scene, limit: Duration) -> (Quality, Option<RgbImage>) {
    let start = Instant::now();
    let look = model.photo_look();
    let mut quality = Quality::default();
    let mut preview = None;
    for (_, photo) in scene.test() {
        // One more view takes about as long as the ones before it did.
        let ahead = start.elapsed() / quality.views.max(1) as u32;
        if quality.views > 0 && start.elapsed() + ahead > limit {
            break;
        }
        let view = model.render(&photo.camera, &[&look]);
        let truth = picture(&photo.pixels);
        let pair = [&view.pixels[0], &truth].map(Vec::as_slice);
        let (psnr, ssim) = compare(pair, (view.width, view.height), photo.mask.as_deref());
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
fn compare(
    [view, truth]: [&[f32]; 2],
    (width, height): (usize, usize),
    mask: Option<&[bool]>,
) -> (f64, f64) {
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
pub fn style_preview(model: &Model, inspirations: &[Inspiration]) -> Option<RgbImage> {
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
    let mut looks = vec![model.photo_look()];
    looks.extend(inspirations.iter().filter_map(|i| model.look(i)));
    let view = model.render(&camera, &looks.iter().collect::<Vec<_>>());
    Some(beside(
        &(0..looks.len()).map(|i| view.image(i)).collect::<Vec<_>>(),
    ))
}

impl RenderedView {
    /// One look as 8-bit pixels.
    pub fn image(&self, look: usize) -> RgbImage {
        let bytes = self.pixels[look]
            .iter()
            .map(|v| (v * 255.0).round() as u8)
            .collect();
        RgbImage::from_raw(self.width as u32, self.height as u32, bytes).unwrap_or_default()
    }
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
