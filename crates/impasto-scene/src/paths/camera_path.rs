//! Camera paths through keyframes that somebody set, and how they are written for others.

use glam::DMat4;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::pinhole::of_fov;
use super::request::{PathError, cameras_of, check_request, rigid};
use super::spline::Spline;
use crate::camera::Camera;
use crate::normalise::Normalisation;
use crate::pose;

/// Vertical fields of view that a keyframe may have, in degrees.
const FOVS: std::ops::RangeInclusive<f64> = 1.0..=170.0;
/// What nerfstudio's viewer calls the tension of a Catmull-Rom spline that passes as ours does.
const TENSION: f64 = 0.0;

/// A viewpoint that a camera path passes through.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Keyframe {
    /// Rigid transform from camera space to scene space; as JSON sixteen numbers, column by column.
    #[serde(with = "crate::codec::columns")]
    pub camera_to_world: DMat4,
    /// Vertical field of view in degrees, 1 to 170.
    pub fov: f64,
}

/// A smooth path through keyframes. Its JSON form is what the studio's page sends.
///
/// ```
/// use impasto_scene::Normalisation;
/// use impasto_scene::paths::CameraPath;
///
/// let path: CameraPath = serde_json::from_str(
///     r#"{"keyframes": [
///         {"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "fov": 50},
///         {"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 1,0,0,1], "fov": 40}],
///         "seconds": 2, "fps": 24, "closed": false, "size": [640, 360]}"#,
/// )?;
/// let cameras = path.cameras()?;
/// assert_eq!(cameras.len(), 48);
/// let text = path.to_nerfstudio(&Normalisation::IDENTITY)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// At least one, in order.
    pub keyframes: Vec<Keyframe>,
    /// How long it takes.
    pub seconds: f64,
    /// Frames a second.
    #[serde(default = "film_rate")]
    pub fps: f64,
    /// Whether it goes on from the last keyframe to the first. Its last frame is then one step
    /// before its first, so that the film loops.
    #[serde(default)]
    pub closed: bool,
    /// Width and height of the frames in pixels.
    pub size: (u32, u32),
    /// Whether the camera goes equally fast everywhere: frames are equally far apart along the path,
    /// where turning by a radian or zooming by a factor of e counts as much as half a scene unit of
    /// moving. Without, it takes as long from each keyframe to the next, however far that is.
    #[serde(default = "yes")]
    pub even_speed: bool,
}

fn film_rate() -> f64 {
    24.0
}

fn yes() -> bool {
    true
}

impl CameraPath {
    /// Number of frames: seconds times frames a second, rounded.
    pub fn frames(&self) -> usize {
        (self.seconds * self.fps).round() as usize
    }

    /// The frames' cameras, in scene space: ideal pinholes that meet the keyframes (with
    /// `even_speed`, the first and, on an open path, the last).
    ///
    /// # Errors
    /// No keyframes, no time, no or too many frames or pixels; keyframes whose pose is not a
    /// rotation or whose field of view is impossible, by their number from 0.
    pub fn cameras(&self) -> Result<Vec<Camera>, PathError> {
        let keys = self.keys()?;
        if self.even_speed {
            return Ok(Spline::centripetal(&keys, self.closed).even_cameras(self.frames()));
        }
        Ok(Spline::through(&keys, self.closed).cameras(self.frames()))
    }

    fn keys(&self) -> Result<Vec<Camera>, PathError> {
        if self.keyframes.is_empty() {
            return Err(PathError::Unreadable(
                "the camera path has no keyframes; set at least one".into(),
            ));
        }
        let positive = |number: f64| number.is_finite() && number > 0.0;
        if !positive(self.seconds) || !positive(self.fps) {
            return Err(PathError::Time {
                seconds: self.seconds,
                fps: self.fps,
            });
        }
        check_request(self.frames().max(self.keyframes.len()), self.size)?;
        check_request(self.frames(), self.size)?;
        cameras_of("keyframe", &self.keyframes, |key| key.camera(self.size))
    }

    /// The text of a camera path of nerfstudio's, with the keyframes and every frame: in OpenGL axes
    /// and in the capture's coordinates, where `normalisation` leads to scene space from.
    /// [`keyframes`](super::keyframes) makes the same cameras of it.
    ///
    /// # Errors
    /// As for [`CameraPath::cameras`].
    pub fn to_nerfstudio(&self, normalisation: &Normalisation) -> Result<String, PathError> {
        let aspect = f64::from(self.size.0) / f64::from(self.size.1);
        let pose = |camera: &Camera| {
            let capture = normalisation.pose_to_capture(camera.camera_to_world);
            pose::from_opengl(capture).transpose().to_cols_array()
        };
        let frame = |camera: &Camera| json!({"camera_to_world": pose(camera), "fov": camera.fov(), "aspect": aspect});
        let keys = self.keys()?;
        let open = usize::from(!self.closed);
        let parts = (keys.len() - open).max(1);
        let key = |(index, camera): (usize, &Camera)| {
            let time = index as f64 / parts as f64;
            let name = format!("Camera {index}");
            // Older viewers keep a list of pairs as a text.
            let properties = json!([["FOV", camera.fov()], ["NAME", name], ["TIME", time]]);
            json!({
                "matrix": pose(camera),
                "fov": camera.fov(),
                "aspect": aspect,
                "properties": properties.to_string(),
                "override_transition_enabled": false,
                "override_transition_sec": null,
            })
        };
        let path = json!({
            "camera_type": "perspective",
            "render_width": self.size.0,
            "render_height": self.size.1,
            "fps": whole(self.fps),
            "seconds": self.seconds,
            "is_cycle": self.closed,
            "smoothness_value": TENSION,
            "default_fov": keys[0].fov(),
            "default_transition_sec": self.seconds / parts as f64,
            "keyframes": keys.iter().enumerate().map(key).collect::<Vec<_>>(),
            "camera_path": self.cameras()?.iter().map(frame).collect::<Vec<_>>(),
        });
        Ok(format!("{path}\n"))
    }
}

impl Keyframe {
    fn camera(&self, size: (u32, u32)) -> Result<Camera, String> {
        if !FOVS.contains(&self.fov) {
            return Err(format!(
                "a field of view of {} degrees is not possible; use {} to {}",
                self.fov,
                FOVS.start(),
                FOVS.end()
            ));
        }
        Ok(Camera {
            intrinsics: of_fov(self.fov, size),
            camera_to_world: rigid(self.camera_to_world)?,
        })
    }
}

/// A number without a decimal point where it needs none: some readers want whole frames a second.
fn whole(number: f64) -> Value {
    if number.fract() == 0.0 && number < 1e9 {
        return (number as u64).into();
    }
    number.into()
}
