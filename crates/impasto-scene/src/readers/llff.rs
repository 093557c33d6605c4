//! LLFF captures (Mildenhall et al. 2019): `poses_bounds.npy` beside `images/`.
//!
//! Each of its rows is a 3×5 matrix, row by row, and two depths: the columns of the matrix are the
//! camera's *down*, *right* and *backward* axes, its centre, and height, width and focal length of
//! the photo in pixels. Photos are matched by order of name. The two depths are not needed.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec3};

use super::capture::{Capture, RawFrame, files_in};
use crate::camera::{Camera, Distortion, Intrinsics};
use crate::error::{SceneError, read_bytes};
use crate::npy;
use crate::picture_file::is_picture;

/// Name of the file with the poses.
pub(crate) const POSES: &str = "poses_bounds.npy";
/// Numbers of a row.
const ROW: usize = 17;
/// Folders of photos, the largest first; the smaller ones are what LLFF's tools leave.
const FOLDERS: [&str; 4] = ["images", "images_2", "images_4", "images_8"];

pub(crate) fn read(root: &Path) -> Result<Capture, SceneError> {
    let path = root.join(POSES);
    let (shape, numbers) = npy::decode(&read_bytes(&path)?)
        .map_err(|problem| SceneError::malformed(&path, "header", problem))?;
    if shape.len() != 2 || shape[1] != ROW {
        let problem = format!(
            "the array is {shape:?}, poses are views × {ROW}; make the file again with LLFF's tools"
        );
        return Err(SceneError::malformed(&path, "header", problem));
    }
    let folder = FOLDERS.into_iter().find(|name| root.join(name).is_dir());
    let folder = folder.unwrap_or(FOLDERS[0]);
    let photos = files_in(&root.join(folder), is_picture)?;
    if photos.len() != shape[0] {
        let problem = format!(
            "there are {} poses but {} photos in {folder}/; every pose needs its photo",
            shape[0],
            photos.len()
        );
        return Err(SceneError::malformed(&path, "whole file", problem));
    }
    let rows = numbers.chunks_exact(ROW).zip(photos);
    let frames = rows.map(|(row, photo)| frame(row, photo, folder, &path));
    Ok(Capture {
        frames: frames.collect::<Result<_, _>>()?,
        ..Capture::default()
    })
}

fn frame(row: &[f64], photo: PathBuf, folder: &str, path: &Path) -> Result<RawFrame, SceneError> {
    let file = photo.file_name().unwrap_or_default().to_string_lossy();
    let name = format!("{folder}/{file}");
    let column = |c: usize| DVec3::new(row[c], row[5 + c], row[10 + c]);
    let (down, right, backward, centre) = (column(0), column(1), column(2), column(3));
    let matrix = DMat4::from_cols(
        right.extend(0.0),
        down.extend(0.0),
        (-backward).extend(0.0),
        centre.extend(1.0),
    );
    let size = column(4);
    let intrinsics = Intrinsics {
        // Saturating: anything absurd becomes a size that no photo has, or zero.
        width: size.y.round() as u32,
        height: size.x.round() as u32,
        fl_x: size.z,
        fl_y: size.z,
        cx: 0.5 * size.y,
        cy: 0.5 * size.x,
        distortion: Distortion::default(),
    };
    let camera = Camera {
        intrinsics,
        camera_to_world: matrix,
    };
    RawFrame::checked(path, name, photo, camera, None)
}
