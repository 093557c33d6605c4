//! What all methods are compared on: cameras, and a model's renders from them.

use crate::error::EvalError;
use crate::resize::scaled_size;
use image::RgbImage;
use impasto_model::{Model, StyledAppearance};
use impasto_scene::paths::{PathError, orbit};
use impasto_scene::{Camera, Split};

/// Paintings rendered together: geometry is computed once for them, and their frames are all in
/// memory.
pub(crate) const GROUP: usize = 8;

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
    orbit(&train, frames, scaled_size([width, height], scale).into())
}

/// Cameras of the held-out photos, or of all if there are none.
pub(crate) fn held_out(model: &Model) -> Vec<Camera> {
    let scene = &model.file.scene;
    let test = scene.cameras(Split::Test);
    if !test.is_empty() {
        return test;
    }
    scene.photos.iter().map(|photo| photo.camera).collect()
}

/// The look that a model predicts for a painting.
pub(crate) fn predicted(model: &Model, painting: &RgbImage) -> Result<StyledAppearance, EvalError> {
    let inspiration = model.embedding(painting)?;
    model.appearance(&inspiration).ok_or(EvalError::Unstyled)
}

/// Views of cameras with every look, look by look, with `supersampling²` rays a pixel; geometry is
/// computed once. `tick` hears of every camera.
pub(crate) fn views(
    model: &Model,
    supersampling: u32,
    cameras: &[Camera],
    looks: &[&StyledAppearance],
    tick: &mut dyn FnMut(),
) -> Vec<Vec<RgbImage>> {
    let mut views = vec![Vec::with_capacity(cameras.len()); looks.len()];
    for camera in cameras {
        let view = model.render_smooth(camera, looks, supersampling);
        for (look, views) in views.iter_mut().enumerate() {
            views.push(view.image(look));
        }
        tick();
    }
    views
}

/// The same without a style.
pub(crate) fn unstylised(
    model: &Model,
    supersampling: u32,
    cameras: &[Camera],
    tick: &mut dyn FnMut(),
) -> Vec<RgbImage> {
    let looks = [&model.photo_appearance()];
    views(model, supersampling, cameras, &looks, tick).remove(0)
}
