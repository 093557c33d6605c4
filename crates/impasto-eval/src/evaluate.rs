//! A whole evaluation: every method judged by its fidelity and by its consistency, each of which is
//! worth nothing without the other.

use crate::bench::{Bench, GROUP};
use crate::consistency::{ByRange, Consistency};
use crate::fidelity::{Judge, PaintingResult, StyleFidelity};
use crate::gallery::{Gallery, GalleryPlan};
use crate::methods::{Stylizer, UNAVAILABLE};
use crate::reconstruct::{HOW, Reconstruct, photos, reconstructed};
use crate::walk::{Walk, Walked, views};
use image::RgbImage;
use impasto_scene::{Camera, Split};
use impasto_style::{Perceptual, StyleError};
use impasto_train::{Budget, Model, Refinement};
use serde::Serialize;
use std::collections::BTreeMap;

/// The stylised field's name among the methods.
pub(crate) const OURS: &str = "impasto";
/// The same with looks that have gone on learning from their painting.
pub(crate) const REFINED: &str = "impasto_refined";
/// The unstylised render's name among the methods: the floor of every consistency.
pub const PHOTO: &str = "photo";

/// What to evaluate on.
#[derive(Clone, Copy)]
pub struct EvalOptions<'a> {
    /// Paintings with their names, best ones that the model has not seen.
    pub paintings: &'a [(String, RgbImage)],
    /// Cameras of a walk for consistency, in scene space, of one size; none to leave it out.
    pub path: &'a [Camera],
    /// Rays along each side of a rendered pixel, see [`Model::render_smooth`].
    pub supersampling: u32,
    /// Two-dimensional methods to compare with, each also as a video.
    pub against: &'a [&'a dyn Stylizer],
    /// Pictures to keep for a report; none to save their memory.
    pub gallery: Option<GalleryPlan>,
    /// How long to refine the model's looks for each painting, as a method of its own, see
    /// [`Refinement`]; `None` to leave it out.
    pub refine: Option<Budget>,
    /// Whether and how to reconstruct the place from what those methods make of its photos too.
    pub reconstruct: Option<Reconstruct>,
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
    /// How much less the frames agree than the unstylised ones: the ratio of the two
    /// [`Consistency::relative`], so that contrast counts in neither. 1 for the photo; NaN (`null`
    /// in JSON) where one of them has none, or the unstylised frames agree perfectly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub over_photo: Option<ByRange>,
    /// Agreement by true depth, on the built-in scene only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub true_depth: Option<TrueDepth>,
    /// The same as papers without geometry measure it (Lai et al. 2018): by flow estimated from the
    /// unstylised frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_flow: Option<Legacy>,
    /// Gradient energy of the walk's frames, relative to the unstylised ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
}

/// Consistency by the depth that the scene really has, instead of by the model's.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct TrueDepth {
    /// Neighbouring frames.
    pub short: Consistency,
    /// Frames seven apart.
    pub long: Consistency,
    /// E × 100 by true depth less E × 100 by the model's.
    pub difference: ByRange,
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
    /// What the methods named `…_reconstructed` were reconstructed from, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reconstructed: Option<&'static str>,
    /// Median difference of rendered to true depth along the walk, relative to the latter and where
    /// it is finite; on the built-in scene only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_error: Option<f64>,
    /// Frames of the walk.
    pub frames: usize,
    /// What was kept to be looked at.
    #[serde(skip)]
    pub gallery: Option<Gallery>,
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
    /// Neither the place nor a look can go on learning.
    #[error("this model knows no training views to learn from: train it again")]
    NoTrainingViews,
    /// A picture or an asset is unusable.
    #[error(transparent)]
    Style(#[from] StyleError),
}

/// Measures how well a model paints its held-out views (or all, if none is held out) with the
/// given paintings, and how well frames along a path agree; and the same of other methods on the
/// unstylised renders. `tick` hears of every picture, see [`EvalOptions::pictures`].
///
/// # Errors
/// If the model has no style stage, or there is nothing to compare or to reconstruct from.
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
    let plain = views(
        (model, options.supersampling),
        &cameras,
        &[&model.photo_look()],
        tick,
    )
    .remove(0);
    let mut bench = Bench {
        judge: Judge::new(&vgg, paintings, &plain)?,
        walk: Walk::new((model, options.supersampling), path, tick),
        vgg: &vgg,
        plain: &plain,
        gallery: options.gallery.map(|plan| Gallery::new(plan, paintings)),
    };
    let mut methods = BTreeMap::from([(PHOTO.to_owned(), bench.photo(paintings.len())?)]);
    for (name, result) in ours(&mut bench, model, (&cameras, options), tick)? {
        methods.insert(name.to_owned(), result);
    }
    let third = options.reconstruct.filter(|_| !options.against.is_empty());
    let third = third.map(|how| (how, photos((model, options.supersampling))));
    for stylizer in options.against {
        let names = [stylizer.name().to_owned(), stylizer.video_name()];
        let results = bench.other(*stylizer, names.each_ref(), (paintings, tick))?;
        methods.extend(names.into_iter().zip(results));
        if let Some((how, photos)) = &third {
            let task = (*stylizer, *how);
            let (name, found) =
                reconstructed(&mut bench, (model, photos), task, (&cameras, options), tick)?;
            methods.insert(name, found);
        }
    }
    compare_with_photo(&mut methods);
    Ok(Evaluation {
        methods,
        unavailable: UNAVAILABLE.into_iter().collect(),
        depth_error: bench.walk.depth_error,
        reconstructed: third.is_some().then_some(HOW),
        flow: "exact, from rendered depth and poses",
        frames: path.len(),
        gallery: bench.gallery,
    })
}

