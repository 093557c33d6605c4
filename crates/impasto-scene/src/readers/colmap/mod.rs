//! COLMAP sparse models: `cameras`, `images` and (optional) `points3D`, binary or text.
//!
//! COLMAP's pixel coordinates have the upper left pixel's centre at (½, ½), as ours do.

mod bin;
mod bytes;
mod model;
mod txt;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3};

use super::capture::{Capture, RawFrame, RawPoint};
use super::names;
use crate::camera::Camera;
use crate::error::SceneError;
use crate::pose;
use model::{Image, Lenses, Point};

/// Farthest coordinate of a point: in a scene whose cameras are a picometre apart, the most that
/// single precision holds.
const FARTHEST: f64 = 1e18;

/// Reads the model in the folder `model`.
pub(crate) fn read(model: &Path, binary: bool) -> Result<Capture, SceneError> {
    let extension = if binary { "bin" } else { "txt" };
    let file = |name: &str| model.join(format!("{name}.{extension}"));
    let (cameras, path) = (file("cameras"), file("images"));
    let (lenses, images) = if binary {
        (bin::cameras(&cameras)?, bin::images(&path)?)
    } else {
        (txt::cameras(&cameras)?, txt::images(&path)?)
    };
    let points = match file("points3D") {
        path if !path.is_file() => Vec::new(),
        path if binary => bin::points(&path)?,
        path => txt::points(&path)?,
    };
    let photos = photo_folder(model);
    let frames = images
        .iter()
        .map(|image| frame(image, &lenses, &photos, &path))
        .collect::<Result<_, _>>()?;
    Ok(Capture {
        frames,
        points: join_tracks(points, &images, &file("points3D"))?,
        synthetic: false,
    })
}

/// Names of the photos that the binary COLMAP model in the folder `model` has poses for, sorted.
///
/// # Errors
/// A file `images.bin` that cannot be read or breaks the rules of its format.
pub fn photo_names(model: &Path) -> Result<Vec<String>, SceneError> {
    let images = bin::images(&model.join("images.bin"))?;
    let mut names: Vec<String> = images.into_iter().map(|image| image.name).collect();
    names.sort();
    Ok(names)
}

/// The `images` folder beside the model or up to two folders above it.
fn photo_folder(model: &Path) -> PathBuf {
    let beside = model.join("images");
    let candidates = model.ancestors().take(3).map(|p| p.join("images"));
    let mut found = candidates.filter(|p| p.is_dir());
    found.next().unwrap_or(beside)
}

/// The folder that the photos' folder is in.
pub(crate) fn root(model: &Path) -> Option<PathBuf> {
    photo_folder(model).parent().map(Path::to_owned)
}

fn frame(
    image: &Image,
    lenses: &Lenses,
    photos: &Path,
    path: &Path,
) -> Result<RawFrame, SceneError> {
    let root = photos.parent().unwrap_or(photos);
    names::check(&image.name, root, 1, path)?;
    let Some(&intrinsics) = lenses.get(&image.camera) else {
        let problem = format!(
            "it uses camera {}, which the cameras file does not have; take both files from one model",
            image.camera
        );
        let place = format!("frame {}", image.name);
        return Err(SceneError::malformed(path, place, problem));
    };
    let wrong_pose = |problem: String| SceneError::pose(path, &image.name, problem);
    let [w, x, y, z] = image.rotation;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let translation = DVec3::from_array(image.translation);
    if !rotation.is_finite() || !translation.is_finite() {
        return Err(wrong_pose(
            "holds NaN or infinite numbers; compute it again or remove the image".into(),
        ));
    }
    if (rotation.length() - 1.0).abs() > 1e-3 {
        return Err(wrong_pose(format!(
            "is not a rotation (its quaternion has length {:.3}, which must be 1); compute it again or \
             remove the image",
            rotation.length()
        )));
    }
    let camera_to_world =
        DMat4::from_rotation_translation(rotation.normalize(), translation).inverse();
    Ok(RawFrame {
        name: image.name.clone(),
        photo: photos.join(&image.name),
        camera: Camera {
            intrinsics,
            camera_to_world: pose::rigid(camera_to_world).map_err(wrong_pose)?,
        },
        split: None,
        mask: None,
        measured: false,
    })
}

/// Turns tracks into pixels. Images that the model no longer has (people thin models by hand) are
/// left out of a track.
fn join_tracks(
    points: Vec<Point>,
    images: &[Image],
    path: &Path,
) -> Result<Vec<RawPoint>, SceneError> {
    let index: HashMap<u32, usize> = images
        .iter()
        .enumerate()
        .map(|(i, image)| (image.id, i))
        .collect();
    let mut joined = Vec::with_capacity(points.len());
    for (number, point) in points.into_iter().enumerate() {
        let position = DVec3::from_array(point.position);
        let place = || format!("point {}", number + 1);
        let refuse = |problem: &str| Err(SceneError::malformed(path, place(), problem));
        if !position.is_finite() {
            return refuse("its position is NaN or infinite; remove the point");
        }
        if position.abs().max_element() > FARTHEST {
            return refuse("its position is too far out to compute with; remove the point");
        }
        let mut seen_by = Vec::with_capacity(point.track.len());
        for (image, feature) in point.track {
            let Some(&frame) = index.get(&image) else {
                continue;
            };
            let Some(&pixel) = images[frame].features.get(feature as usize) else {
                let problem = format!(
                    "it refers to feature {feature} of {}, which has none such; take both files from one model",
                    images[frame].name
                );
                return Err(SceneError::malformed(path, place(), problem));
            };
            seen_by.push((frame, pixel));
        }
        joined.push(RawPoint {
            position,
            colour: point.colour,
            seen_by,
            error: point.error,
        });
    }
    Ok(joined)
}
