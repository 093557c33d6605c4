//! Takes photos over into the capture.

use std::collections::BTreeSet;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageEncoder, ImageReader};

use super::Taken;
use super::check::Checked;
use crate::batches::in_batches;
use crate::error::PrepareError;

/// Of photos that have to be encoded anew.
const QUALITY: u8 = 95;
/// Bytes of EXIF data that fit into a JPEG with their header.
const LONGEST_EXIF: usize = 65_000;

/// Takes all photos to the folder `images`. `tick` hears how many are there.
pub(super) fn all(
    photos: &[Checked],
    images: &Path,
    tick: &mut dyn FnMut(usize),
) -> Result<Vec<Taken>, PrepareError> {
    let names = names(photos);
    let pairs: Vec<(&Checked, &String)> = photos.iter().zip(&names).collect();
    in_batches(&pairs, tick, |(photo, name)| {
        place(photo, name, &images.join(name))
    })
}

/// Names in the capture: the photos' own, with another ending where they become JPEGs.
fn names(photos: &[Checked]) -> Vec<String> {
    let mut used: BTreeSet<String> = photos.iter().map(|p| p.source.name.clone()).collect();
    let name = |photo: &Checked| {
        let mut name = photo.source.name.clone();
        if is_turned(photo) && !photo.jpeg {
            while used.contains(&name) {
                name.push_str(".jpg");
            }
            used.insert(name.clone());
        }
        name
    };
    photos.iter().map(name).collect()
}

fn is_turned(photo: &Checked) -> bool {
    photo.orientation != Orientation::NoTransforms
}

fn place(photo: &Checked, name: &str, to: &Path) -> Result<Taken, PrepareError> {
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder).map_err(PrepareError::write(folder))?;
    }
    let size = if is_turned(photo) {
        turn(photo, to)?
    } else {
        link_or_copy(&photo.source.path, to)?;
        photo.size
    };
    Ok(Taken {
        name: name.to_owned(),
        size,
        lens: photo.lens.clone(),
        turned: is_turned(photo),
    })
}

fn link_or_copy(from: &Path, to: &Path) -> Result<(), PrepareError> {
    // A link to a symbolic link would be one more of those.
    let whole = from.canonicalize().map_err(PrepareError::read(from))?;
    if fs::hard_link(&whole, to).is_ok() {
        return Ok(());
    }
    fs::copy(&whole, to).map_err(PrepareError::write(to))?;
    Ok(())
}

/// Writes the photo upright and tells its size. EXIF stays, because COLMAP reads the focal length
/// there, except for the orientation.
fn turn(photo: &Checked, to: &Path) -> Result<(u32, u32), PrepareError> {
    let from = &photo.source.path;
    let unreadable = |error: image::ImageError| {
        PrepareError::read(from)(std::io::Error::other(error.to_string()))
    };
    let bytes = fs::read(from).map_err(PrepareError::read(from))?;
    let mut decoder = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(PrepareError::read(from))?
        .into_decoder()
        .map_err(unreadable)?;
    let exif = decoder.exif_metadata().ok().flatten();
    let mut upright = DynamicImage::from_decoder(decoder).map_err(unreadable)?;
    upright.apply_orientation(photo.orientation);
    let upright = upright.into_rgb8();
    let mut encoded = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut encoded, QUALITY);
    // More than a JPEG's segment can hold stays behind, as do broken data.
    if let Some(mut exif) = exif.filter(|exif| exif.len() < LONGEST_EXIF)
        && Orientation::remove_from_exif_chunk(&mut exif).is_some()
    {
        encoder
            .set_exif_metadata(exif)
            .map_err(|e| PrepareError::write(to)(std::io::Error::other(e.to_string())))?;
    }
    encoder
        .write_image(
            &upright,
            upright.width(),
            upright.height(),
            image::ExtendedColorType::Rgb8,
        )
        .map_err(PrepareError::encode(to))?;
    fs::write(to, encoded).map_err(PrepareError::write(to))?;
    Ok(upright.dimensions())
}
