//! Which photos can be used.

use std::collections::HashMap;
use std::fs;
use std::io::Cursor;

use image::metadata::Orientation;
use image::{ImageDecoder, ImageFormat, ImageReader};
use impasto_scene::{SceneError, read_rgb};
use sha2::{Digest, Sha256};

use super::{LeftOut, PhotoSource, exif};
use crate::batches::in_batches;
use crate::error::PrepareError;

/// A photo that can be used.
pub(super) struct Checked {
    pub(super) source: PhotoSource,
    /// Width and height as stored.
    pub(super) size: (u32, u32),
    pub(super) orientation: Orientation,
    pub(super) jpeg: bool,
    pub(super) lens: String,
    hash: [u8; 32],
}

/// The usable photos of `sources`, in order; copies are taken once. `tick` hears how many files
/// have been looked at.
pub(super) fn all(
    sources: &[PhotoSource],
    left_out: &mut Vec<LeftOut>,
    tick: &mut dyn FnMut(usize),
) -> Result<Vec<Checked>, PrepareError> {
    let mut usable: Vec<Checked> = Vec::new();
    let mut seen: HashMap<[u8; 32], String> = HashMap::new();
    let checked = in_batches(sources, tick, |source| Ok(check(source)))?;
    for (source, checked) in sources.iter().zip(checked) {
        let new = checked.and_then(|photo| match seen.get(&photo.hash) {
            Some(first) => Err(format!("a copy of {first}")),
            None => Ok(photo),
        });
        match new {
            Ok(photo) => {
                seen.insert(photo.hash, photo.source.name.clone());
                usable.push(photo);
            }
            Err(reason) => left_out.push(LeftOut {
                file: source.name.clone(),
                reason,
            }),
        }
    }
    Ok(usable)
}

/// Decodes a photo as training will. An error is the reason why it cannot be used.
fn check(source: &PhotoSource) -> Result<Checked, String> {
    read_rgb(&source.path).map_err(|error| match error {
        SceneError::Photo { problem, .. } => problem,
        SceneError::Io { source, .. } => format!("cannot be read ({source})"),
        other => other.to_string(),
    })?;
    let bytes = fs::read(&source.path).map_err(|e| format!("cannot be read ({e})"))?;
    let reader = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(|e| e.to_string())?;
    let jpeg = reader.format() == Some(ImageFormat::Jpeg);
    let mut decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    // Photos with broken EXIF data are as good as those without.
    let lens = decoder.exif_metadata().ok().flatten().map(exif::lens);
    Ok(Checked {
        source: source.clone(),
        size: decoder.dimensions(),
        orientation: decoder.orientation().unwrap_or(Orientation::NoTransforms),
        jpeg,
        lens: lens.unwrap_or_default(),
        hash: Sha256::digest(&bytes).into(),
    })
}
