//! What to train, and what came of it.

use crate::run::recovery::Recovery;
use burn::tensor::Device;
use impasto_model::{Budget, Quality, Stages, TrainConfig};
use impasto_scene::LoadOptions;
use serde::Serialize;
use std::path::PathBuf;

/// What to train, on what, for how long.
#[derive(Debug, Clone)]
pub struct TrainOptions {
    /// The capture.
    pub scene: PathBuf,
    /// The model folder.
    pub output: PathBuf,
    /// A folder of paintings, with its sub-folders; without one, generated pictures only.
    pub styles: Option<PathBuf>,
    /// An encoder made by [`crate::train_encoder`], which the model then carries; without one,
    /// the shipped one.
    pub encoder: Option<PathBuf>,
    /// Folder where statistics of paintings are kept for later runs; `None` keeps nothing.
    pub cache: Option<PathBuf>,
    /// Stages.
    pub stages: Stages,
    /// Sizes and rates.
    pub config: TrainConfig,
    /// Limit on the whole run, loading and final checks included.
    pub budget: Budget,
    /// How to read the capture.
    pub load: LoadOptions,
    /// Seed of everything random.
    pub seed: u64,
    /// What the stages compute on; see [`impasto_model::DeviceChoice`].
    pub device: Device,
    /// How the run can be interrupted and go on.
    pub recovery: Recovery,
}

/// What a run came to.
#[derive(Debug, Clone, Serialize)]
pub struct TrainSummary {
    /// The model folder.
    pub model: PathBuf,
    /// Of the geometry.
    #[serde(flatten)]
    pub quality: Quality,
    /// Seconds that the run took, all its parts together where it was interrupted.
    pub seconds: f64,
    /// Steps of the geometry stage.
    pub geometry_steps: u64,
    /// Steps of the style stage.
    pub style_steps: u64,
    /// Training photos.
    pub train_photos: usize,
    /// Files in the style folder, less those that are known to be no pictures.
    pub paintings: usize,
    /// Files in the style folder that the style stage found to be no pictures.
    pub unreadable_paintings: usize,
    /// Whether the photos were made by a program.
    pub synthetic: bool,
    /// Whether the run was over before, so that nothing was left to resume.
    pub finished_before: bool,
}
