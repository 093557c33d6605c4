//! The walk that methods are compared on.

use impasto_scene::paths::{PathError, orbit};
use impasto_scene::{Camera, Split};
use impasto_train::Model;

/// `frames` cameras around a model's scene, in the photos' shape with at most `longest` pixels on
/// the longer side; none for a model without photos to train on, or when none are asked for.
///
/// # Errors
/// If no orbit can be fitted to the cameras.
pub fn small_orbit(model: &Model, frames: usize, longest: u32) -> Result<Vec<Camera>, PathError> {
    let train = model.file.scene.cameras(Split::Train);
    let Some(first) = train.first().filter(|_| frames > 0) else {
        return Ok(Vec::new());
    };
    let (width, height) = (first.intrinsics.width, first.intrinsics.height);
    let scale = (f64::from(longest) / f64::from(width.max(height))).min(1.0);
    let size = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    orbit(&train, frames, (size[0], size[1]))
}
