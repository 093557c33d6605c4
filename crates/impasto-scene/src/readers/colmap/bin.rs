//! COLMAP's binary files.

use std::path::Path;

use glam::DVec2;

use super::bytes::Bytes;
use super::model::{Image, Lenses, MODELS, Point, lens};
use crate::error::{SceneError, read_bytes};

/// Reads `cameras.bin`.
pub(super) fn cameras(path: &Path) -> Result<Lenses, SceneError> {
    let data = read_bytes(path)?;
    let mut bytes = Bytes::new(path, &data);
    let mut lenses = Lenses::new();
    for _ in 0..bytes.count(48, "cameras")? {
        let id = bytes.u32()?;
        let number = bytes.u32()?;
        let size = (bytes.u64()?, bytes.u64()?);
        let place = format!("camera {id}");
        let Some(&(model, parameters)) = MODELS.get(number as usize) else {
            return Err(SceneError::lens_model(
                path,
                &place,
                format!("number {number}"),
            ));
        };
        let values: Result<Vec<f64>, _> = (0..parameters).map(|_| bytes.f64()).collect();
        let values = values?;
        lenses.insert(id, lens(model, size, &values, path, &place)?);
    }
    bytes.finish()?;
    Ok(lenses)
}

/// Reads `images.bin`.
pub(super) fn images(path: &Path) -> Result<Vec<Image>, SceneError> {
    let data = read_bytes(path)?;
    let mut bytes = Bytes::new(path, &data);
    let count = bytes.count(73, "images")?;
    let mut images = Vec::with_capacity(count);
    for _ in 0..count {
        let id = bytes.u32()?;
        let rotation = bytes.f64s()?;
        let translation = bytes.f64s()?;
        let camera = bytes.u32()?;
        let name = bytes.name()?;
        let features = bytes.count(24, "features")?;
        let mut pixels = Vec::with_capacity(features);
        for _ in 0..features {
            pixels.push(DVec2::from_array(bytes.f64s()?));
            // The id of the feature's point: the points' tracks say the same.
            bytes.u64()?;
        }
        images.push(Image {
            id,
            rotation,
            translation,
            camera,
            name,
            features: pixels,
        });
    }
    bytes.finish()?;
    Ok(images)
}

/// Reads `points3D.bin`.
pub(super) fn points(path: &Path) -> Result<Vec<Point>, SceneError> {
    let data = read_bytes(path)?;
    let mut bytes = Bytes::new(path, &data);
    let count = bytes.count(51, "points")?;
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        bytes.u64()?;
        let position = bytes.f64s()?;
        let colour = [bytes.u8()?, bytes.u8()?, bytes.u8()?];
        let error = bytes.f64()?;
        let length = bytes.count(8, "track elements")?;
        let mut track = Vec::with_capacity(length);
        for _ in 0..length {
            track.push((bytes.u32()?, bytes.u32()?));
        }
        points.push(Point {
            position,
            colour,
            error,
            track,
        });
    }
    bytes.finish()?;
    Ok(points)
}
