//! Pinhole cameras with OpenCV lens distortion.
//!
//! Camera space is right-handed with x right, y down and z forward (OpenCV, COLMAP).

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// OpenCV's first four lens coefficients; all zero means an ideal pinhole.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Distortion {
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
}

impl Distortion {
    /// Whether the lens bends nothing.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Maps an ideal image-plane point (at z = 1) to where the lens puts it.
    pub fn apply(&self, p: DVec2) -> DVec2 {
        let (r2, xy) = (p.length_squared(), p.x * p.y);
        let radial = 1.0 + r2 * (self.k1 + r2 * self.k2);
        let tangential = DVec2::new(
            2.0 * self.p1 * xy + self.p2 * (r2 + 2.0 * p.x * p.x),
            self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * xy,
        );
        p * radial + tangential
    }

    /// Inverse of [`Distortion::apply`] by Newton's method.
    ///
    /// Outside the region where the lens model is invertible the closest iterate is returned.
    pub fn remove(&self, distorted: DVec2) -> DVec2 {
        if self.is_none() {
            return distorted;
        }
        const STEP: f64 = 1e-6;
        let mut p = distorted;
        let (mut best, mut best_error) = (p, f64::INFINITY);
        for _ in 0..12 {
            let error = self.apply(p) - distorted;
            if error.length_squared() < best_error {
                (best, best_error) = (p, error.length_squared());
            }
            if best_error < 1e-24 {
                break;
            }
            let slope = |step: DVec2| (self.apply(p + step) - self.apply(p - step)) / (2.0 * STEP);
            let (dx, dy) = (slope(DVec2::X * STEP), slope(DVec2::Y * STEP));
            let det = dx.x * dy.y - dy.x * dx.y;
            if det.abs() < 1e-9 {
                break;
            }
            p -= DVec2::new(
                dy.y * error.x - dy.x * error.y,
                dx.x * error.y - dx.y * error.x,
            ) / det;
        }
        best
    }
}

/// How a camera maps its image plane to pixels. Lengths are in pixels; pixel (0, 0) covers
/// `[0, 1) × [0, 1)`, so its centre is (½, ½).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Image width.
    #[serde(rename = "w")]
    pub width: u32,
    /// Image height.
    #[serde(rename = "h")]
    pub height: u32,
    /// Horizontal focal length.
    pub fl_x: f64,
    /// Vertical focal length.
    pub fl_y: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
    /// Lens distortion; left out of JSON when there is none.
    #[serde(default, skip_serializing_if = "Distortion::is_none")]
    pub distortion: Distortion,
}

/// Focal lengths that lenses without fisheye projection have, in units of the image's side: from
/// 176 degrees of view to what no telescope resolves.
const SHARES: std::ops::RangeInclusive<f64> = 0.02..=1e6;

impl Intrinsics {
    /// Says what makes these numbers unusable as a camera, if anything does.
    pub(crate) fn check(&self) -> Result<(), String> {
        let d = &self.distortion;
        if self.width == 0 || self.height == 0 {
            return Err("the image size must be positive whole numbers".into());
        }
        let numbers = [self.cx, self.cy, d.k1, d.k2, d.p1, d.p2];
        if !numbers.iter().all(|x| x.is_finite()) {
            return Err("the principal point or the distortion is NaN or infinite".into());
        }
        for focal in [self.fl_x, self.fl_y] {
            if !(focal.is_finite() && focal > 0.0) {
                return Err(format!(
                    "the focal length must be positive, not {focal}; state it in pixels"
                ));
            }
        }
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        for (focal, side) in [(self.fl_x, width), (self.fl_y, height)] {
            if !SHARES.contains(&(focal / side)) {
                return Err(format!(
                    "a focal length of {focal} pixels does not belong to an image of {}×{}; state \
                     both in the same pixels",
                    self.width, self.height
                ));
            }
        }
        let inside = |at: f64, side: f64| (-side..=2.0 * side).contains(&at);
        if !inside(self.cx, width) || !inside(self.cy, height) {
            return Err(format!(
                "the principal point ({}, {}) lies far outside the image of {}×{}; state both in the \
                 same pixels",
                self.cx, self.cy, self.width, self.height
            ));
        }
        Ok(())
    }

    /// Width and height of the image in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The same lens imaged on `width × height` pixels.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Self {
            width,
            height,
            fl_x: self.fl_x * sx,
            fl_y: self.fl_y * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            distortion: self.distortion,
        }
    }
}

/// A half-line through the scene. `direction` has z = 1 in camera space and is *not* a unit
/// vector, so that a ray parameter is the depth along the camera's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Camera centre.
    pub origin: DVec3,
    /// Direction with unit camera-space z.
    pub direction: DVec3,
}

