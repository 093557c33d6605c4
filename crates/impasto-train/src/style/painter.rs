//! Pre-training of the painter: a hypernetwork learned on several scenes at once, so that it belongs to none.

use crate::TrainError;
use crate::event::{Event, Stage};
use crate::paintings::{StyleSet, StyleSources, painting_folder};
use crate::progress::{Progress, Reported};
use crate::style::encoder::read_weights;
use crate::style::patches::PatchPool;
use crate::style::stage::{StyleNetworks, StyleStage};
use burn::tensor::Device;
use impasto_model::config::{ContentTarget, StyleConfig};
use impasto_model::{Budget, Clock, Model, ModelError, StyleModel, TrainConfig};
use impasto_scene::Split;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Random crops per painting, beside the whole.
const CROPS: u16 = 2;
/// Time between two writes of what was learned so far.
const SAVE_EVERY: Duration = Duration::from_secs(120);

/// What to learn a painter from.
#[derive(Debug, Clone)]
pub struct PainterOptions {
    /// Models whose scenes are painted; only their geometry is used.
    pub scenes: Vec<PathBuf>,
    /// A folder of paintings, with its sub-folders.
    pub styles: PathBuf,
    /// Where to go on from; without, random weights.
    pub init: Option<PathBuf>,
    /// Sizes and rates.
    pub config: TrainConfig,
    /// Limit on the updates.
    pub budget: Budget,
    /// Seed of everything random.
    pub seed: u64,
    /// Folder where statistics of paintings are kept for later runs; `None` keeps nothing.
    pub cache: Option<PathBuf>,
    /// What it is computed on.
    pub device: Device,
}

/// What it came to.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PainterSummary {
    /// Scenes.
    pub scenes: usize,
    /// Paintings and crops of them.
    pub pictures: usize,
    /// Updates.
    pub steps: u64,
    /// Seconds that the updates took.
    pub seconds: f64,
    /// Content loss at the end, smoothed.
    pub content: f64,
    /// Style loss at the end, smoothed.
    pub style: f64,
}

/// Reads a painter's file.
///
/// # Errors
/// If it cannot be read or is no painter of these sizes.
pub fn read_painter(
    path: &Path,
    config: &TrainConfig,
    device: &Device,
) -> Result<StyleModel, TrainError> {
    let (name, bytes) = read_weights(path, "train-painter")?;
    Ok(StyleModel::from_bytes(&name, &bytes, config, device)?)
}

/// Learns a painter; `keep` gets what was learned every two minutes and at the end.
///
/// # Errors
/// If a model or a folder cannot be read, or there is nothing to learn from.
pub fn train_painter<E: From<TrainError>>(
    options: &PainterOptions,
    keep: &mut dyn FnMut(&StyleModel) -> Result<(), E>,
    sink: &mut dyn FnMut(&Event),
) -> Result<PainterSummary, E> {
    let mut stage = prepared(options, sink)?;
    let (seconds, steps) = match options.budget {
        Budget::Time(time) => (Some(time.as_secs_f64()), None),
        Budget::Steps(steps) => (None, Some(steps)),
    };
    sink(&Event::StageStarted {
        stage: Stage::Style,
        seconds,
        steps,
    });
    let mut clock = Clock::start(options.budget);
    let mut progress = Progress::new(Stage::Style, Reported::default());
    let mut saved = Instant::now();
    while !clock.is_over() {
        let report = stage.step(&clock).map_err(TrainError::from)?;
        clock.steps += 1;
        let losses = [Some(report.loss), report.content, report.style];
        if let Some(event) = progress.step(&clock, losses, report.rays) {
            sink(&event);
        }
        if saved.elapsed() >= SAVE_EVERY {
            keep(&stage.snapshot())?;
            saved = Instant::now();
        }
    }
    keep(&stage.snapshot())?;
    let [_, content, style] = progress.losses().map(Option::unwrap_or_default);
    Ok(PainterSummary {
        scenes: options.scenes.len(),
        pictures: stage.styles(),
        steps: clock.steps,
        seconds: clock.seconds(),
        content,
        style,
    })
}

fn prepared(
    options: &PainterOptions,
    sink: &mut dyn FnMut(&Event),
) -> Result<StyleStage, TrainError> {
    let config = &options.config;
    config.validate()?;
    let settings = StyleConfig {
        content_target: ContentTarget::Render,
        photo_weight: 0.0,
        ..config.style.clone()
    };
    let first = options.init.as_deref();
    let first = first.map(|path| read_painter(path, config, &options.device));
    let first = first.transpose()?;
    let mut pools = Vec::new();
    for path in &options.scenes {
        let model = Model::load_on(path, &options.device)?;
        if model.file.scene.cameras(Split::Train).is_empty() {
            return Err(TrainError::Model(ModelError::Read {
                path: path.clone(),
                reason: "has no training views to paint; train it from photos".into(),
            }));
        }
        pools.push(PatchPool::of_model(
            &model,
            &settings,
            config.style_appearance(),
        ));
    }
    let folder = painting_folder(&options.styles)?;
    let vgg = settings.perceptual.load()?;
    let sources = StyleSources {
        folder: Some(&folder),
        crops: CROPS,
        generated: settings.generated,
        patch: settings.patch,
        pictures: settings.pictures,
        exemplars: settings.shading.paint().is_some(),
        cache: options.cache.as_deref(),
        deadline: None,
    };
    let styles = StyleSet::gather(&vgg, &sources, sink)?;
    let networks = StyleNetworks {
        vgg,
        vae: config.encoder(None)?,
        first,
    };
    let config = TrainConfig {
        style: settings,
        ..config.clone()
    };
    let (seed, device) = (options.seed, &options.device);
    Ok(StyleStage::over(
        &config, pools, networks, styles, seed, device,
    ))
}
