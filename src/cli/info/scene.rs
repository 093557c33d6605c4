//! What a capture is, and what is wrong with it.

use std::collections::BTreeMap;
use std::path::Path;

use impasto::scene::inspect::{CapturePattern, Inspection, inspect};
use impasto::scene::{LoadOptions, Scene, Split, load, overview};
use serde::Serialize;
use serde_json::{Value, json};

use super::training::{self, Training};
use super::{SceneArgs, to_json, words};
use crate::cli::CliError;
use crate::output::picture::save_png;
use crate::output::write_file;

/// Something about the whole capture that asks for something to be done.
#[derive(Debug, Serialize)]
pub struct Warning {
    pub problem: String,
    pub advice: String,
}

/// Facts about a capture, as JSON and in words. Writes its picture where one is asked for.
pub fn describe(path: &Path, args: &SceneArgs) -> Result<(Value, String), CliError> {
    let options = LoadOptions {
        format: args.format,
        downscale: args.downscale,
        ..LoadOptions::default()
    };
    let scene = load(path, &options)?;
    let found = inspect(&scene);
    if let Some(path) = &args.picture {
        let picture = overview::picture(&scene);
        write_file(path, |path| save_png(&picture, path))?;
    }
    let training = Training::of(&scene, args.quick)?;
    let mut warnings = warnings(&scene, &found);
    warnings.extend(training::warnings(&scene, &training, args.downscale));
    let text = words::report(&scene, &found, &warnings, &training, args);
    Ok((facts(&scene, &found, &warnings, &training, args), text))
}

/// Photos that a capture should have at least: fewer leave most of a place unseen from a second
/// side.
const FEW_PHOTOS: usize = 10;
/// Degrees of azimuth without a photo that a view may not bridge, in a capture that goes around
/// its subject and is no mere arc.
const GAP: std::ops::Range<f64> = 60.0..180.0;

fn warnings(scene: &Scene, found: &Inspection) -> Vec<Warning> {
    let loading = scene.warnings.iter().map(|told| {
        let (problem, advice) = told.split_once("; ").unwrap_or((told, "see the manual"));
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

fn facts(
    scene: &Scene,
    found: &Inspection,
    warnings: &[Warning],
    training: &Training,
    args: &SceneArgs,
) -> Value {
    let sizes: Vec<Value> = sizes(scene)
        .into_iter()
        .map(|((width, height), count)| json!({"w": width, "h": height, "photos": count}))
        .collect();
    let names = |split| -> Vec<&str> {
        let photos = scene.photos.iter().filter(|photo| photo.split == split);
        photos.map(|photo| photo.name.as_str()).collect()
    };
    json!({
        "name": scene.name,
        "format": scene.format,
        "synthetic": scene.synthetic,
        "downscale": args.downscale,
        "photos": scene.photos.len(),
        "sizes": sizes,
        "train": names(Split::Train),
        "test": names(Split::Test),
        "points": scene.points.len(),
        "normalisation": to_json(&scene.normalisation),
        "lenses": to_json(&found.lenses),
        "cameras": to_json(&found.cameras),
        "problems": to_json(&found.problems),
        "warnings": to_json(&warnings),
        "per_photo": to_json(&found.per_photo),
        "estimates": training.json(),
        "picture": args.picture,
    })
}

/// How many photos have which size.
pub fn sizes(scene: &Scene) -> BTreeMap<(u32, u32), usize> {
    let mut sizes = BTreeMap::new();
    for photo in &scene.photos {
        *sizes.entry(photo.pixels.dimensions()).or_insert(0) += 1;
    }
    sizes
}
