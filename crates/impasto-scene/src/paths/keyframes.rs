//! Camera paths from JSON files, with smooth interpolation.
//!
//! Two forms are read. nerfstudio's has `camera_path` (every frame) or `keyframes`: poses as 16
//! numbers, row by row, in OpenGL axes and in the *capture's* coordinates, with a vertical field
//! of view in degrees. Our own `cameras.json` has `frames` with `camera_to_world`, `fl_x` and so
//! on, in OpenCV axes and in *scene* space.

use glam::DMat4;
use serde::Deserialize;
use serde_json::Value;

use super::pinhole::{median_lens, of_fov};
use super::request::{PathError, cameras_of, check_request, rigid};
use super::spline::Spline;
use crate::camera::{Camera, Intrinsics};
use crate::normalise::Normalisation;
use crate::pose;

/// Frames between two keyframes when neither the caller nor the file says how many.
const FRAMES_PER_STEP: usize = 30;

/// What a path file leaves open.
#[derive(Debug, Clone, Copy)]
pub struct KeyframeOptions<'a> {
    /// The model's train cameras, in scene space: field of view and size where the file has none.
    pub cameras: &'a [Camera],
    /// From the capture's coordinates to scene space, for nerfstudio's files.
    pub normalisation: &'a Normalisation,
    /// Number of frames to render; the file's own number if `None`.
    pub frames: Option<usize>,
    /// Width and height of the frames; the file's own, or the first photo's, if `None`.
    pub size: Option<(u32, u32)>,
}

#[derive(Deserialize)]
struct PathFile {
    camera_path: Option<Vec<Value>>,
    keyframes: Option<Vec<Value>>,
    frames: Option<Vec<Value>>,
    render_width: Option<f64>,
    render_height: Option<f64>,
    fps: Option<f64>,
    seconds: Option<f64>,
    #[serde(default)]
    is_cycle: bool,
}

impl PathFile {
    /// How many frames a path through so many keyframes has.
    fn frames_between(&self, keys: usize) -> usize {
        let stated = self.fps.zip(self.seconds);
        let stated = stated.map(|(fps, seconds)| (fps * seconds).round() as usize);
        let steps = if self.is_cycle { keys } else { keys - 1 };
        stated
            .filter(|&n| n > 0)
            .unwrap_or(steps * FRAMES_PER_STEP + 1)
    }
}

#[derive(Deserialize)]
struct NerfstudioKey {
    #[serde(alias = "matrix")]
    camera_to_world: Vec<f64>,
    fov: Option<f64>,
}

/// The cameras of a path file's text, interpolated when its number of frames is not the one
/// wanted: a Catmull-Rom spline through positions, rotations and logarithms of focal lengths, on
/// which the file's frames are equally far apart in time. nerfstudio's `is_cycle` closes it.
///
/// # Errors
/// Text that is not JSON or of neither form, and frames whose pose is not a rotation or whose
/// lens is impossible, by their number.
pub fn keyframes(json: &str, options: &KeyframeOptions<'_>) -> Result<Vec<Camera>, PathError> {
    let file: PathFile = serde_json::from_str(json)
        .map_err(|e| PathError::Unreadable(format!("the camera path is not valid ({e})")))?;
    let rendered = match (file.render_width, file.render_height) {
        (Some(w), Some(h)) => Some((w.round() as u32, h.round() as u32)),
        _ => None,
    };
    let size = options.size.or(rendered);
    fn filled(list: &Option<Vec<Value>>) -> Option<&[Value]> {
        list.as_deref().filter(|list| !list.is_empty())
    }
    let (keys, default_frames) = if let Some(path) = filled(&file.camera_path) {
        (nerfstudio(path, "frame", size, options)?, path.len())
    } else if let Some(keys) = filled(&file.keyframes) {
        let frames = nerfstudio(keys, "keyframe", size, options)?;
        (frames, file.frames_between(keys.len()))
    } else if let Some(frames) = filled(&file.frames) {
        (ours(frames, options.size)?, frames.len())
    } else {
        return Err(PathError::Unreadable(
            "the camera path has no frames; it needs a list \"frames\" (as in cameras.json), or \
             nerfstudio's \"camera_path\" or \"keyframes\""
                .into(),
        ));
    };
    let size = keys[0].intrinsics.size();
    let frames = options.frames.unwrap_or(default_frames);
    check_request(frames, size)?;
    if frames == keys.len() {
        return Ok(keys);
    }
    Ok(Spline::through(&keys, file.is_cycle).cameras(frames))
}

/// Frames a second that a path file's text states, if it does: a positive number.
pub fn frame_rate(json: &str) -> Option<f64> {
    let file: PathFile = serde_json::from_str(json).ok()?;
    file.fps.filter(|fps| fps.is_finite() && *fps > 0.0)
}

fn nerfstudio(
    keys: &[Value],
    kind: &'static str,
    size: Option<(u32, u32)>,
    options: &KeyframeOptions<'_>,
) -> Result<Vec<Camera>, PathError> {
    let photo = options.cameras.first().map(|c| c.intrinsics.size());
    let size = size.or(photo).ok_or_else(PathError::no_cameras)?;
    check_request(keys.len(), size)?;
    cameras_of(kind, keys, |value| {
        let key = NerfstudioKey::deserialize(value).map_err(|e| e.to_string())?;
        let intrinsics = match key.fov {
            Some(fov) if fov > 0.0 && fov < 180.0 => of_fov(fov, size),
            Some(fov) => return Err(format!("a field of view of {fov} degrees is not possible")),
            None => median_lens(options.cameras, size),
        };
        let numbers: &[f64; 16] = key.camera_to_world.as_slice().try_into().map_err(|_| {
            format!(
                "its pose has {} numbers instead of 16",
                key.camera_to_world.len()
            )
        })?;
        let pose = pose::from_opengl(DMat4::from_cols_array(numbers).transpose());
        Ok(Camera {
            intrinsics,
            camera_to_world: options.normalisation.pose_to_scene(rigid(pose)?),
        })
    })
}

/// Frames of our own `cameras.json`.
fn ours(frames: &[Value], size: Option<(u32, u32)>) -> Result<Vec<Camera>, PathError> {
    let mut cameras = cameras_of("frame", frames, |value| {
        if value.get("transform_matrix").is_some() {
            return Err("this is a capture (transforms.json), not a camera path".into());
        }
        let camera = Camera::deserialize(value).map_err(|e| e.to_string())?;
        camera.intrinsics.check()?;
        Ok(Camera {
            camera_to_world: rigid(camera.camera_to_world)?,
            ..camera
        })
    })?;
    if let Some(size) = size {
        check_request(1, size)?;
        for camera in &mut cameras {
            camera.intrinsics = fitted(&camera.intrinsics, size);
        }
    }
    Ok(cameras)
}

/// The lens on another pixel grid. A grid of another shape shows no more than the old one did.
fn fitted(lens: &Intrinsics, size: (u32, u32)) -> Intrinsics {
    let scaled = lens.resized(size.0, size.1);
    let stretch = (scaled.fl_x / scaled.fl_y) / (lens.fl_x / lens.fl_y);
    Intrinsics {
        fl_x: scaled.fl_x * (1.0 / stretch).max(1.0),
        fl_y: scaled.fl_y * stretch.max(1.0),
        ..scaled
    }
}
