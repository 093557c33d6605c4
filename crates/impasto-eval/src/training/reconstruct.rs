//! The paper's third pipeline (PAPER §11): stylise the photos, then reconstruct the place from them.

use crate::error::EvalError;
use crate::evaluator::Evaluator;
use crate::methods::Stylizer;
use crate::names::RECONSTRUCTED;
use crate::render::unstylised;
use crate::results::NamedResult;
use image::RgbImage;
use impasto_model::{Budget, Model};
use impasto_scene::Split;
use impasto_train::refit;
use rayon::prelude::*;

/// How to reconstruct a place from stylised pictures of it.
#[derive(Debug, Clone, Copy)]
pub struct Reconstruct {
    /// Training for every method and painting.
    pub budget: Budget,
    /// Paintings that it is done with, the first ones.
    pub paintings: usize,
}

/// What was reconstructed from what, for reports.
pub(crate) const HOW: &str = "stylised renders of the training views (a model keeps no photos), \
                              learned from the model's own field on";

/// Unstylised renders of a model's training views, which stand for the photos that it does not
/// keep.
pub(crate) fn training_views(model: &Model, supersampling: u32) -> Vec<RgbImage> {
    let cameras = model.file.scene.cameras(Split::Train);
    unstylised(model, supersampling, &cameras, &mut || {})
}

/// A method's results when it paints the model's `photos` (see [`training_views`]) and the place is
/// learned from those: views and frames are renders of what came out. With them the name that they
/// go by.
pub(crate) fn reconstructed(
    evaluator: &mut Evaluator<'_>,
    stylizer: &dyn Stylizer,
    photos: &[RgbImage],
    how: Reconstruct,
) -> Result<NamedResult, EvalError> {
    let name = format!("{}{RECONSTRUCTED}", stylizer.name());
    let paintings = evaluator.paintings.iter().take(how.paintings);
    let mut strokes = Vec::new();
    let results = paintings.enumerate().map(|(i, (_, painting))| {
        let transfer = stylizer.transfer(painting);
        let painted = photos.par_iter().map(&transfer).collect();
        let place = refit(evaluator.model, painted, how.budget);
        let place = place.ok_or(EvalError::NoTrainingViews)?;
        let [views, frames] = evaluator.render(&place, &[&place.photo_appearance()]);
        strokes.push(evaluator.strokes.strokes(&views[0])?);
        Ok(evaluator.measure(&name, i, &views[0], &frames[0])?)
    });
    let results = results.collect::<Result<_, EvalError>>()?;
    Ok(evaluator.result(&name, results, &strokes))
}
