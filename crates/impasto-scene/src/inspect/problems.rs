//! What is wrong with single photos, and what to do about it.
//!
//! Thresholds were set on five real captures (265 photos, from the sharpest to a hand-held video)
//! so that what a person sees to be wrong is named and nothing else.

use std::collections::HashMap;

use serde::Serialize;

use super::layout::off_axis;
use super::{Measured, PhotoFacts, Walk, median};

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

/// All problems, the worst first.
pub(super) fn found(measured: &Measured<'_>) -> Vec<Problem> {
    let mut all = copies(measured);
    let usual_error = median(measured.facts.iter().filter_map(|f| f.reprojection_error));
    let usual_reach = usual_reach(measured);
    for index in 0..measured.facts.len() {
        let blank = blank(measured, index);
        // A blank photo is unlike its neighbours in every way: once is enough.
        if blank.is_some() {
            all.extend(blank);
            continue;
        }
        all.extend(blurred(measured, index));
        all.extend(exposed(measured, index));
        all.extend(
            apart(measured, index, usual_reach)
                .or_else(|| turned(measured, index))
                .or_else(|| lonely(&measured.facts[index])),
        );
        all.extend(usual_error.and_then(|usual| misplaced(measured, index, usual)));
    }
    all.sort_by(|a, b| {
        b.severity
            .total_cmp(&a.severity)
            .then(a.photo.cmp(&b.photo))
    });
    all
}

fn problem(
    facts: &PhotoFacts,
    kind: ProblemKind,
    severity: f64,
    (problem, advice): (String, &str),
) -> Problem {
    Problem {
        photo: facts.photo.clone(),
        kind,
        problem,
        advice: advice.to_owned(),
        severity,
    }
}

fn blank(measured: &Measured<'_>, index: usize) -> Option<Problem> {
    let contrast = measured.looks[index].0.contrast;
    let text = (
        "shows next to nothing: nearly all of it has one brightness".to_owned(),
        "leave it out",
    );
    (contrast < LEAST_CONTRAST)
        .then(|| problem(&measured.facts[index], ProblemKind::Blank, 3.0, text))
}

fn blurred(measured: &Measured<'_>, index: usize) -> Option<Problem> {
    let compared = measured.compared[index]?;
    let (detail, least) = (
        compared.detail,
        match compared.at_points {
            true => BLURRED_AT_POINTS,
            false => BLURRED,
        },
    );
    let slope = compared.at_points || compared.slope < BLURRED_SLOPE || detail < SMEARED;
    if detail >= least || !slope {
        return None;
    }
    let much = if detail < 2.0 * least { "much " } else { "" };
    let text = (
        format!(
            "is {much}blurrier than its neighbours ({:.0} % of their fine detail)",
            100.0 * detail.exp()
        ),
        "leave it out or retake it",
    );
    let facts = &measured.facts[index];
    Some(problem(facts, ProblemKind::Blur, detail / least, text))
}

fn exposed(measured: &Measured<'_>, index: usize) -> Option<Problem> {
    let compared = measured.compared[index]?;
    let most = match compared.at_points {
        true => STOPS_AT_POINTS,
        false => STOPS,
    };
    let stops = compared.stops;
    if stops.abs() <= most {
        return None;
    }
    let how = if stops > 0.0 { "brighter" } else { "darker" };
    let text = (
        format!("is {:.1} stops {how} than its neighbours", stops.abs()),
        "even out its exposure in a photo editor, or retake it with the exposure locked",
    );
    let facts = &measured.facts[index];
    Some(problem(
        facts,
        ProblemKind::Exposure,
        stops.abs() / most,
        text,
    ))
}

/// A photo that looks away from what nearly all others look at.
fn turned(measured: &Measured<'_>, index: usize) -> Option<Problem> {
    let one_place = matches!(measured.layout.walk, Walk::Around | Walk::ForwardFacing);
    let angle = off_axis(&measured.cameras[index], measured.shape.target);
    if !one_place || measured.layout.convergence < CONVERGED || angle < TURNED {
        return None;
    }
    let text = (
        format!("looks {angle:.0}° away from what the other photos show"),
        "check its pose and leave it out if that is wrong, else take more photos that way",
    );
    let facts = &measured.facts[index];
    Some(problem(facts, ProblemKind::Direction, angle / TURNED, text))
}

/// Distance from the cameras' middle that three quarters of them keep.
fn usual_reach(measured: &Measured<'_>) -> f64 {
    let mut reach: Vec<f64> = measured
        .cameras
        .iter()
        .map(|c| c.centre().distance(measured.shape.middle))
        .collect();
    reach.sort_by(f64::total_cmp);
    reach.get(reach.len() * 3 / 4).copied().unwrap_or(0.0)
}

fn apart(measured: &Measured<'_>, index: usize, usual: f64) -> Option<Problem> {
    let reach = measured.cameras[index]
        .centre()
        .distance(measured.shape.middle);
    if usual <= 0.0 || reach <= FAR_OUT * usual {
        return None;
    }
    let text = (
        format!(
            "stands {:.0} times as far out as the others, so that all else is squeezed together",
            reach / usual
        ),
        "leave it out: its pose is likely wrong",
    );
    let facts = &measured.facts[index];
    Some(problem(
        facts,
        ProblemKind::Distance,
        reach / usual / FAR_OUT,
        text,
    ))
}

fn lonely(facts: &PhotoFacts) -> Option<Problem> {
    let (problem_text, severity) = match facts.shared_points {
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
    let text = (
        problem_text,
        "take more photos from near it, or leave it out",
    );
    Some(problem(facts, ProblemKind::Overlap, severity, text))
}

fn misplaced(measured: &Measured<'_>, index: usize, usual: f64) -> Option<Problem> {
    let facts = &measured.facts[index];
    let error = facts.reprojection_error.filter(|error| !error.is_nan())?;
    let (w, h) = measured.scene.photos[index].pixels.dimensions();
    let most = (ERROR_TIMES * usual).max(ERROR_SHARE * f64::from(w.max(h)));
    if error <= most {
        return None;
    }
    let seen = match error.is_finite() {
        true => format!("sees its points {error:.1} pixels off (the others {usual:.1})"),
        false => "has most of its points behind its camera".to_owned(),
    };
    let text = (
        seen,
        "leave it out, or estimate the poses again: its pose or its lens is wrong",
    );
    Some(problem(
        facts,
        ProblemKind::Pose,
        (error / most).min(1e3),
        text,
    ))
}

/// Photos whose pixels were already there under another name.
fn copies(measured: &Measured<'_>) -> Vec<Problem> {
    let mut first: HashMap<&[u8], &str> = HashMap::new();
    let mut all = Vec::new();
    for (photo, facts) in measured.scene.photos.iter().zip(measured.facts) {
        match first.get(&photo.pixels.as_raw()[..]) {
            Some(other) => {
                let text = (
                    format!("has the same pixels as {other}"),
                    "leave one of the two out",
                );
                all.push(problem(facts, ProblemKind::Copy, 1.5, text));
            }
            None => {
                first.insert(photo.pixels.as_raw(), &photo.name);
            }
        }
    }
    all
}
