//! A whole evaluation: every method judged by its fidelity and by its consistency, each of which is
//! worth nothing without the other.

use crate::consistency::Consistency;
use crate::fidelity::{Judge, PaintingResult, StyleFidelity};
use crate::methods::{Stylizer, UNAVAILABLE};
use crate::walk::{Walk, Walked, views};
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

/// Paintings rendered together: geometry is computed once for them, and their frames are all in
/// memory.
const GROUP: usize = 8;

/// Measures how well a model paints its held-out views (or all, if none is held out) with the
/// given paintings, and how well frames along a path agree; and the same of other methods on the
/// unstylised renders. `tick` hears of every frame rendered, see [`EvalOptions::frames`].
///
/// # Errors
/// If the model has no style stage, or there is nothing to compare.
pub fn evaluate(
    model: &Model,
    options: &EvalOptions<'_>,
    tick: &mut dyn FnMut(),
) -> Result<Evaluation, EvalError> {
    let EvalOptions {
        paintings, path, ..
    } = *options;
    let cameras = held_out(model);
    if cameras.is_empty() || paintings.is_empty() {
        return Err(EvalError::Nothing);
    }
    let vgg = Perceptual::vgg16()?;
    let plain = views(model, &cameras, &[&model.photo_look()], &mut || {}).remove(0);
    let bench = Bench {
        judge: Judge::new(&vgg, paintings, &plain)?,
        walk: Walk::new(model, path, tick),
        vgg: &vgg,
        plain: &plain,
    };
    let mut methods = BTreeMap::from([(PHOTO.to_owned(), bench.photo(paintings.len())?)]);
    let ours = bench.ours(model, (&cameras, options), tick)?;
    methods.insert(OURS.to_owned(), ours);
    for stylizer in options.against {
        let [pictures, video] = bench.other(*stylizer, paintings)?;
        let name = stylizer.name();
        methods.insert(name.to_owned(), pictures);
        methods.insert(format!("{name}_temporal"), video);
    }
    Ok(Evaluation {
        methods,
        unavailable: UNAVAILABLE.into_iter().collect(),
        flow: "exact, from rendered depth and poses",
        frames: path.len(),
    })
}

/// What all methods are measured with.
struct Bench<'a> {
    judge: Judge<'a>,
    walk: Walk,
    vgg: &'a Perceptual,
    /// The held-out views, unstylised.
    plain: &'a [RgbImage],
}

impl Bench<'_> {
    fn photo(&self, paintings: usize) -> Result<MethodResult, EvalError> {
        let walked = self.walk.measure(&self.walk.frames, self.vgg)?;
        let results = (0..paintings).map(|i| (self.judge.unstyled(i), walked));
        Ok(MethodResult::of(results.collect(), self.plain))
    }

    fn ours(
        &self,
        model: &Model,
        (cameras, options): (&[Camera], &EvalOptions<'_>),
        tick: &mut dyn FnMut(),
    ) -> Result<MethodResult, EvalError> {
        let mut results = Vec::with_capacity(options.paintings.len());
        for group in options.paintings.chunks(GROUP) {
            let looks = group.iter().map(|(_, painting)| {
                let inspiration = model.inspiration(painting)?;
                model.look(&inspiration).ok_or(EvalError::Unstyled)
            });
            let looks: Vec<Look> = looks.collect::<Result<_, _>>()?;
            let looks: Vec<&Look> = looks.iter().collect();
            let painted = views(model, cameras, &looks, &mut || {});
            let walked = views(model, options.path, &looks, tick);
            for (painted, walked) in painted.iter().zip(&walked) {
                let fidelity = self.judge.painting(results.len(), painted)?;
                results.push((fidelity, self.walk.measure(walked, self.vgg)?));
            }
        }
        Ok(MethodResult::of(results, self.plain))
    }

    /// Frame by frame, and as a video.
    fn other(
        &self,
        stylizer: &dyn Stylizer,
        paintings: &[(String, RgbImage)],
    ) -> Result<[MethodResult; 2], EvalError> {
        let (mut pictures, mut videos) = (Vec::new(), Vec::new());
        for (i, (_, painting)) in paintings.iter().enumerate() {
            let brush = stylizer.brush(painting);
            let paint = |frames: &[RgbImage]| frames.par_iter().map(&brush).collect::<Vec<_>>();
            let fidelity = self.judge.painting(i, &paint(self.plain))?;
            let frames = paint(&self.walk.frames);
            // A first frame is a single picture: as a video, the views are painted alike.
            let video = self.walk.measure(&self.walk.video(&frames), self.vgg)?;
            videos.push((fidelity.clone(), video));
            pictures.push((fidelity, self.walk.measure(&frames, self.vgg)?));
        }
        Ok([pictures, videos].map(|results| MethodResult::of(results, self.plain)))
    }
}

impl EvalOptions<'_> {
    /// Frames of the walk that [`evaluate`] renders, one by one: unstylised, then with every group
    /// of paintings.
    pub fn frames(&self) -> usize {
        self.path.len() * (1 + self.paintings.len().div_ceil(GROUP))
    }
}

/// Cameras of the held-out photos, or of all if there are none.
fn held_out(model: &Model) -> Vec<Camera> {
    let scene = &model.file.scene;
    let test = scene.cameras(Split::Test);
    match test.is_empty() {
        true => scene.photos.iter().map(|photo| photo.camera).collect(),
        false => test,
    }
}

impl MethodResult {
    /// Means of results by painting, over these views.
    fn of(results: Vec<(PaintingResult, Option<Walked>)>, views: &[RgbImage]) -> Self {
        let (paintings, walks): (Vec<_>, Vec<_>) = results.into_iter().unzip();
        let walks: Vec<Walked> = walks.into_iter().flatten().collect();
        let mean = |of: fn(&Walked) -> Consistency| {
            Consistency::mean(&walks.iter().map(of).collect::<Vec<_>>())
        };
        let some = !walks.is_empty();
        let sharpness = walks.iter().map(|w| w.sharpness).sum::<f64>() / walks.len().max(1) as f64;
        Self {
            fidelity: StyleFidelity::of(paintings, views.len()),
            short: some.then(|| mean(|w| w.exact[0])),
            long: some.then(|| mean(|w| w.exact[1])),
            estimated_flow: some.then(|| Legacy {
                short: mean(|w| w.estimated[0]),
                long: mean(|w| w.estimated[1]),
            }),
            sharpness: some.then_some(sharpness),
        }
    }
}
