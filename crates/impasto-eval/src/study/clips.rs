//! Films along the same path by every method.

use super::StudyError;
use super::plan::{QUALITY, StudyPlan};
use super::trials::ClipKind;
use crate::consistency::RANGES;
use crate::error::EvalError;
use crate::html::data_url;
use crate::methods::temporal;
use crate::render::{GROUP, predicted, unstylised, views};
use crate::trajectory::by_estimate;
use image::RgbImage;
use impasto_model::{Model, StyledAppearance};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Frames as addresses that hold them, by painting and method.
pub(super) type Clips = BTreeMap<(usize, ClipKind), Vec<String>>;

/// Every clip that a plan needs. `tick` hears of every frame.
pub(super) fn film(
    model: &Model,
    plan: &StudyPlan<'_>,
    tick: &mut dyn FnMut(),
) -> Result<Clips, StudyError> {
    let unstyled = unstylised(model, 1, &plan.path, tick);
    let neighbours = by_estimate(&unstyled, RANGES[0]);
    let mut clips = ours(model, plan, tick)?;
    for (painting, method) in plan.stylised() {
        let transfer = plan.options.against[method].transfer(&plan.options.paintings[painting].1);
        let frames: Vec<RgbImage> = unstyled.par_iter().map(&transfer).collect();
        let video = encoded(&temporal(&frames, &neighbours))?;
        clips.insert((painting, ClipKind::Video(method)), video);
        clips.insert((painting, ClipKind::Frames(method)), encoded(&frames)?);
        (0..frames.len()).for_each(|_| tick());
    }
    let photo = encoded(&unstyled)?;
    let trials = plan.trials.iter();
    let caught = trials.filter(|trial| trial.sides.contains(&ClipKind::Photo));
    clips.extend(caught.map(|trial| ((trial.painting, ClipKind::Photo), photo.clone())));
    Ok(clips)
}

fn ours(model: &Model, plan: &StudyPlan<'_>, tick: &mut dyn FnMut()) -> Result<Clips, StudyError> {
    let mut clips = Clips::new();
    let paintings: Vec<usize> = plan.paintings().into_iter().collect();
    for group in paintings.chunks(GROUP) {
        let paintings = group.iter().map(|i| &plan.options.paintings[*i].1);
        let looks = paintings.map(|painting| predicted(model, painting));
        let looks: Vec<StyledAppearance> = looks.collect::<Result<_, EvalError>>()?;
        let looks: Vec<&StyledAppearance> = looks.iter().collect();
        let films = views(model, 1, &plan.path, &looks, tick);
        for (painting, frames) in group.iter().zip(films) {
            clips.insert((*painting, ClipKind::Ours), encoded(&frames)?);
        }
    }
    Ok(clips)
}

fn encoded(frames: &[RgbImage]) -> Result<Vec<String>, StudyError> {
    let urls = frames.par_iter().map(|frame| data_url(frame, QUALITY));
    Ok(urls.collect::<Result<_, _>>()?)
}
