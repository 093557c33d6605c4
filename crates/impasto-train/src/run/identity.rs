//! What a run must have in common with the one that it continues.

use crate::TrainError;
use crate::hash::Hash;
use crate::paintings::folder_identity;
use crate::run::options::TrainOptions;
use impasto_model::{PhotoMark, RunIdentity};
use impasto_scene::{Photo, PictureFolder, Scene};
use impasto_style::StyleVae;
use std::borrow::Cow;

/// What a photo is known by.
fn photo_mark(photo: &Photo) -> PhotoMark {
    let camera = serde_json::to_string(&photo.camera).unwrap_or_default();
    let mask = photo.mask.iter().flatten();
    let mask: Vec<u8> = mask.map(|shown| u8::from(*shown)).collect();
    let mut pixels = Cow::Borrowed(photo.pixels.as_raw());
    if !mask.is_empty() {
        let hidden = pixels.to_mut().chunks_exact_mut(3).zip(&mask);
        let hidden = hidden.filter(|(_, shown)| **shown == 0);
        hidden.for_each(|(pixel, _)| pixel.fill(0));
    }
    let hash = Hash::of(&photo.name)
        .with_words(&pixels)
        .with_words(&mask)
        .and(&camera)
        .and(&format!("{:?}", photo.split));
    PhotoMark {
        name: photo.name.clone(),
        hash: hash.0,
    }
}

/// Of a run with these options, on what they name.
pub(crate) fn identity_of(
    options: &TrainOptions,
    scene: &Scene,
    paintings: Option<&PictureFolder>,
    encoder: Option<&StyleVae>,
) -> Result<RunIdentity, TrainError> {
    let encoder = encoder.map(StyleVae::to_bytes).transpose()?;
    Ok(RunIdentity {
        stages: options.stages,
        seed: options.seed,
        downscale: options.load.downscale,
        config: options.config.clone(),
        encoder: encoder.map(|bytes| Hash::of_bytes(&bytes).0),
        photos: scene.photos.iter().map(photo_mark).collect(),
        paintings: paintings.map(folder_identity),
    })
}
