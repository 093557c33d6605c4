//! A whole evaluation: every method judged by its fidelity and by its consistency, each of which is
//! worth nothing without the other.

use crate::consistency::{Consistency, Pairs};
use crate::fidelity::{Judge, StyleFidelity};
use crate::methods::{Stylizer, UNAVAILABLE};
use crate::sharpness::gradient_energy;
use crate::walk::{Walk, walk};
use image::RgbImage;
use impasto_scene::{Camera, Split};
use impasto_style::{Perceptual, StyleError};
use impasto_train::{Look, Model};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// The stylised field's name among the methods.
const OURS: &str = "impasto";
/// The unstylised render's: the floor of every consistency.
const PHOTO: &str = "photo";

/// What to evaluate on.
#[derive(Clone, Copy)]
pub struct EvalOptions<'a> {
    /// Paintings with their names, best ones that the model has not seen.
    pub paintings: &'a [(String, RgbImage)],
    /// Cameras of a walk for consistency, in scene space, of one size; none to leave it out.
    pub path: &'a [Camera],
    /// Two-dimensional methods to compare with, each also as a video.
    pub against: &'a [&'a dyn Stylizer],
}

/// What a method came to, mean over paintings.
#[derive(Debug, Clone, Serialize)]
pub struct MethodResult {
    /// How like the paintings.
    #[serde(flatten)]
    pub fidelity: StyleFidelity,
    /// Agreement of neighbouring frames, by exact flow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub short: Option<Consistency>,
    /// Agreement of frames seven apart.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub long: Option<Consistency>,
    /// The same as papers without geometry measure it (Lai et al. 2018): by flow estimated from the
    /// unstylised frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_flow: Option<Legacy>,
    /// Gradient energy of the walk's frames, relative to the unstylised ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
}

/// Consistency by estimated flow.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Legacy {
    /// Neighbouring frames.
    pub short: Consistency,
    /// Frames seven apart.
    pub long: Consistency,
}

/// Results by method.
#[derive(Debug, Clone, Serialize)]
pub struct Evaluation {
    /// Every method.
    pub methods: BTreeMap<String, MethodResult>,
    /// Methods of the paper's tables that cannot be compared, and why.
    pub unavailable: BTreeMap<&'static str, &'static str>,
    /// Where flow comes from.
    pub flow: &'static str,
    /// Frames of the walk.
    pub frames: usize,
}

/// Why an evaluation is impossible.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// The model has had no style stage.
    #[error("this model has had no style stage: train it with --stage style first")]
    Unstyled,
    /// There is no view or no painting to compare.
    #[error("there is nothing to evaluate: no held-out view or no painting")]
    Nothing,
    /// A picture or an asset is unusable.
    #[error(transparent)]
    Style(#[from] StyleError),
}