/// One posed camera.
///
/// As JSON: `camera_to_world` (four rows of four), `w`, `h`, `fl_x`, `fl_y`, `cx`, `cy` and, for a
/// lens that bends, `distortion`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Lens and image size.
    #[serde(flatten)]
    pub intrinsics: Intrinsics,
    /// Rigid transform from camera space to the world (or to scene space after normalisation).
    #[serde(with = "crate::codec::rows")]
    pub camera_to_world: DMat4,
}

impl Camera {
    /// Where the camera stands.
    pub fn centre(&self) -> DVec3 {
        self.camera_to_world.w_axis.truncate()
    }

    /// Unit viewing direction.
    pub fn forward(&self) -> DVec3 {
        self.camera_to_world.z_axis.truncate()
    }

    /// Ray through image position `(x, y)` in pixels; a pixel's centre is at `index + ½`.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let k = &self.intrinsics;
        let seen = DVec2::new((x - k.cx) / k.fl_x, (y - k.cy) / k.fl_y);
        let ideal = k.distortion.remove(seen);
        Ray {
            origin: self.centre(),
            direction: DMat3::from_mat4(self.camera_to_world) * ideal.extend(1.0),
        }
    }

    /// Image position in pixels and depth along the axis of a world point, or `None` behind the
    /// camera.
    pub fn project(&self, point: DVec3) -> Option<(DVec2, f64)> {
        let local = DMat3::from_mat4(self.camera_to_world).transpose() * (point - self.centre());
        if local.z <= 1e-9 {
            return None;
        }
        let k = &self.intrinsics;
        let p = k.distortion.apply(local.truncate() / local.z);
        let pixel = DVec2::new(p.x * k.fl_x + k.cx, p.y * k.fl_y + k.cy);
        Some((pixel, local.z))
    }

    /// The camera turned about its centre by a rotation vector (radians), then shifted, both along
    /// its own axes: right, down, forward.
    pub fn moved(&self, turn: DVec3, shift: DVec3) -> Self {
        let motion = DMat4::from_rotation_translation(DQuat::from_scaled_axis(turn), shift);
        Self {
            camera_to_world: self.camera_to_world * motion,
            ..*self
        }
    }

    /// The same view on another pixel grid.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        Self {
            intrinsics: self.intrinsics.resized(width, height),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn bent() -> Camera {
        Camera {
            intrinsics: Intrinsics {
                width: 540,
                height: 960,
                fl_x: 687.8,
                fl_y: 687.2,
                cx: 277.3,
                cy: 482.6,
                distortion: Distortion {
                    k1: 0.058,
                    k2: -0.081,
                    p1: -0.001,
                    p2: 0.0002,
                },
            },
            camera_to_world: DMat4::from_rotation_translation(
                DQuat::from_xyzw(0.1, -0.4, 0.2, 0.9).normalize(),
                DVec3::new(0.3, -2.0, 1.5),
            ),
        }
    }

    #[test]
    fn removing_a_distortion_undoes_it() {
        let lens = bent().intrinsics.distortion;
        for (x, y) in [(0.0, 0.0), (0.4, -0.7), (-0.39, 0.69), (0.1, 0.5)] {
            let p = DVec2::new(x, y);
            assert!((lens.remove(lens.apply(p)) - p).length() < 1e-10, "at {p}");
        }
    }

    #[test]
    fn a_distortion_without_inverse_gives_a_finite_point() {
        let lens = Distortion {
            k1: -0.5,
            ..Distortion::default()
        };
        assert!(lens.remove(DVec2::new(3.0, 2.0)).is_finite());
    }

    #[test]
    fn a_point_on_a_ray_projects_to_its_pixel_at_its_depth() {
        let camera = bent();
        for (x, y, depth) in [(0.5, 0.5, 1.0), (539.5, 959.5, 7.0), (270.0, 100.0, 0.2)] {
            let ray = camera.ray(x, y);
            let (pixel, z) = camera
                .project(ray.origin + ray.direction * depth)
                .expect("in front");
            assert!((pixel - DVec2::new(x, y)).length() < 1e-7, "{pixel}");
            assert!((z - depth).abs() < 1e-10);
        }
        assert!(camera.project(camera.centre() - camera.forward()).is_none());
    }

    #[test]
    fn resizing_keeps_every_ray() {
        let (camera, small) = (bent(), bent().resized(135, 240));
        let (a, b) = (camera.ray(400.0, 80.0), small.ray(100.0, 20.0));
        assert!((a.direction - b.direction).length() < 1e-10);
    }

    #[test]
    fn json_keeps_a_camera_exactly_and_shows_rows() {
        let camera = bent();
        let json = serde_json::to_value(camera).unwrap();
        assert_eq!(json["camera_to_world"][1][3], -2.0);
        assert_eq!(json["w"], 540);
        let text = serde_json::to_string(&camera).unwrap();
        assert_eq!(serde_json::from_str::<Camera>(&text).unwrap(), camera);
    }
}
