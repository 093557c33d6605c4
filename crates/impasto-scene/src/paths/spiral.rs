//! A closed sway in front of a scene that was photographed from one side.

use std::f64::consts::TAU;

use glam::{DVec3, DVec4};

use super::camera_geometry::{CameraGeometry, looking};
use super::pinhole::median_lens;
use super::request::{PathError, check_fit};
use crate::camera::Camera;

/// Turns of the spiral in one film.
const TURNS: f64 = 2.0;

/// The part of the cameras' own spread that the path uses, so that it stays among them.
const REACH: f64 = 0.7;

/// `frames` cameras that sway around the mean camera while looking at what all cameras look at,
/// with the median photo's field of view. For forward-facing captures. The film loops.
///
/// # Errors
/// No cameras, no frames or no pixels.
pub fn spiral(
    cameras: &[Camera],
    frames: usize,
    size: (u32, u32),
) -> Result<Vec<Camera>, PathError> {
    check_fit(cameras, frames, size)?;
    let geometry = CameraGeometry::of(cameras);
    let forward = geometry.gaze.normalize_or(cameras[0].forward());
    let base = looking(geometry.middle, forward, geometry.up);
    let axes = [base.x_axis, base.y_axis, base.z_axis].map(DVec4::truncate);
    let reach = axes.map(|axis| REACH * spread(cameras, geometry.middle, axis));
    let focus = geometry.middle + forward * focus_distance(&geometry, forward);
    let intrinsics = median_lens(cameras, size);
    let camera = |frame: usize| {
        let turn = TAU * frame as f64 / frames as f64;
        let offset = axes[0] * (reach[0] * (TURNS * turn).cos())
            + axes[1] * (reach[1] * (TURNS * turn).sin())
            + axes[2] * (reach[2] * turn.sin());
        let position = geometry.middle + offset;
        Camera {
            intrinsics,
            camera_to_world: looking(position, focus - position, geometry.up),
        }
    };
    Ok((0..frames).map(camera).collect())
}

/// Root mean square offset of the cameras from their middle along one axis, times √2: the radius
/// of a circle whose points have that spread.
fn spread(cameras: &[Camera], middle: DVec3, axis: DVec3) -> f64 {
    let sum: f64 = cameras
        .iter()
        .map(|c| (c.centre() - middle).dot(axis).powi(2))
        .sum();
    (2.0 * sum / cameras.len() as f64).sqrt()
}

/// How far ahead the scene is. Nearly parallel axes tell this badly, so the answer is kept within
/// the depths at which a capture of this extent makes sense.
fn focus_distance(geometry: &CameraGeometry, forward: DVec3) -> f64 {
    let extent = geometry.extent.max(1e-6);
    (geometry.target - geometry.middle)
        .dot(forward)
        .clamp(2.0 * extent, 20.0 * extent)
}