/// Measures how well a model paints its held-out views (or all, if none is held out) with the
/// given paintings, and how well frames along a path agree. `tick` hears of rendered frames.
///
/// # Errors
/// If the model has no style stage, or there is nothing to compare.
pub fn evaluate(
    model: &Model,
    options: &EvalOptions<'_>,
    tick: &mut dyn FnMut(usize),
) -> Result<Evaluation, EvalError> {
    let paintings = options.paintings;
    let cameras = held_out(model);
    if cameras.is_empty() || paintings.is_empty() {
        return Err(EvalError::Nothing);
    }
    let vgg = Perceptual::vgg16()?;
    let mut looks = vec![model.photo_look()];
    for (_, painting) in paintings {
        let inspiration = model.inspiration(painting)?;
        looks.push(model.look(&inspiration).ok_or(EvalError::Unstyled)?);
    }
    let looks: Vec<&Look> = looks.iter().collect();
    let mut views = vec![Vec::with_capacity(cameras.len()); looks.len()];
    for camera in &cameras {
        let view = model.render(camera, &looks);
        for (look, views) in views.iter_mut().enumerate() {
            views.push(view.image(look));
        }
    }
    let plain = views.remove(0);
    let judge = Judge::new(&vgg, paintings, &plain)?;
    let fidelity = judge.judge(&views)?;
    let unstyled = judge.judge(&vec![plain.clone(); paintings.len()])?;
    let (walk, mut frames) = walk(model, options.path, &looks, tick);
    let plain_walk = vec![frames.remove(0)];
    let mut methods = BTreeMap::new();
    for (name, fidelity, frames) in [(OURS, fidelity, &frames), (PHOTO, unstyled, &plain_walk)] {
        let result = method(&vgg, &walk, fidelity, (frames, &plain_walk[0]))?;
        methods.insert(name.to_owned(), result);
    }
    for stylizer in options.against {
        let painted = |frames: &[RgbImage]| repaint(*stylizer, paintings, frames);
        let fidelity = judge.judge(&painted(&plain))?;
        let frames = painted(&plain_walk[0]);
        let videos: Vec<_> = frames.iter().map(|f| walk.video(f)).collect();
        let name = stylizer.name();
        let result = method(&vgg, &walk, fidelity.clone(), (&frames, &plain_walk[0]))?;
        methods.insert(name.to_owned(), result);
        // A first frame is a single picture: as a video, the views are painted alike.
        let result = method(&vgg, &walk, fidelity, (&videos, &plain_walk[0]))?;
        methods.insert(format!("{name}_temporal"), result);
    }
    Ok(Evaluation {
        methods,
        unavailable: UNAVAILABLE.into_iter().collect(),
        flow: "exact, from rendered depth and poses",
        frames: options.path.len(),
    })
}

/// Frames in the style of every painting.
fn repaint(
    stylizer: &dyn Stylizer,
    paintings: &[(String, RgbImage)],
    frames: &[RgbImage],
) -> Vec<Vec<RgbImage>> {
    let painted = paintings.iter().map(|(_, painting)| {
        let brush = stylizer.brush(painting);
        frames.par_iter().map(&brush).collect()
    });
    painted.collect()
}

/// Cameras of the held-out photos, or of all if there are none.
fn held_out(model: &Model) -> Vec<Camera> {
    let photos = &model.file.scene.photos;
    let test: Vec<Camera> = photos
        .iter()
        .filter(|photo| photo.split == Split::Test)
        .map(|photo| photo.camera)
        .collect();
    match test.is_empty() {
        true => photos.iter().map(|photo| photo.camera).collect(),
        false => test,
    }
}

/// What a method's frames, painting by painting, come to beside the unstylised ones.
fn method(
    vgg: &Perceptual,
    walk: &Walk,
    fidelity: StyleFidelity,
    (frames, plain): (&[Vec<RgbImage>], &[RgbImage]),
) -> Result<MethodResult, EvalError> {
    if plain.is_empty() {
        return Ok(MethodResult {
            fidelity,
            short: None,
            long: None,
            estimated_flow: None,
            sharpness: None,
        });
    }
    let over = |pairs: &Pairs, vgg: Option<&Perceptual>| {
        let results = frames
            .iter()
            .map(|frames| pairs.consistency(frames, vgg))
            .collect::<Result<Vec<_>, StyleError>>()?;
        Ok::<_, StyleError>(Consistency::mean(&results))
    };
    let energy = |frames: &[RgbImage]| frames.iter().map(gradient_energy).sum::<f64>();
    let painted: f64 = frames.iter().map(|frames| energy(frames)).sum();
    let floor = energy(plain) * frames.len() as f64;
    Ok(MethodResult {
        fidelity,
        short: Some(over(&walk.exact[0], Some(vgg))?),
        long: Some(over(&walk.exact[1], Some(vgg))?),
        estimated_flow: Some(Legacy {
            short: over(&walk.estimated[0], None)?,
            long: over(&walk.estimated[1], None)?,
        }),
        sharpness: Some(painted / floor.max(f64::MIN_POSITIVE)),
    })
}
