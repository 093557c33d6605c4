//! The similarity between a capture's own coordinates and scene space.

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// Radius of the farthest camera in scene space; the rest of the unit ball is room around it.
const FARTHEST: f64 = 1.0 / 1.1;

/// `scene = (capture − centre) · scale`: the mean camera centre at the origin and the farthest
/// camera at radius 1/1.1. Rotations are the same in both spaces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Normalisation {
    /// Mean camera centre, in capture coordinates.
    #[serde(with = "crate::codec::triple")]
    pub centre: DVec3,
    /// Scene units per capture unit, positive.
    pub scale: f64,
}

impl Normalisation {
    /// Capture coordinates that already are scene coordinates.
    pub const IDENTITY: Self = Self {
        centre: DVec3::ZERO,
        scale: 1.0,
    };

    /// The normalisation of cameras at `centres`, or `None` when they all stand at one place
    /// (or there are none, or a coordinate is not finite).
    pub fn of_cameras(centres: &[DVec3]) -> Option<Self> {
        let count = centres.len() as f64;
        let centre = centres.iter().sum::<DVec3>() / count;
        let radius = centres
            .iter()
            .map(|c| c.distance(centre))
            .fold(0.0, f64::max);
        let scale = FARTHEST / radius;
        // Below this, differences between the centres are rounding errors.
        let distinct = radius > 1e-9 * centre.length() && radius > 1e-12;
        (centre.is_finite() && distinct && scale.is_finite()).then_some(Self { centre, scale })
    }

    /// A point in scene space.
    pub fn to_scene(&self, capture: DVec3) -> DVec3 {
        (capture - self.centre) * self.scale
    }

    /// A point in the capture's coordinates.
    pub fn to_capture(&self, scene: DVec3) -> DVec3 {
        scene / self.scale + self.centre
    }

    /// A rigid camera-to-world transform, into scene space.
    pub fn pose_to_scene(&self, camera_to_world: DMat4) -> DMat4 {
        moved(camera_to_world, |centre| self.to_scene(centre))
    }

    /// A rigid camera-to-scene transform, back into the capture's coordinates.
    pub fn pose_to_capture(&self, camera_to_scene: DMat4) -> DMat4 {
        moved(camera_to_scene, |centre| self.to_capture(centre))
    }
}

fn moved(mut pose: DMat4, to: impl Fn(DVec3) -> DVec3) -> DMat4 {
    pose.w_axis = to(pose.w_axis.truncate()).extend(1.0);
    pose
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_goes_to_the_origin_and_the_farthest_to_its_radius() {
        let centres = [
            DVec3::new(10.0, 0.0, 2.0),
            DVec3::new(14.0, 0.0, 2.0),
            DVec3::new(12.0, 9.0, 2.0),
        ];
        let n = Normalisation::of_cameras(&centres).unwrap();
        let scene: Vec<DVec3> = centres.iter().map(|&c| n.to_scene(c)).collect();
        assert!(scene.iter().sum::<DVec3>().length() < 1e-12);
        let farthest = scene.iter().map(|c| c.length()).fold(0.0, f64::max);
        assert!((farthest - 1.0 / 1.1).abs() < 1e-12);
    }

    #[test]
    fn there_and_back_is_nothing() {
        let n = Normalisation {
            centre: DVec3::new(400_000.0, -3.0, 9.0),
            scale: 0.037,
        };
        let point = DVec3::new(400_011.0, 5.0, -2.0);
        assert!(n.to_capture(n.to_scene(point)).distance(point) < 1e-9);
        let pose = DMat4::from_translation(point) * DMat4::from_rotation_z(0.3);
        assert!(
            n.pose_to_capture(n.pose_to_scene(pose))
                .abs_diff_eq(pose, 1e-9)
        );
        let json = serde_json::to_string(&n).unwrap();
        assert_eq!(serde_json::from_str::<Normalisation>(&json).unwrap(), n);
    }

    #[test]
    fn one_place_has_no_scale() {
        let here = DVec3::new(1e5, 2e5, 3.0);
        assert_eq!(Normalisation::of_cameras(&[here; 4]), None);
        assert_eq!(Normalisation::of_cameras(&[]), None);
        assert_eq!(Normalisation::of_cameras(&[here, DVec3::NAN]), None);
    }
}
