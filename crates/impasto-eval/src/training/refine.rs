//! Looks that go on learning from their painting.

use crate::error::EvalError;
use image::RgbImage;
use impasto_model::{Budget, Model, StyledAppearance};
use impasto_train::Refinement;

/// What makes a model's look for a painting, refined for so long.
pub(crate) fn refined(
    model: &Model,
    budget: Budget,
) -> Result<impl FnMut(&RgbImage) -> Result<StyledAppearance, EvalError>, EvalError> {
    let mut refinement = Refinement::new(model)?.ok_or(EvalError::NoTrainingViews)?;
    Ok(move |painting: &RgbImage| {
        let look = refinement.appearance(&[(painting, 1.0)], budget, &mut |_| {})?;
        look.ok_or(EvalError::Unstyled)
    })
}
