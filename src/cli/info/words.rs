//! A capture in words, the worst first.

use std::fmt::Write;

use impasto::scene::inspect::{CapturePattern, Coverage, Inspection, LensUse, PhotoFacts};
use impasto_train::estimate::Estimate;

use super::capture::CaptureInfo;
use super::training::{TrainingEstimates, threads};
use super::warnings::Warning;
use crate::cli::values::clock;

/// Photos whose problems are told one by one; of more, the rest is counted.
const TOLD: usize = 12;
/// The least sharp photos, named whether or not they are blurred.
const NAMED: usize = 3;

/// All that people want to know.
pub fn report(info: &CaptureInfo) -> String {
    let parts = [
        heading(info),
        problems(&info.found, &info.warnings),
        views(info),
        appearance(&info.found),
        cost(&info.training, info.downscale),
        picture(info),
    ];
    let parts = parts.iter().map(|part| part.trim_end());
    let parts: Vec<&str> = parts.filter(|part| !part.is_empty()).collect();
    parts.join("\n\n")
}

fn heading(info: &CaptureInfo) -> String {
    let scene = &info.scene;
    let kind = if scene.synthetic { "synthetic " } else { "" };
    format!(
        "{}: {} {kind}photos, {} to learn from and {} held out; format {}",
        scene.name,
        scene.photos.len(),
        scene.train().count(),
        scene.test().count(),
        scene.format
    )
}

fn problems(found: &Inspection, warnings: &[Warning]) -> String {
    let mut text = String::new();
    for Warning { problem, advice } in warnings {
        let _ = writeln!(text, "Warning: {problem}; {advice}");
    }
    if found.problems.is_empty() {
        return text + "No single photo stands out as bad.";
    }
    if !warnings.is_empty() {
        text.push('\n');
    }
    text.push_str("Photos to look at, the worst first:\n");
    for problem in found.problems.iter().take(TOLD) {
        let _ = writeln!(
            text,
            "  {} {}; {}",
            problem.photo, problem.problem, problem.advice
        );
    }
    if let Some(rest) = found
        .problems
        .len()
        .checked_sub(TOLD)
        .filter(|rest| *rest > 0)
    {
        let _ = writeln!(text, "  and {rest} more (all of them with --json)");
    }
    text
}

/// Photos, lenses and cameras; overlap and points.
fn views(info: &CaptureInfo) -> String {
    let found = &info.found;
    let mut text = String::new();
    let sizes = info.sizes();
    let sides = |side: fn(&(u32, u32)) -> u32| range(sizes.keys().map(|s| f64::from(side(s))), "");
    let angles = |angle: fn(&LensUse) -> f64| range(found.lenses.iter().map(angle), "°");
    let bent = found.lenses.iter().any(|lens| lens.distorted);
    let _ = writeln!(
        text,
        "Photos:  {}×{} pixels; field of view {}×{}; {}{}",
        sides(|s| s.0),
        sides(|s| s.1),
        angles(|l| l.fov_x),
        angles(|l| l.fov_y),
        match found.lenses.len() {
            1 => "one lens".to_owned(),
            many => format!("{many} lenses"),
        },
        if bent { " with distortion" } else { "" },
    );
    let [x, y, z] = found.cameras.extent.map(short);
    let _ = writeln!(
        text,
        "Cameras: {}; within {x} × {y} × {z} of the capture's units (across, along, up)",
        walk(found)
    );
    text + &overlap(info)
}

/// How much of each other photos show, and how many points.
fn overlap(info: &CaptureInfo) -> String {
    let found = &info.found;
    let mut text = String::new();
    let usual = |of: fn(&PhotoFacts) -> f64| median(found.per_photo.iter().map(of));
    let least = found
        .per_photo
        .iter()
        .min_by(|a, b| a.overlap.total_cmp(&b.overlap));
    if let Some(least) = least {
        let _ = writeln!(
            text,
            "Overlap: a photo's second-best neighbour sees {:.0} % of {} (least: {} with {:.0} %)",
            100.0 * usual(|facts| facts.overlap),
            if least.points.is_some() {
                "its points"
            } else {
                "its view"
            },
            least.photo,
            100.0 * least.overlap
        );
    }
    text += &coverage(&found.coverage);
    let fewest = found
        .per_photo
        .iter()
        .filter_map(|f| Some((f.points?, &f.photo)))
        .min();
    if let Some((fewest, photo)) = fewest {
        let _ = writeln!(
            text,
            "Points:  {}, {:.0} a photo (fewest: {photo} with {fewest}); {:.2} pixels off",
            info.scene.points.len(),
            usual(|facts| facts.points.unwrap_or(0) as f64),
            usual(|facts| facts.reprojection_error.unwrap_or(0.0)),
        );
    }
    text
}

fn coverage(coverage: &Coverage) -> String {
    let Coverage {
        median,
        worst_tenth,
        least,
    } = coverage;
    let around = match &least[..] {
        [] => String::new(),
        names => format!("; least around {}", names.join(", ")),
    };
    format!(
        "Seen by: {median} photos, as a rule, for a place in one of them; {worst_tenth} or fewer for a \
         tenth of all places{around}\n"
    )
}

