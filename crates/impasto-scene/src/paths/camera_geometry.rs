//! How the cameras of a capture stand: which way is up and what they look at.

use std::f64::consts::TAU;

use glam::{DMat3, DMat4, DVec3};

use crate::camera::Camera;

/// The common geometry of a capture's cameras.
pub(crate) struct CameraGeometry {
    /// Unit vector away from the ground.
    pub(crate) up: DVec3,
    /// The point nearest to all viewing axes.
    pub(crate) target: DVec3,
    /// Mean camera centre.
    pub(crate) middle: DVec3,
    /// Root mean square distance of the cameras from `middle`.
    pub(crate) extent: f64,
    /// Mean of the unit viewing directions; its length is 1 when all are parallel.
    pub(crate) gaze: DVec3,
}

impl CameraGeometry {
    /// That of at least one camera.
    pub(crate) fn of(cameras: &[Camera]) -> Self {
        let middle = mean(cameras, Camera::centre);
        let extent = (cameras
            .iter()
            .map(|c| c.centre().distance_squared(middle))
            .sum::<f64>()
            / cameras.len() as f64)
            .sqrt();
        Self {
            up: up(cameras),
            target: target(cameras, middle, extent),
            middle,
            extent,
            gaze: mean(cameras, Camera::forward),
        }
    }

    /// Across, away and up: a right-handed frame to look at the capture in. Away is where most
    /// cameras look; where they share no direction, across is the level one of their widest spread.
    pub(crate) fn axes(&self, cameras: &[Camera]) -> [DVec3; 3] {
        // Viewing directions with less in common than this look around, or at something from around.
        const COMMON: f64 = 0.3;
        let up = self.up;
        let gaze = self.gaze - up * self.gaze.dot(up);
        let away = if gaze.length() > COMMON {
            gaze.normalize_or_zero()
        } else {
            up.cross(self.widest(cameras))
        };
        [away.cross(up), away, up]
    }

    /// The level direction along which the cameras are spread most.
    fn widest(&self, cameras: &[Camera]) -> DVec3 {
        let first = self.up.any_orthonormal_vector();
        let second = self.up.cross(first);
        let [mut along, mut both, mut beside] = [0.0; 3];
        for camera in cameras {
            let arm = camera.centre() - self.middle;
            let (a, b) = (arm.dot(first), arm.dot(second));
            (along, both, beside) = (along + a * a, both + a * b, beside + b * b);
        }
        // Angle of the larger principal axis of a symmetric 2 × 2 matrix.
        let angle = 0.5 * f64::atan2(2.0 * both, along - beside);
        first * angle.cos() + second * angle.sin()
    }
}

fn mean(cameras: &[Camera], of: impl Fn(&Camera) -> DVec3) -> DVec3 {
    cameras.iter().map(of).sum::<DVec3>() / cameras.len() as f64
}

/// The direction closest to the cameras' own ups that is level with their horizontal axes.
///
/// The mean of the ups alone leans forward or back when an arc is photographed from above or
/// below; people keep the camera's x axis level, so leaning towards any x axis is penalised.
fn up(cameras: &[Camera]) -> DVec3 {
    const TRUST_IN_MEAN: f64 = 0.05;
    let mean_up = mean(cameras, |c| -c.camera_to_world.y_axis.truncate());
    let across = cameras.iter().fold(DMat3::ZERO, |sum, c| {
        let x = c.camera_to_world.x_axis.truncate();
        sum + outer(x)
    });
    let system = across * (1.0 / cameras.len() as f64) + DMat3::IDENTITY * TRUST_IN_MEAN;
    (system.inverse() * mean_up)
        .try_normalize()
        .or_else(|| Some(-cameras.first()?.camera_to_world.y_axis.truncate()))
        .unwrap_or(DVec3::Z)
}

/// The point nearest to all viewing axes, by least squares with weights that fall with a line's
/// distance, so that a few photos of something else do not pull it away.
fn target(cameras: &[Camera], middle: DVec3, extent: f64) -> DVec3 {
    const ROUNDS: usize = 20;
    // Keeps the point near the cameras along directions in which parallel axes leave it open.
    const PULL: f64 = 1e-4;
    let softening = 0.05 * extent + 1e-9;
    let mut point = middle;
    let mut weights = vec![1.0; cameras.len()];
    for _ in 0..ROUNDS {
        let total: f64 = weights.iter().sum();
        let mut system = DMat3::IDENTITY * (PULL * total);
        let mut right = middle * (PULL * total);
        for (camera, &weight) in cameras.iter().zip(&weights) {
            let off_axis = off_axis(camera);
            system += off_axis * weight;
            right += off_axis * camera.centre() * weight;
        }
        point = system.inverse() * right;
        for (camera, weight) in cameras.iter().zip(&mut weights) {
            let distance = (off_axis(camera) * (point - camera.centre())).length();
            *weight = 1.0 / (distance + softening);
        }
    }
    point
}

/// The projection onto the plane across a camera's viewing axis.
fn off_axis(camera: &Camera) -> DMat3 {
    DMat3::IDENTITY - outer(camera.forward())
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// A camera pose at `position` that looks along `forward` with the horizon level.
pub(super) fn looking(position: DVec3, forward: DVec3, up: DVec3) -> DMat4 {
    let z = forward.normalize_or(DVec3::Z);
    let x = z
        .cross(up)
        .try_normalize()
        .unwrap_or_else(|| z.any_orthonormal_vector());
    pose_of(position, x, z)
}

/// The pose of a camera at `position` with these x and z axes, which are at right angles.
pub(super) fn pose_of(position: DVec3, x: DVec3, z: DVec3) -> DMat4 {
    DMat4::from_cols(
        x.extend(0.0),
        z.cross(x).extend(0.0),
        z.extend(0.0),
        position.extend(1.0),
    )
}

/// The azimuth at which the largest stretch without any of `azimuths` ends, and its width.
pub(crate) fn largest_gap(azimuths: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut azimuths: Vec<f64> = azimuths.collect();
    azimuths.sort_by(f64::total_cmp);
    let around = azimuths.first().map_or(0.0, |first| first + TAU);
    let nexts = azimuths.iter().skip(1).copied().chain([around]);
    azimuths
        .iter()
        .zip(nexts)
        .map(|(&from, to)| (to, to - from))
        .fold(
            (0.0, 0.0),
            |widest, gap| if gap.1 > widest.1 { gap } else { widest },
        )
}