/// The model's looks as they are predicted and, where that is wanted, refined.
fn ours(
    bench: &mut Bench<'_>,
    model: &Model,
    (cameras, options): (&[Camera], &EvalOptions<'_>),
    tick: &mut dyn FnMut(),
) -> Result<Vec<(&'static str, MethodResult)>, EvalError> {
    let mut predicted = |painting: &RgbImage| {
        let inspiration = model.inspiration(painting)?;
        model.look(&inspiration).ok_or(EvalError::Unstyled)
    };
    let looks = (OURS, &mut predicted as _);
    let mut results = vec![(OURS, bench.ours(model, looks, (cameras, options), tick)?)];
    if let Some(budget) = options.refine {
        let mut refinement = Refinement::new(model)?.ok_or(EvalError::NoTrainingViews)?;
        let mut refined = |painting: &RgbImage| {
            let look = refinement.look(&[(painting, 1.0)], budget, &mut |_| {})?;
            look.ok_or(EvalError::Unstyled)
        };
        let looks = (REFINED, &mut refined as _);
        results.push((REFINED, bench.ours(model, looks, (cameras, options), tick)?));
    }
    Ok(results)
}

/// Sets every method's [`MethodResult::over_photo`].
fn compare_with_photo(methods: &mut BTreeMap<String, MethodResult>) {
    let floor = methods
        .get(PHOTO)
        .and_then(|photo| photo.short.zip(photo.long));
    let Some((short, long)) = floor else { return };
    let ratio = |found: Consistency, floor: Consistency| {
        let ratio = found.relative / floor.relative;
        if ratio.is_finite() { ratio } else { f64::NAN }
    };
    for result in methods.values_mut() {
        let found = result.short.zip(result.long);
        result.over_photo = found.map(|found| ByRange {
            short: ratio(found.0, short),
            long: ratio(found.1, long),
        });
    }
}

impl EvalOptions<'_> {
    /// Pictures that [`evaluate`] makes one by one, of held-out views and of the walk: renders,
    /// unstylised and then once for every group of paintings (twice with refined looks), what each
    /// compared method makes of them with each painting, and renders of every reconstruction.
    pub fn pictures(&self, model: &Model) -> usize {
        let kinds = 1 + usize::from(self.refine.is_some());
        let rendered = 1 + kinds * self.paintings.len().div_ceil(GROUP);
        let painted = self.against.len() * self.paintings.len();
        let again = self.reconstruct.map_or(0, |how| {
            self.against.len() * how.paintings.min(self.paintings.len())
        });
        (held_out(model).len() + self.path.len()) * (rendered + painted + again)
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

impl TrueDepth {
    /// From what true depth says, and what the model's does.
    fn new(([short, long], exact): ([Consistency; 2], [Consistency; 2])) -> Self {
        Self {
            difference: ByRange {
                short: short.e100 - exact[0].e100,
                long: long.e100 - exact[1].e100,
            },
            short,
            long,
        }
    }
}

impl MethodResult {
    /// Means of results by painting, over these views.
    pub(crate) fn of(
        mut results: Vec<(PaintingResult, Option<Walked>)>,
        views: &[RgbImage],
    ) -> Self {
        for (painting, walked) in &mut results {
            [painting.short, painting.long] = [0, 1].map(|i| walked.map(|w| w.exact[i]));
            painting.sharpness = walked.map(|w| w.sharpness);
        }
        let (paintings, walks): (Vec<_>, Vec<_>) = results.into_iter().unzip();
        let walks: Vec<Walked> = walks.into_iter().flatten().collect();
        let mean = |of: fn(&Walked) -> Consistency| {
            Consistency::mean(&walks.iter().map(of).collect::<Vec<_>>())
        };
        let some = !walks.is_empty();
        let exact = some.then(|| [mean(|w| w.exact[0]), mean(|w| w.exact[1])]);
        let truth = walks.iter().filter_map(|w| w.truth);
        let truth: [Vec<_>; 2] = truth.map(|[short, long]| (short, long)).unzip().into();
        let truth = (!truth[0].is_empty()).then(|| truth.map(|t| Consistency::mean(&t)));
        let sharpness = walks.iter().map(|w| w.sharpness).sum::<f64>() / walks.len().max(1) as f64;
        Self {
            fidelity: StyleFidelity::of(paintings, views.len()),
            short: exact.map(|[short, _]| short),
            long: exact.map(|[_, long]| long),
            true_depth: truth.zip(exact).map(TrueDepth::new),
            over_photo: None,
            estimated_flow: some.then(|| Legacy {
                short: mean(|w| w.estimated[0]),
                long: mean(|w| w.estimated[1]),
            }),
            sharpness: some.then_some(sharpness),
        }
    }
}
