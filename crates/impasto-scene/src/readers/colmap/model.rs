//! What COLMAP's files hold, binary or text.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec2;

use crate::camera::{Distortion, Intrinsics};
use crate::error::SceneError;

/// COLMAP's lens models: name and number of parameters, by COLMAP's model number.
pub(super) const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// An `images` record: world-to-camera pose and the pixels of its features.
pub(super) struct Image {
    pub(super) id: u32,
    /// w, x, y, z.
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
    pub(super) camera: u32,
    pub(super) name: String,
    pub(super) features: Vec<DVec2>,
}

/// A `points3D` record; `track` pairs an image's id with the index of a feature in it.
pub(super) struct Point {
    pub(super) position: [f64; 3],
    pub(super) colour: [u8; 3],
    pub(super) error: f64,
    pub(super) track: Vec<(u32, u32)>,
}

pub(super) type Lenses = HashMap<u32, Intrinsics>;

/// Builds a lens from a model's name and parameters in COLMAP's order.
pub(super) fn lens(
    model: &str,
    size: (u64, u64),
    p: &[f64],
    path: &Path,
    place: &str,
) -> Result<Intrinsics, SceneError> {
    let radial = |k1, k2| Distortion {
        k1,
        k2,
        ..Distortion::default()
    };
    let (fl_x, fl_y, cx, cy, distortion) = match (model, p) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy, Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy, Distortion::default()),
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => (f, f, cx, cy, radial(k1, 0.0)),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (f, f, cx, cy, radial(k1, k2)),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            (fx, fy, cx, cy, Distortion { k1, k2, p1, p2 })
        }
        ("SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV", _) => {
            let problem = format!(
                "{} parameters do not fit the lens model {model}; export the model again",
                p.len()
            );
            return Err(SceneError::malformed(path, place, problem));
        }
        _ => return Err(SceneError::lens_model(path, place, model)),
    };
    let side = |side: u64| u32::try_from(side).unwrap_or(0);
    let intrinsics = Intrinsics {
        width: side(size.0),
        height: side(size.1),
        fl_x,
        fl_y,
        cx,
        cy,
        distortion,
    };
    intrinsics
        .check()
        .map_err(|problem| SceneError::malformed(path, place, problem))?;
    Ok(intrinsics)
}
