//! Keyframes of the page as flights.

use impasto_scene::Camera;
use impasto_scene::paths::Flight;
use serde::Deserialize;

/// Largest width and height of a view or a film.
pub(crate) const LARGEST_SIDE: u32 = 4096;
/// Most keyframes of a path.
const MOST_KEYS: usize = 1000;
/// Longest film, in frames.
const MOST_FRAMES: f64 = 20_000.0;

/// Keyframes as the page sends them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Keyframes {
    keyframes: Vec<Keyframe>,
    pub(crate) seconds: f64,
    pub(crate) fps: f64,
    #[serde(default)]
    closed: bool,
    #[serde(default)]
    size: Option<[u32; 2]>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keyframe {
    camera_to_world: [f64; 16],
    fov: f64,
}

/// Refuses sizes that nobody looks at.
pub(crate) fn check_size([width, height]: [u32; 2]) -> Result<(u32, u32), String> {
    let side = 1..=LARGEST_SIDE;
    if side.contains(&width) && side.contains(&height) {
        return Ok((width, height));
    }
    Err(format!(
        "a picture of {width}×{height} pixels is not possible; give 1 to {LARGEST_SIDE} each way"
    ))
}

impl Keyframes {
    /// Their cameras in scene space, of a size or of their own.
    pub(crate) fn cameras(&self, size: Option<[u32; 2]>) -> Result<Vec<Camera>, String> {
        let size = size.or(self.size).unwrap_or([1280, 720]);
        let size = check_size(size)?;
        if self.keyframes.is_empty() || self.keyframes.len() > MOST_KEYS {
            return Err(format!(
                "a path needs 1 to {MOST_KEYS} keyframes, not {}",
                self.keyframes.len()
            ));
        }
        let frames = self.seconds * self.fps;
        if !(1.0..=MOST_FRAMES).contains(&frames) {
            return Err(format!(
                "{} seconds at {} frames a second are no film; give 1 to {MOST_FRAMES} frames",
                self.seconds, self.fps
            ));
        }
        let camera = |(i, key): (usize, &Keyframe)| {
            Camera::viewpoint(&key.camera_to_world, key.fov, size)
                .map_err(|problem| format!("keyframe {i}: {problem}"))
        };
        self.keyframes.iter().enumerate().map(camera).collect()
    }

    /// The flight through cameras of [`Self::cameras`].
    pub(crate) fn flight<'a>(&self, keys: &'a [Camera]) -> Flight<'a> {
        Flight {
            keys,
            seconds: self.seconds,
            fps: self.fps,
            closed: self.closed,
        }
    }
}
