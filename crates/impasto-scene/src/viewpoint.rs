//! Viewpoints of somebody who walks through a scene: cameras from a viewer's numbers, parts of a
//! view, and where a capture is looked at from.

use glam::{DMat4, DVec3};

use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::paths::pinhole::of_fov;
use crate::pose;
use crate::statistics::median;

impl Camera {
    /// An ideal pinhole with square pixels: `columns` is camera to scene, column by column, in the
    /// axes of [`Camera`]; `fov` is vertical, in degrees; `size` is width and height in pixels.
    ///
    /// # Errors
    /// What is wrong with the pose, the angle or the size, as a sentence.
    pub fn viewpoint(columns: &[f64; 16], fov: f64, size: (u32, u32)) -> Result<Self, String> {
        if size.0 == 0 || size.1 == 0 {
            return Err("a view needs at least one pixel".into());
        }
        if !(1.0..=170.0).contains(&fov) {
            return Err(format!(
                "a field of view of {fov} degrees is not possible; give 1 to 170"
            ));
        }
        let camera_to_world = pose::rigid(DMat4::from_cols_array(columns))
            .map_err(|problem| format!("the pose {problem}"))?;
        Ok(Self {
            intrinsics: of_fov(fov, size),
            camera_to_world,
        })
    }

    /// The camera of `count` rows of this one's picture, the first of them `from`.
    pub fn rows(&self, from: u32, count: u32) -> Self {
        let mut part = *self;
        part.intrinsics.height = count;
        part.intrinsics.cy -= f64::from(from);
        part
    }

    /// Vertical field of view in degrees, without distortion.
    pub fn fov(&self) -> f64 {
        let k = &self.intrinsics;
        (2.0 * (0.5 * f64::from(k.height) / k.fl_y).atan()).to_degrees()
    }
}

/// How the cameras of a capture stand around what they show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vantage {
    /// Unit vector away from the ground.
    pub up: DVec3,
    /// The point nearest to all viewing axes.
    pub focus: DVec3,
    /// Median distance of the cameras from it.
    pub radius: f64,
}

impl Vantage {
    /// That of cameras; `None` if there are none.
    pub fn of(cameras: &[Camera]) -> Option<Self> {
        let CameraGeometry { up, target, .. } = CameraGeometry::of(cameras);
        let distances = cameras.iter().map(|c| c.centre().distance(target));
        Some(Self {
            radius: median(distances)?,
            up,
            focus: target,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> Camera {
        let pose = DMat4::from_rotation_y(0.4) * DMat4::from_translation(DVec3::new(0.1, 0.2, 0.3));
        Camera::viewpoint(&pose.to_cols_array(), 50.0, (64, 48)).unwrap()
    }

    #[test]
    fn a_part_of_a_view_has_the_rays_of_the_whole() {
        let (whole, part) = (view(), view().rows(16, 8));
        assert_eq!(part.intrinsics.height, 8);
        assert_eq!(whole.ray(3.5, 18.5), part.ray(3.5, 2.5));
        assert!((whole.fov() - 50.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_view_is_refused() {
        let pose = DMat4::IDENTITY.to_cols_array();
        let refused = |pose: &[f64; 16], fov, size| Camera::viewpoint(pose, fov, size).unwrap_err();
        assert!(refused(&pose, 50.0, (0, 9)).contains("pixel"));
        for fov in [0.0, 171.0, f64::NAN, f64::INFINITY] {
            assert!(refused(&pose, fov, (9, 9)).contains("field of view"));
        }
        let mut scaled = pose;
        scaled[0] = 2.0;
        assert!(refused(&scaled, 50.0, (9, 9)).contains("rotation"));
        scaled[0] = f64::NAN;
        assert!(refused(&scaled, 50.0, (9, 9)).contains("NaN"));
    }

    #[test]
    fn cameras_on_a_circle_look_at_its_middle() {
        let around = (0..8).map(|i| {
            let turn = DMat4::from_rotation_y(f64::from(i) * 0.785);
            let pose = turn * DMat4::from_translation(DVec3::new(0.0, 0.0, -0.7));
            Camera::viewpoint(&pose.to_cols_array(), 50.0, (8, 6)).unwrap()
        });
        let vantage = Vantage::of(&around.collect::<Vec<_>>()).unwrap();
        assert!(vantage.focus.length() < 1e-3, "{vantage:?}");
        assert!((vantage.radius - 0.7).abs() < 1e-3);
        assert!((vantage.up - DVec3::NEG_Y).length() < 1e-3);
        assert_eq!(Vantage::of(&[]), None);
    }
}
