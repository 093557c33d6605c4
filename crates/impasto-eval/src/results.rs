//! Results of an evaluation, by method.

use crate::consistency::{ByRange, Consistency};
use crate::fidelity::{PaintingResult, StyleFidelity};
use crate::names::PHOTO;
use crate::record::ImageRecord;
use crate::strokes::StrokeResult;
use crate::trajectory::TrajectoryMetrics;
use serde::Serialize;
use std::collections::BTreeMap;

/// What a method came to, mean over paintings.
#[derive(Debug, Clone, Serialize)]
pub struct MethodResult {
    /// How like the paintings.
    #[serde(flatten)]
    pub fidelity: StyleFidelity,
    /// Whether there are strokes of the paintings' kind; `None` of unstylised renders.
    #[serde(flatten)]
    pub strokes: Option<StrokeResult>,
    /// Agreement of frames by exact flow; `None` without a path.
    #[serde(flatten)]
    pub consistency: Option<ByRange<Consistency>>,
    /// How much less the frames agree than the unstylised ones: the ratio of the two
    /// [`Consistency::relative`], so that contrast counts in neither. 1 for the photo; NaN (`null`
    /// in JSON) where one of them has none, or the unstylised frames agree perfectly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub over_photo: Option<ByRange<f64>>,
    /// Agreement by true depth, on the built-in scene only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub true_depth: Option<TrueDepth>,
    /// The same as papers without geometry measure it (Lai et al. 2018): by flow estimated from the
    /// unstylised frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_flow: Option<ByRange<Consistency>>,
    /// Gradient energy of the frames, relative to the unstylised ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
}

/// Consistency by the depth that the scene really has, instead of by the model's.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct TrueDepth {
    /// By true depth.
    #[serde(flatten)]
    pub consistency: ByRange<Consistency>,
    /// E × 100 by true depth less E × 100 by the model's.
    pub difference: ByRange<f64>,
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
    /// Median difference of rendered to true depth along the path, relative to the latter and where
    /// it is finite; on the built-in scene only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_error: Option<f64>,
    /// Frames of the path.
    pub frames: usize,
    /// Pictures for a report.
    #[serde(skip)]
    pub record: Option<ImageRecord>,
}

/// A method's name and results.
pub(crate) type NamedResult = (String, MethodResult);

/// Measures of one method and painting.
pub(crate) struct PaintingMetrics {
    /// Style and content of the views.
    pub(crate) fidelity: PaintingResult,
    /// `None` without a path.
    pub(crate) trajectory: Option<TrajectoryMetrics>,
}

impl MethodResult {
    /// Means of results by painting, over so many views.
    pub(crate) fn of(mut results: Vec<PaintingMetrics>, views: usize) -> Self {
        for PaintingMetrics {
            fidelity,
            trajectory,
        } in &mut results
        {
            fidelity.consistency = trajectory.map(|m| m.exact.into());
            fidelity.sharpness = trajectory.map(|m| m.sharpness);
        }
        let pairs = results.into_iter().map(|m| (m.fidelity, m.trajectory));
        let (paintings, metrics): (Vec<_>, Vec<_>) = pairs.unzip();
        let metrics: Vec<TrajectoryMetrics> = metrics.into_iter().flatten().collect();
        let exact = mean(metrics.iter().map(|m| m.exact));
        let true_depth = mean(metrics.iter().filter_map(|m| m.true_depth));
        let true_depth = true_depth.zip(exact).map(|(consistency, exact)| TrueDepth {
            difference: consistency.with(&exact, |by_truth, exact| by_truth.e100 - exact.e100),
            consistency,
        });
        let sharpness = metrics.iter().map(|m| m.sharpness).sum::<f64>() / metrics.len() as f64;
        Self {
            fidelity: StyleFidelity::of(paintings, views),
            strokes: None,
            consistency: exact,
            over_photo: None,
            true_depth,
            estimated_flow: mean(metrics.iter().map(|m| m.estimated)),
            sharpness: (!metrics.is_empty()).then_some(sharpness),
        }
    }
}

impl MethodResult {
    /// The same with what was found of strokes: of all paintings, then painting by painting.
    pub(crate) fn with_strokes(mut self, found: &(StrokeResult, Vec<StrokeResult>)) -> Self {
        self.strokes = Some(found.0);
        let paintings = self.fidelity.paintings.iter_mut();
        for (painting, found) in paintings.zip(&found.1) {
            painting.strokes = Some(*found);
        }
        self
    }
}

/// At each range, the mean over paintings; `None` over none.
fn mean(all: impl Iterator<Item = [Consistency; 2]>) -> Option<ByRange<Consistency>> {
    let (short, long): (Vec<_>, Vec<_>) = all.map(<(_, _)>::from).unzip();
    let [short, long] = [short, long].map(|all| Consistency::mean(&all));
    Some([short?, long?].into())
}

/// Sets every method's [`MethodResult::over_photo`].
pub(crate) fn compare_with_photo(methods: &mut BTreeMap<String, MethodResult>) {
    let photo = methods.get(PHOTO).and_then(|photo| photo.consistency);
    let Some(floor) = photo else { return };
    let ratio = |found: &Consistency, floor: &Consistency| {
        let ratio = found.relative / floor.relative;
        if ratio.is_finite() { ratio } else { f64::NAN }
    };
    for result in methods.values_mut() {
        result.over_photo = result.consistency.map(|found| found.with(&floor, ratio));
    }
}
