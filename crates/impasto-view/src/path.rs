//! Sizes and paths that the page may ask for.

use impasto_scene::Camera;
use impasto_scene::paths::CameraPath;

/// Largest width and height of a view or a film.
pub(crate) const LARGEST_SIDE: u32 = 4096;
/// Most keyframes of a path.
const MOST_KEYS: usize = 1000;
/// Longest film, in frames.
const MOST_FRAMES: usize = 20_000;

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

/// The frames' cameras in scene space. Refuses paths that would keep the server busy for long
/// before a frame is rendered.
pub(crate) fn cameras(path: &CameraPath) -> Result<Vec<Camera>, String> {
    check_size([path.size.0, path.size.1])?;
    let keys = path.keyframes.len();
    if keys == 0 || keys > MOST_KEYS {
        return Err(format!(
            "a path needs 1 to {MOST_KEYS} keyframes, not {keys}"
        ));
    }
    if !(1..=MOST_FRAMES).contains(&path.frames()) {
        return Err(format!(
            "{} seconds at {} frames a second are no film; give 1 to {MOST_FRAMES} frames",
            path.seconds, path.fps
        ));
    }
    path.cameras().map_err(|error| error.to_string())
}
