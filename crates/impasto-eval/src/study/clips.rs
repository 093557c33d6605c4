//! Films of the same walk by every method.

use super::StudyError;
use super::plan::Plan;
use crate::EvalError;
use crate::bench::GROUP;
use crate::consistency::RANGES;
use crate::evaluate::{OURS, PHOTO};
use crate::methods::Stylizer;
use crate::page::data_url;
use crate::walk::{by_estimate, video, views};
use image::RgbImage;
use impasto_train::{Look, Model};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// JPEG quality of every clip: the same for all methods.
pub(super) const QUALITY: u8 = 75;

/// Whose clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Shown {
    /// Impasto's.
    Ours,
    /// The unstylised render.
    Photo,
    /// That method's, frame by frame.
    Frames(usize),
    /// That method's, as a video.
    Video(usize),
}

impl Shown {
    /// Its name in the key.
    pub(super) fn name(self, against: &[&dyn Stylizer]) -> String {
        match self {
            Self::Ours => OURS.to_owned(),
            Self::Photo => PHOTO.to_owned(),
            Self::Frames(method) => against[method].name().to_owned(),
            Self::Video(method) => against[method].video_name(),
        }
    }

    /// The compared method's index.
    pub(super) fn method(self) -> Option<usize> {
        match self {
            Self::Ours | Self::Photo => None,
            Self::Frames(method) | Self::Video(method) => Some(method),
        }
    }
}

/// Frames as addresses that hold them, by painting and method.
pub(super) type Clips = BTreeMap<(usize, Shown), Vec<String>>;

/// Every clip that a plan needs. `tick` hears of every frame.
pub(super) fn film(
    model: &Model,
    plan: &Plan<'_>,
    tick: &mut dyn FnMut(),
) -> Result<Clips, StudyError> {
    let unstyled = views((model, 1), &plan.path, &[&model.photo_look()], tick).remove(0);
    let neighbours = by_estimate(&unstyled, RANGES[0]);
    let mut clips = ours(model, plan, tick)?;
    for (painting, method) in plan.stylised() {
        let brush = plan.options.against[method].brush(&plan.options.paintings[painting].1);
        let frames: Vec<RgbImage> = unstyled.par_iter().map(&brush).collect();
        clips.insert(
            (painting, Shown::Video(method)),
            encoded(&video(&frames, &neighbours))?,
        );
        clips.insert((painting, Shown::Frames(method)), encoded(&frames)?);
        (0..frames.len()).for_each(|_| tick());
    }
    let photo = encoded(&unstyled)?;
    let caught = plan
        .trials
        .iter()
        .filter(|t| t.sides.contains(&Shown::Photo));
    clips.extend(caught.map(|trial| ((trial.painting, Shown::Photo), photo.clone())));
    Ok(clips)
}

fn ours(model: &Model, plan: &Plan<'_>, tick: &mut dyn FnMut()) -> Result<Clips, StudyError> {
    let mut clips = Clips::new();
    let paintings: Vec<usize> = plan.paintings().into_iter().collect();
    for group in paintings.chunks(GROUP) {
        let looks = group.iter().map(|painting| {
            let inspiration = model
                .inspiration(&plan.options.paintings[*painting].1)
                .map_err(EvalError::from)?;
            model.look(&inspiration).ok_or(EvalError::Unstyled)
        });
        let looks: Vec<Look> = looks.collect::<Result<_, _>>()?;
        let looks: Vec<&Look> = looks.iter().collect();
        let films = views((model, 1), &plan.path, &looks, tick);
        for (painting, frames) in group.iter().zip(films) {
            clips.insert((*painting, Shown::Ours), encoded(&frames)?);
        }
    }
    Ok(clips)
}

fn encoded(frames: &[RgbImage]) -> Result<Vec<String>, StudyError> {
    let urls = frames.par_iter().map(|frame| data_url(frame, QUALITY));
    Ok(urls.collect::<Result<_, _>>()?)
}
