//! What about a whole capture asks for something to be done.

use impasto::TrainConfig;
use impasto::scene::Scene;
use impasto::scene::inspect::{CapturePattern, Inspection};
use impasto_train::estimate::{GIB, shrink_to_fit};
use serde::Serialize;

use super::training::TrainingEstimates;

/// Something about the whole capture that asks for something to be done.
#[derive(Debug, Serialize)]
pub struct Warning {
    /// What is wrong.
    pub problem: String,
    /// What to do.
    pub advice: String,
}

/// Photos that a capture should have at least: fewer leave most of a place unseen from a second
/// side.
const FEW_PHOTOS: usize = 10;
/// Photos that should see a place: what two see at a slant is a guess.
const FEW_WITNESSES: usize = 3;
/// Degrees of azimuth without a photo that a view may not bridge, in a capture that goes around
/// its subject and is no mere arc.
const GAP: std::ops::Range<f64> = 60.0..180.0;

/// Part of a machine's memory that one program can have.
const USABLE: f64 = 0.9;

/// Warnings about a capture that was loaded at so many times less than its size.
pub fn warnings(
    scene: &Scene,
    found: &Inspection,
    training: &TrainingEstimates,
    downscale: u32,
) -> Vec<Warning> {
    let mut all = of_capture(scene, found);
    all.extend(of_training(scene, training, downscale));
    all
}

fn of_capture(scene: &Scene, found: &Inspection) -> Vec<Warning> {
    let loading = scene.warnings.iter().map(|text| {
        let (problem, advice) = text.split_once("; ").unwrap_or((text, "see the manual"));
        Warning {
            problem: problem.to_owned(),
            advice: advice.to_owned(),
        }
    });
    let mut all: Vec<Warning> = loading.collect();
    let count = scene.photos.len();
    if count < FEW_PHOTOS {
        all.push(Warning {
            problem: format!("there are only {count} photos"),
            advice: "take 20 or more, each sharing half of its view with the next".into(),
        });
    }
    let coverage = &found.coverage;
    if count >= FEW_PHOTOS && coverage.worst_tenth < FEW_WITNESSES {
        let seen = coverage.worst_tenth.max(1);
        let around = match coverage.least.first() {
            Some(photo) => format!(
                "take ten more from around {photo}, each sharing half of its view with the next"
            ),
            None => "take ten more, each sharing half of its view with the next".into(),
        };
        all.push(Warning {
            problem: format!(
                "a tenth of what the photos show is seen by {} only, and will be vague",
                if seen == 1 {
                    "one photo".to_owned()
                } else {
                    format!("{seen} photos")
                }
            ),
            advice: around,
        });
    }
    let cameras = &found.cameras;
    if cameras.walk == CapturePattern::Around && GAP.contains(&cameras.largest_gap) {
        all.push(Warning {
            problem: format!(
                "no photo was taken from {:.0}° of the directions around",
                cameras.largest_gap
            ),
            advice: "add photos from there, or render no views from there".into(),
        });
    }
    all
}

/// What does not fit this machine, or training at all.
fn of_training(scene: &Scene, training: &TrainingEstimates, downscale: u32) -> Vec<Warning> {
    let mut all = Vec::new();
    let fast = TrainConfig::fast();
    let [rows, columns] = fast.style.patch;
    let small = scene.train().map(|(_, photo)| photo).find(|photo| {
        let (width, height) = photo.pixels.dimensions();
        (width as usize) < columns || (height as usize) < rows
    });
    if let Some(photo) = small {
        let (width, height) = photo.pixels.dimensions();
        all.push(Warning {
            problem: format!(
                "{} has {width}×{height} pixels, too few for the style stage, which needs {columns}×{rows}",
                photo.name
            ),
            advice: match downscale {
                1 => "use larger photos".into(),
                _ => "use a smaller --downscale".into(),
            },
        });
    }
    let Some(memory) = training.memory else {
        return all;
    };
    let usable = (memory as f64 * USABLE) as u64;
    let presets = [
        ("fast", &training.fast, fast),
        ("paper", &training.paper, TrainConfig::paper()),
    ];
    for (name, estimate, config) in presets {
        if estimate.memory_gib * GIB <= usable as f64 {
            continue;
        }
        all.push(Warning {
            problem: format!(
                "training with the {name} preset needs about {:.1} GiB of memory, and this machine has {:.1}",
                estimate.memory_gib,
                memory as f64 / GIB
            ),
            advice: match shrink_to_fit(scene, &config, usable) {
                Some(times) => format!("train with --downscale {}", times * downscale),
                None => "use a machine with more".into(),
            },
        });
    }
    all
}