fn walk(found: &Inspection) -> String {
    let gap = found.cameras.largest_gap;
    match found.cameras.walk {
        CapturePattern::Around if gap < 60.0 => {
            format!("all around one place (largest gap {gap:.0}°)")
        }
        CapturePattern::Around => format!("along an arc of {:.0}° around one place", 360.0 - gap),
        CapturePattern::ForwardFacing => "all look about the same way".into(),
        CapturePattern::Outward => "look outwards all around".into(),
        CapturePattern::WalkThrough => "look different ways, as on a walk through a place".into(),
    }
}

/// Sharpness and exposure, for those who judge by themselves.
fn appearance(found: &Inspection) -> String {
    let ordered = |of: fn(&PhotoFacts) -> Option<f64>| {
        let measured = found.per_photo.iter();
        let mut all: Vec<(f64, &str)> = measured
            .filter_map(|facts| Some((of(facts)?, facts.photo.as_str())))
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    };
    let (sharp, stops) = (ordered(|f| f.sharpness), ordered(|f| f.stops));
    let (Some(darkest), Some(brightest)) = (stops.first(), stops.last()) else {
        return String::new();
    };
    let least = sharp.iter().take(NAMED);
    let least: Vec<String> = least
        .map(|(share, name)| format!("{name} {:.0} %", 100.0 * share))
        .collect();
    format!(
        "Least sharp beside their neighbours: {}\n\
         Exposure beside neighbours: {} {:+.1} stops to {} {:+.1}",
        least.join(", "),
        darkest.1,
        darkest.0,
        brightest.1,
        brightest.0
    )
}

fn cost(training: &TrainingEstimates, downscale: u32) -> String {
    let measured = training.fast.steps_per_second.is_some();
    let mut text = match (measured, training.memory) {
        (true, _) => format!(
            "Training here, on {} threads of the CPU as busy as it is now:\n",
            threads()
        ),
        (false, _) => "Training here (times are not measured with --quick):\n".to_owned(),
    };
    let [fast, paper] =
        [&training.fast, &training.paper].map(|e| (e, format!("{:.1} GiB", e.memory_gib)));
    let _ = writeln!(text, "  fast:  {}; {} of memory", within(fast.0), fast.1);
    let _ = writeln!(text, "  paper: {}; {} of memory", whole(paper.0), paper.1);
    if downscale > 1 {
        let _ = writeln!(text, "  both with --downscale {downscale}");
    }
    text
}

/// What a time budget is enough for.
fn within(estimate: &Estimate) -> String {
    let time = clock(estimate.seconds.unwrap_or(0.0));
    match estimate.steps {
        Some([geometry, 0]) => format!(
            "the default budget of {time} is enough for about {} steps of geometry; it paints at once",
            rounded(geometry)
        ),
        Some([geometry, style]) => format!(
            "the default budget of {time} is enough for about {} steps of geometry and {} of style",
            rounded(geometry),
            rounded(style)
        ),
        None => format!("as long as it is given, by default {time}"),
    }
}

/// How long a schedule takes.
fn whole(estimate: &Estimate) -> String {
    const DAY: f64 = 86_400.0;
    let steps = estimate.steps.map_or(0, |steps| steps.iter().sum());
    match estimate.seconds {
        Some(seconds) if seconds > 2.0 * DAY => format!(
            "about {:.0} days for the paper's {steps} steps",
            seconds / DAY
        ),
        Some(seconds) => format!("about {} for the paper's {steps} steps", clock(seconds)),
        None => format!("days to weeks for the paper's {steps} steps"),
    }
}

/// To two digits: more would promise too much.
fn rounded(count: u64) -> u64 {
    let unit = 10u64.pow(count.checked_ilog10().unwrap_or(0).saturating_sub(1));
    (count + unit / 2) / unit * unit
}

fn picture(info: &CaptureInfo) -> String {
    info.picture.as_ref().map_or_else(String::new, |path| {
        format!(
            "{}: from above and from a side; photos to learn from blue, held out orange; the circle is the unit ball",
            path.display()
        )
    })
}

/// The least and the greatest, as one where they are the same.
fn range(values: impl Iterator<Item = f64>, unit: &str) -> String {
    let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
        (a.min(v), b.max(v))
    });
    if least == most {
        format!("{least}{unit}")
    } else {
        format!("{least} to {most}{unit}")
    }
}

/// A length to three digits.
fn short(length: f64) -> String {
    let digits = if length.abs() < 10.0 { 2 } else { 0 };
    format!("{length:.digits$}")
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_exact_as_they_are_known() {
        assert_eq!(
            [0, 7, 99, 4_731, 350_000].map(rounded),
            [0, 7, 99, 4_700, 350_000]
        );
        assert_eq!(range([4.5, 4.5].into_iter(), "°"), "4.5°");
        assert_eq!(range([30.0, 4.5].into_iter(), "°"), "4.5 to 30°");
    }

    #[test]
    fn long_schedules_are_in_days() {
        let estimate = |seconds| Estimate {
            seconds,
            steps: Some([250_000, 100_000]),
            steps_per_second: None,
            memory_gib: 1.0,
        };
        assert!(whole(&estimate(Some(41.2 * 86_400.0))).starts_with("about 41 days"));
        assert!(whole(&estimate(Some(3_600.0))).starts_with("about 1:00:00"));
        assert!(whole(&estimate(None)).contains("350000 steps"));
    }
}
