//! NeRF++ folders (Zhang et al. 2020): `{train,validation,test}/{intrinsics,pose,rgb}`, per view
//! two text files of a 4×4 row-major matrix and a photo, matched by their order of name.
//!
//! Intrinsics are in pixels of the stored photo; poses are camera-to-world with x right, y down, z
//! forward. `camera_path/`, which has no photos, is not part of the capture; see [`camera_path`].

use std::path::Path;

use glam::DMat4;

use super::capture::{Capture, RawFrame, files_in};
use crate::camera::{Camera, Distortion, Intrinsics};
use crate::error::{SceneError, read_text};
use crate::picture_file::{is_picture, stored_size};
use crate::pose;
use crate::scene::Split;

/// Reads the training views and the held-out ones: `test`, or `validation` where that is absent
/// (published captures hold the same photos in both).
pub(crate) fn read(root: &Path) -> Result<Capture, SceneError> {
    let held_out = ["test", "validation"]
        .into_iter()
        .find(|name| root.join(name).join("rgb").is_dir());
    let mut frames = views(root, "train", Split::Train)?;
    if let Some(name) = held_out {
        frames.extend(views(root, name, Split::Test)?);
    }
    Ok(Capture {
        frames,
        ..Capture::default()
    })
}

/// The cameras of a `camera_path` folder, `pose/` and `intrinsics/` without photos, in the
/// capture's coordinates. Their pictures are twice as wide and high as where the axis meets them.
///
/// # Errors
/// Folders or files that cannot be read, are not of this form or do not match.
pub fn camera_path(folder: &Path) -> Result<Vec<Camera>, SceneError> {
    let poses = files_in(&folder.join("pose"), is_text)?;
    let intrinsics = files_in(&folder.join("intrinsics"), is_text)?;
    if poses.is_empty() || poses.len() != intrinsics.len() {
        let problem = format!(
            "there are {} poses and {} intrinsics; every view needs one of each",
            poses.len(),
            intrinsics.len()
        );
        return Err(SceneError::malformed(folder, "camera path", problem));
    }
    let pairs = poses.iter().zip(&intrinsics);
    pairs
        .map(|(pose, intrinsics)| {
            let name = pose.file_name().unwrap_or_default().to_string_lossy();
            Ok(Camera {
                intrinsics: lens(intrinsics, None)?,
                camera_to_world: rigid(pose, &name)?,
            })
        })
        .collect()
}

fn is_text(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "txt")
}

fn rigid(path: &Path, frame: &str) -> Result<DMat4, SceneError> {
    pose::rigid(matrix(path)?).map_err(|problem| SceneError::pose(path, frame, problem))
}

fn views(root: &Path, name: &str, split: Split) -> Result<Vec<RawFrame>, SceneError> {
    let folder = root.join(name);
    let poses = files_in(&folder.join("pose"), is_text)?;
    let intrinsics = files_in(&folder.join("intrinsics"), is_text)?;
    let photos = files_in(&folder.join("rgb"), is_picture)?;
    if poses.len() != photos.len() || intrinsics.len() != photos.len() {
        let problem = format!(
            "there are {} poses, {} intrinsics and {} photos; every view needs one of each",
            poses.len(),
            intrinsics.len(),
            photos.len()
        );
        return Err(SceneError::malformed(root, name, problem));
    }
    let views = poses.iter().zip(&intrinsics).zip(photos);
    views
        .map(|((pose, intrinsics), photo)| {
            let file = photo.file_name().unwrap_or_default().to_string_lossy();
            let name = format!("{name}/rgb/{file}");
            Ok(RawFrame {
                camera: Camera {
                    intrinsics: lens(intrinsics, Some(stored_size(&photo)?))?,
                    camera_to_world: rigid(pose, &name)?,
                },
                name,
                photo,
                split: Some(split),
                mask: None,
                measured: true,
            })
        })
        .collect()
}

/// The sixteen numbers of a text file.
fn matrix(path: &Path) -> Result<DMat4, SceneError> {
    let text = read_text(path)?;
    let numbers: Vec<f64> = text
        .split_whitespace()
        .enumerate()
        .map(|(i, word)| {
            word.parse().map_err(|_| {
                let problem = format!("\"{word}\" is no number; write the 16 numbers of a matrix");
                SceneError::malformed(path, format!("number {}", i + 1), problem)
            })
        })
        .collect::<Result<_, _>>()?;
    let rows: &[f64; 16] = numbers.as_slice().try_into().map_err(|_| {
        let problem = format!(
            "there are {} numbers, a 4×4 matrix has 16; export it again",
            numbers.len()
        );
        SceneError::malformed(path, "whole file", problem)
    })?;
    Ok(DMat4::from_cols_array(rows).transpose())
}

/// The lens of a photo of `size`, or of a picture around its axis.
fn lens(path: &Path, size: Option<(u32, u32)>) -> Result<Intrinsics, SceneError> {
    let k = matrix(path)?;
    // Saturating: anything absurd becomes a size that no picture has, or zero.
    let around = |axis: f64| (2.0 * axis).round() as u32;
    let (width, height) = size.unwrap_or((around(k.z_axis.x), around(k.z_axis.y)));
    let refuse = |problem: String| SceneError::malformed(path, "intrinsics", problem);
    let skew = k.y_axis.x.abs();
    if skew > 1e-3 * k.x_axis.x.abs() {
        return Err(refuse(format!(
            "pixels are skewed by {skew}; undistort the photos first"
        )));
    }
    let intrinsics = Intrinsics {
        width,
        height,
        fl_x: k.x_axis.x,
        fl_y: k.y_axis.y,
        cx: k.z_axis.x,
        cy: k.z_axis.y,
        distortion: Distortion::default(),
    };
    intrinsics.check().map_err(refuse)?;
    Ok(intrinsics)
}
