//! What is wrong with single photos, and what to do about it.
//!
//! Thresholds were set on five real captures (265 photos, from the sharpest to a hand-held video)
//! so that what a person sees to be wrong is named and nothing else.

use std::collections::HashMap;

use serde::Serialize;

use super::compare::Comparison;
use super::facts::PhotoFacts;
use super::layout::{CameraLayout, CapturePattern, off_axis};
use super::quality::PhotoQuality;
use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::scene::{Photo, Scene};
use crate::statistics::{median, quantile};

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProblemKind {
    /// Much less detail than its neighbours.
    Blur,
    /// Much brighter or darker than its neighbours.
    Exposure,
    /// One colour all over.
    Blank,
    /// The same pixels as another photo.
    Copy,
    /// Hardly anything in common with any other photo.
    Overlap,
    /// Looks elsewhere than all others.
    Direction,
    /// Stands far from all others.
    Distance,
    /// Sparse points are not where the camera says.
    Pose,
}

/// Something wrong with a photo.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Problem {
    /// The photo's name.
    pub photo: String,
    /// What kind of problem it is.
    pub kind: ProblemKind,
    /// The problem, in words that follow the photo's name.
    pub problem: String,
    /// What to do.
    pub advice: String,
    /// How bad it is: 1 is just worth a word.
    pub severity: f64,
}

/// Detail, beside that of neighbours, below which a photo is blurred, where the same points were
/// compared: a logarithm, so that less than half is left. Sharp photos differ by 0.5 at most.
const BLURRED_AT_POINTS: f64 = -0.75;
/// The same where whole photos were compared, which differ in what they show, too: detail must be
/// low, and fine detail low beside coarse (sharp photos differ by 0.15 in that).
const BLURRED: f64 = -0.5;
const BLURRED_SLOPE: f64 = -0.15;
/// Blur so strong that noise is all the fine detail there is, and says nothing of the slope.
const SMEARED: f64 = -1.6;
/// Stops: automatic exposure around a building varies by 0.9 between photos of the same wall.
const STOPS_AT_POINTS: f64 = 1.0;
/// The same where whole photos were compared, which differ by 0.7 in what they show.
const STOPS: f64 = 1.2;
/// Luma, of 255, between the darkest and the brightest of a photo that shows something.
const LEAST_CONTRAST: f64 = 10.0;
/// Points in common with a second neighbour that hold a photo in place; good ones have hundreds.
const LEAST_SHARED: usize = 20;
/// Share of a view that a second neighbour must show where there are no points.
const LEAST_OVERLAP: f64 = 0.25;
/// Degrees from what nearly all others look at: half again the widest ordinary lens.
const TURNED: f64 = 60.0;
/// Share of the cameras that must look at one place for others to look elsewhere.
const CONVERGED: f64 = 0.8;
/// Times as far out as three quarters of the cameras.
const FAR_OUT: f64 = 4.0;
/// Times the other photos' median error, and share of the image's longer side, that a photo's own
/// error must exceed: 1.5 pixels of 1000.
const ERROR_TIMES: f64 = 3.0;
const ERROR_SHARE: f64 = 0.0015;

/// Everything measured, for the judges.
pub(super) struct Measurements<'a> {
    pub(super) scene: &'a Scene,
    pub(super) cameras: &'a [Camera],
    pub(super) geometry: &'a CameraGeometry,
    pub(super) layout: &'a CameraLayout,
    pub(super) facts: &'a [PhotoFacts],
    pub(super) compared: &'a [Option<Comparison>],
    pub(super) qualities: &'a [PhotoQuality],
}

/// All problems, the worst first.
pub(super) fn find(measured: &Measurements<'_>) -> Vec<Problem> {
    let mut all = copies(&measured.scene.photos);
    let usual_error = median(measured.facts.iter().filter_map(|f| f.reprojection_error));
    let middle = measured.geometry.middle;
    let reach = |camera: &Camera| camera.centre().distance(middle);
    let usual_reach = quantile(measured.cameras.iter().map(reach), 0.75).unwrap_or(0.0);
    for (index, facts) in measured.facts.iter().enumerate() {
        let camera = &measured.cameras[index];
        let size = measured.scene.photos[index].pixels.dimensions();
        let compared = measured.compared[index];
        let found = match blank(&measured.qualities[index]) {
            // A blank photo is unlike its neighbours in every way: once is enough.
            Some(blank) => vec![blank],
            None => [
                compared.and_then(blurred),
                compared.and_then(exposed),
                apart(reach(camera), usual_reach)
                    .or_else(|| turned(measured, camera))
                    .or_else(|| lonely(facts)),
                usual_error.and_then(|usual| misplaced(facts, size, usual)),
            ]
            .into_iter()
            .flatten()
            .collect(),
        };
        all.extend(found.into_iter().map(|problem| Problem {
            photo: facts.photo.clone(),
            ..problem
        }));
    }
    all.sort_by(|a, b| {
        let worse = b.severity.total_cmp(&a.severity);
        worse.then(a.photo.cmp(&b.photo))
    });
    all
}

