//! What a capture is, and what is wrong with it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use impasto::scene::inspect::{Inspection, inspect};
use impasto::scene::{Format, LoadOptions, Scene, Split, load, overview};
use serde_json::{Value, json};

use super::training::TrainingEstimates;
use super::warnings::{Warning, warnings};
use crate::cli::{CliError, to_json};
use crate::output::write_png;

/// How a capture is read.
#[derive(Debug, Args)]
pub struct CaptureArgs {
    /// Format of the capture, where it should not be detected: colmap, transforms, nerf++ or llff
    #[arg(long)]
    pub format: Option<Format>,
    /// Shrink the photos this many times, as for training
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub downscale: u32,
    /// Draw cameras and points from above and from a side
    #[arg(short = 'o', long, value_name = "FILE.png", conflicts_with = "preset")]
    pub picture: Option<PathBuf>,
    /// Do not measure how fast this machine trains
    #[arg(long)]
    pub quick: bool,
}

/// A capture, and all that is known of it.
pub struct CaptureInfo {
    /// The capture as loaded.
    pub scene: Scene,
    /// What was found in it.
    pub found: Inspection,
    /// What asks for something to be done.
    pub warnings: Vec<Warning>,
    /// What training would take.
    pub training: TrainingEstimates,
    /// How many times photos are shrunk.
    pub downscale: u32,
    /// Where its picture was written, if one was asked for.
    pub picture: Option<PathBuf>,
}

impl CaptureInfo {
    /// Loads and inspects a capture, and writes its picture where one is asked for.
    pub fn load(path: &Path, args: &CaptureArgs) -> Result<Self, CliError> {
        let options = LoadOptions {
            format: args.format,
            downscale: args.downscale,
            ..LoadOptions::default()
        };
        let scene = load(path, &options)?;
        let found = inspect(&scene);
        if let Some(path) = &args.picture {
            write_png(path, &overview::picture(&scene))?;
        }
        let training = TrainingEstimates::of(&scene, args.quick)?;
        Ok(Self {
            warnings: warnings(&scene, &found, &training, args.downscale),
            scene,
            found,
            training,
            downscale: args.downscale,
            picture: args.picture.clone(),
        })
    }

    /// Facts, as `--json` prints them.
    pub fn json(&self) -> Value {
        let sizes: Vec<Value> = self
            .sizes()
            .into_iter()
            .map(|((width, height), count)| json!({"w": width, "h": height, "photos": count}))
            .collect();
        let names = |split| -> Vec<&str> {
            let photos = self
                .scene
                .photos
                .iter()
                .filter(|photo| photo.split == split);
            photos.map(|photo| photo.name.as_str()).collect()
        };
        json!({
            "name": self.scene.name,
            "format": self.scene.format,
            "synthetic": self.scene.synthetic,
            "downscale": self.downscale,
            "photos": self.scene.photos.len(),
            "sizes": sizes,
            "train": names(Split::Train),
            "test": names(Split::Test),
            "points": self.scene.points.len(),
            "normalisation": to_json(&self.scene.normalisation),
            "lenses": to_json(&self.found.lenses),
            "cameras": to_json(&self.found.cameras),
            "coverage": to_json(&self.found.coverage),
            "problems": to_json(&self.found.problems),
            "warnings": to_json(&self.warnings),
            "per_photo": to_json(&self.found.per_photo),
            "estimates": self.training.json(),
            "picture": self.picture,
        })
    }

    /// How many photos have which size.
    pub fn sizes(&self) -> BTreeMap<(u32, u32), usize> {
        let mut sizes = BTreeMap::new();
        for photo in &self.scene.photos {
            *sizes.entry(photo.pixels.dimensions()).or_insert(0) += 1;
        }
        sizes
    }
}
