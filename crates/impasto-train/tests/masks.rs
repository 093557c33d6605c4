//! What a mask hides has no influence on a model.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::run;
use image::{GrayImage, Luma, Rgb};
use impasto_scene::{LoadOptions, MaskUse};
use impasto_train::{TrainOptions, TrainSummary, train};
use std::path::Path;

/// Where something stands in every photo of 64×48 pixels.
const PASSER_BY: [u32; 4] = [20, 10, 24, 30];

/// Trains on the built-in scene with a passer-by of some colour before it, masked.
fn with_passer_by(dir: &Path, colour: [u8; 3], masks: MaskUse) -> (TrainSummary, Vec<u8>) {
    let options = TrainOptions {
        load: LoadOptions {
            masks,
            ..LoadOptions::default()
        },
        ..run(dir)
    };
    let [left, top, width, height] = PASSER_BY;
    let hidden =
        |x: u32, y: u32| (left..left + width).contains(&x) && (top..top + height).contains(&y);
    std::fs::create_dir(dir.join("scene/masks")).unwrap();
    for entry in std::fs::read_dir(dir.join("scene/images")).unwrap() {
        let path = entry.unwrap().path();
        let mut photo = image::open(&path).unwrap().to_rgb8();
        for (x, y, pixel) in photo.enumerate_pixels_mut() {
            if hidden(x, y) {
                *pixel = Rgb(colour);
            }
        }
        photo.save(&path).unwrap();
        let mask = GrayImage::from_fn(photo.width(), photo.height(), |x, y| {
            Luma([if hidden(x, y) { 0 } else { 255 }])
        });
        mask.save(dir.join("scene/masks").join(path.file_name().unwrap()))
            .unwrap();
    }
    let summary = train(&options, &mut |_| ()).unwrap();
    let model = std::fs::read(dir.join("model/model.safetensors")).unwrap();
    (summary, model)
}

#[test]
fn models_do_not_depend_on_what_is_hidden() {
    let trained = |colour, masks| {
        let dir = tempfile::tempdir().unwrap();
        with_passer_by(dir.path(), colour, masks)
    };
    let (magenta, green) = ([255, 0, 255], [0, 255, 0]);
    let (summary, model) = trained(magenta, MaskUse::Ignore);
    let (other_summary, other_model) = trained(green, MaskUse::Ignore);
    // Quality, photo look and styles are all in the file.
    assert!(model == other_model, "a hidden colour is in the model");
    assert_eq!(
        (summary.quality.psnr, summary.quality.ssim),
        (other_summary.quality.psnr, other_summary.quality.ssim)
    );
    let (_, seen) = trained(green, MaskUse::Off);
    assert!(seen != model, "masks change nothing");
}