impl ProblemKind {
    fn problem(self, severity: f64, problem: String, advice: &str) -> Problem {
        Problem {
            photo: String::new(),
            kind: self,
            problem,
            advice: advice.to_owned(),
            severity,
        }
    }
}

fn blank(quality: &PhotoQuality) -> Option<Problem> {
    (quality.contrast < LEAST_CONTRAST).then(|| {
        let problem = "shows next to nothing: nearly all of it has one brightness";
        ProblemKind::Blank.problem(3.0, problem.into(), "leave it out")
    })
}

fn blurred(compared: Comparison) -> Option<Problem> {
    let detail = compared.detail;
    let least = if compared.at_points {
        BLURRED_AT_POINTS
    } else {
        BLURRED
    };
    let slope = compared.at_points || compared.slope < BLURRED_SLOPE || detail < SMEARED;
    if detail >= least || !slope {
        return None;
    }
    let much = if detail < 2.0 * least { "much " } else { "" };
    let problem = format!(
        "is {much}blurrier than its neighbours ({:.0} % of their fine detail)",
        100.0 * detail.exp()
    );
    let advice = "leave it out or retake it";
    Some(ProblemKind::Blur.problem(detail / least, problem, advice))
}

fn exposed(compared: Comparison) -> Option<Problem> {
    let most = if compared.at_points {
        STOPS_AT_POINTS
    } else {
        STOPS
    };
    let stops = compared.stops;
    if stops.abs() <= most {
        return None;
    }
    let how = if stops > 0.0 { "brighter" } else { "darker" };
    let problem = format!("is {:.1} stops {how} than its neighbours", stops.abs());
    let advice = "even out its exposure in a photo editor, or retake it with the exposure locked";
    Some(ProblemKind::Exposure.problem(stops.abs() / most, problem, advice))
}

/// A photo that looks away from what nearly all others look at.
fn turned(measured: &Measurements<'_>, camera: &Camera) -> Option<Problem> {
    let pattern = measured.layout.walk;
    let one_place = matches!(
        pattern,
        CapturePattern::Around | CapturePattern::ForwardFacing
    );
    let angle = off_axis(camera, measured.geometry.target);
    if !one_place || measured.layout.convergence < CONVERGED || angle < TURNED {
        return None;
    }
    let problem = format!("looks {angle:.0}° away from what the other photos show");
    let advice = "check its pose and leave it out if that is wrong, else take more photos that way";
    Some(ProblemKind::Direction.problem(angle / TURNED, problem, advice))
}

/// A camera `reach` from the middle of all, of which three quarters are nearer than `usual`.
fn apart(reach: f64, usual: f64) -> Option<Problem> {
    if usual <= 0.0 || reach <= FAR_OUT * usual {
        return None;
    }
    let problem = format!(
        "stands {:.0} times as far out as the others, so that all else is squeezed together",
        reach / usual
    );
    let advice = "leave it out: its pose is likely wrong";
    Some(ProblemKind::Distance.problem(reach / usual / FAR_OUT, problem, advice))
}

fn lonely(facts: &PhotoFacts) -> Option<Problem> {
    let (problem, severity) = match facts.shared_points {
        Some(shared) if shared < LEAST_SHARED => (
            format!("has only {shared} points in common with its second-best neighbour"),
            LEAST_SHARED as f64 / (shared as f64 + 1.0),
        ),
        None if facts.overlap < LEAST_OVERLAP => (
            format!(
                "shows little that others show ({:.0} % with its second-best neighbour)",
                100.0 * facts.overlap
            ),
            LEAST_OVERLAP / (facts.overlap + 0.05),
        ),
        _ => return None,
    };
    let advice = "take more photos from near it, or leave it out";
    Some(ProblemKind::Overlap.problem(severity, problem, advice))
}

/// A camera whose points are farther from where it puts them than those of others, `usual` pixels.
fn misplaced(facts: &PhotoFacts, size: (u32, u32), usual: f64) -> Option<Problem> {
    let error = facts.reprojection_error.filter(|error| !error.is_nan())?;
    let most = (ERROR_TIMES * usual).max(ERROR_SHARE * f64::from(size.0.max(size.1)));
    if error <= most {
        return None;
    }
    let problem = if error.is_finite() {
        format!("sees its points {error:.1} pixels off (the others {usual:.1})")
    } else {
        "has most of its points behind its camera".to_owned()
    };
    let advice = "leave it out, or estimate the poses again: its pose or its lens is wrong";
    Some(ProblemKind::Pose.problem((error / most).min(1e3), problem, advice))
}

/// Photos whose pixels were already there under another name.
fn copies(photos: &[Photo]) -> Vec<Problem> {
    let mut first: HashMap<&[u8], &str> = HashMap::new();
    let mut all = Vec::new();
    for photo in photos {
        let pixels = photo.pixels.as_raw().as_slice();
        let Some(other) = first.get(pixels) else {
            first.insert(pixels, &photo.name);
            continue;
        };
        let problem = format!("has the same pixels as {other}");
        let advice = "leave one of the two out";
        all.push(Problem {
            photo: photo.name.clone(),
            ..ProblemKind::Copy.problem(1.5, problem, advice)
        });
    }
    all
}
