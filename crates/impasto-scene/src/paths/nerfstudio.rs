//! Camera paths written in nerfstudio's form.

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::keyframes::Spline;
use super::{PathError, check_request};
use crate::camera::Camera;
use crate::normalise::Normalisation;

/// A smooth flight through keyframes.
#[derive(Debug, Clone, Copy)]
pub struct Flight<'a> {
    /// Keyframes in scene space, equally far apart in time; at least one. All have the first one's
    /// size.
    pub keys: &'a [Camera],
    /// Length of the film.
    pub seconds: f64,
    /// Frames a second.
    pub fps: f64,
    /// Whether it goes from the last keyframe back to the first.
    pub closed: bool,
}

impl Flight<'_> {
    /// The camera of every frame.
    ///
    /// # Errors
    /// No keyframes, no frames, or more than anyone renders.
    pub fn cameras(&self) -> Result<Vec<Camera>, PathError> {
        let Some(first) = self.keys.first() else {
            return Err(PathError::TooFewCameras {
                needed: 1,
                given: 0,
            });
        };
        let frames = (self.seconds * self.fps).round();
        // Saturates, and what is not a number becomes 0: both are refused below.
        let frames = frames as usize;
        check_request(frames, (first.intrinsics.width, first.intrinsics.height))?;
        let spline = Spline::through(self.keys, self.closed);
        Ok((0..frames)
            .map(|frame| spline.camera(frame, frames))
            .collect())
    }

    /// nerfstudio's camera path: keyframes and every frame, in OpenGL axes and the capture's
    /// coordinates. [`super::keyframes`] reads exactly [`Self::cameras`] from it.
    ///
    /// # Errors
    /// As [`Self::cameras`].
    pub fn nerfstudio(&self, normalisation: &Normalisation) -> Result<Value, PathError> {
        let frames = self.cameras()?;
        let size = frames
            .first()
            .map_or((0, 0), |c| (c.intrinsics.width, c.intrinsics.height));
        let aspect = f64::from(size.0) / f64::from(size.1);
        let pose = |camera: &Camera| {
            let opencv = normalisation.pose_to_capture(camera.camera_to_world);
            let opengl = opencv * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
            opengl.transpose().to_cols_array()
        };
        let key = |c: &Camera| json!({"matrix": pose(c), "fov": c.fov(), "aspect": aspect});
        let frame =
            |c: &Camera| json!({"camera_to_world": pose(c), "fov": c.fov(), "aspect": aspect});
        Ok(json!({
            "camera_type": "perspective",
            "render_width": size.0,
            "render_height": size.1,
            "seconds": self.seconds,
            "fps": self.fps,
            "is_cycle": self.closed,
            "smoothness_value": 0.5,
            "keyframes": self.keys.iter().map(key).collect::<Vec<_>>(),
            "camera_path": frames.iter().map(frame).collect::<Vec<_>>(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{KeyframeOptions, keyframes};
    use super::*;

    fn keys() -> Vec<Camera> {
        let key = |i: u32| {
            let turn = DMat4::from_rotation_y(0.4 * f64::from(i));
            let pose = turn * DMat4::from_translation(DVec3::new(0.1, 0.2, -0.5));
            Camera::viewpoint(&pose.to_cols_array(), 40.0 + 5.0 * f64::from(i), (320, 180))
        };
        (0..3).map(|i| key(i).unwrap()).collect()
    }

    #[test]
    fn a_path_that_is_read_back_has_the_same_frames() {
        let normalisation = Normalisation {
            centre: DVec3::new(3.0, -2.0, 40.0),
            scale: 0.21,
        };
        let keys = keys();
        for closed in [false, true] {
            let flight = Flight {
                keys: &keys,
                seconds: 1.5,
                fps: 10.0,
                closed,
            };
            let json = flight.nerfstudio(&normalisation).unwrap().to_string();
            let options = KeyframeOptions {
                cameras: &[],
                normalisation: &normalisation,
                frames: None,
                size: None,
            };
            let read = keyframes(&json, &options).unwrap();
            let flown = flight.cameras().unwrap();
            assert_eq!((read.len(), flown.len()), (15, 15));
            for (a, b) in read.iter().zip(&flown) {
                assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-9));
                assert!((a.intrinsics.fl_y - b.intrinsics.fl_y).abs() < 1e-6);
            }
            assert!(
                flown[0]
                    .camera_to_world
                    .abs_diff_eq(keys[0].camera_to_world, 1e-9)
            );
        }
    }

    #[test]
    fn flights_without_keys_or_frames_are_refused() {
        let keys = keys();
        let flight = |keys, seconds| Flight {
            keys,
            seconds,
            fps: 24.0,
            closed: false,
        };
        assert!(flight(&[][..], 1.0).cameras().is_err());
        for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(flight(&keys[..], seconds).cameras().is_err(), "{seconds}");
        }
        assert_eq!(flight(&keys[..1], 1.0).cameras().unwrap().len(), 24);
    }
}
