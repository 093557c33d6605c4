//! A whole evaluation: every method measured by its fidelity and by its consistency, each of which
//! is worth nothing without the other.

use crate::error::EvalError;
use crate::evaluator::Evaluator;
use crate::fidelity::FidelityMetric;
use crate::methods::{Stylizer, UNAVAILABLE};
use crate::names::{OURS, REFINED};
use crate::record::{ImageRecord, RecordPlan};
use crate::render::{GROUP, held_out, predicted, unstylised};
use crate::results::{Evaluation, compare_with_photo};
use crate::strokes::StrokeMetric;
use crate::training::{HOW, Reconstruct, reconstructed, refined, training_views};
use crate::trajectory::Trajectory;
use image::RgbImage;
use impasto_model::{Budget, Model};
use impasto_scene::Camera;
use impasto_style::Perceptual;
use std::collections::BTreeMap;

/// What to evaluate on.
#[derive(Clone, Copy)]
pub struct EvalOptions<'a> {
    /// Paintings with their names, best ones that the model has not seen.
    pub paintings: &'a [(String, RgbImage)],
    /// Cameras of a path for consistency, in scene space, of one size; none to leave it out.
    pub path: &'a [Camera],
    /// Rays along each side of a rendered pixel, see [`Model::render_smooth`].
    pub supersampling: u32,
    /// Two-dimensional methods to compare with, each also as a video.
    pub against: &'a [&'a dyn Stylizer],
    /// Pictures to keep for a report; none to save their memory.
    pub record: Option<RecordPlan>,
    /// How long to refine the model's looks for each painting, as a method of its own, see
    /// [`impasto_train::Refinement`]; `None` to leave it out.
    pub refine: Option<Budget>,
    /// Whether and how to reconstruct the place from what those methods make of its photos too.
    pub reconstruct: Option<Reconstruct>,
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
    let (paintings, path) = (options.paintings, options.path);
    let supersampling = options.supersampling;
    let cameras = held_out(model);
    if cameras.is_empty() || paintings.is_empty() {
        return Err(EvalError::Nothing);
    }
    let vgg = Perceptual::vgg16()?;
    let views = unstylised(model, supersampling, &cameras, tick);
    let mut evaluator = Evaluator {
        model,
        fidelity: FidelityMetric::new(&vgg, paintings, &views)?,
        strokes: StrokeMetric::new(&vgg, paintings, &views, tick)?,
        trajectory: Trajectory::new(model, supersampling, path, tick),
        paintings,
        cameras: &cameras,
        views: &views,
        path,
        supersampling,
        record: options.record.map(|plan| ImageRecord::new(plan, paintings)),
        tick,
    };
    let mut methods = BTreeMap::from([evaluator.photo()?]);
    let mut look = |painting: &RgbImage| predicted(model, painting);
    methods.extend([evaluator.looks(OURS, &mut look)?]);
    if let Some(budget) = options.refine {
        methods.extend([evaluator.looks(REFINED, &mut refined(model, budget)?)?]);
    }
    let third = options.reconstruct.filter(|_| !options.against.is_empty());
    let third = third.map(|how| (how, training_views(model, supersampling)));
    for stylizer in options.against {
        methods.extend(evaluator.stylizer(*stylizer)?);
        if let Some((how, photos)) = &third {
            let place = reconstructed(&mut evaluator, *stylizer, photos, *how)?;
            methods.extend([place]);
        }
    }
    compare_with_photo(&mut methods);
    Ok(Evaluation {
        methods,
        unavailable: UNAVAILABLE.into_iter().collect(),
        depth_error: evaluator.trajectory.depth_error,
        reconstructed: third.is_some().then_some(HOW),
        flow: "exact, from rendered depth and poses",
        frames: path.len(),
        record: evaluator.record,
    })
}

impl EvalOptions<'_> {
    /// Pictures that [`evaluate`] makes one by one, of held-out views and of the path: renders,
    /// unstylised and then once for every group of paintings (twice with refined looks), what each
    /// compared method makes of them with each painting, and renders of every reconstruction;
    /// with the pairs of a painting and a view that are looked at for strokes.
    pub fn pictures(&self, model: &Model) -> usize {
        let kinds = 1 + usize::from(self.refine.is_some());
        let rendered = 1 + kinds * self.paintings.len().div_ceil(GROUP);
        let painted = self.against.len() * self.paintings.len();
        let again = self.reconstruct.map_or(0, |how| {
            self.against.len() * how.paintings.min(self.paintings.len())
        });
        let views = held_out(model).len();
        let pairs = StrokeMetric::pairs(self.paintings.len(), views);
        (views + self.path.len()) * (rendered + painted + again) + pairs
    }
}
