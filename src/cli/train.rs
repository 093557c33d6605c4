//! `impasto train`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, ValueEnum};
use impasto::scene::{Format, LoadOptions, MaskUse};
use impasto::{
    Budget, Device, Recovery, Stages, TrainConfig, TrainOptions, TrainSummary, Unfinished,
    cache_folder, train,
};
use serde::Deserialize;

use super::device::DeviceArgs;
use super::progress::TrainingProgress;
use super::values::{clock, duration, interval};
use super::{CliError, CommandOutput, interrupt, settings, to_json};
use crate::output::check_folder;

/// Learn a scene from posed photos, and to repaint it from paintings
#[derive(Debug, Args)]
pub struct TrainArgs {
    /// The capture: a COLMAP folder, or one with transforms.json
    scene: PathBuf,
    /// Folder to write the model to
    #[arg(short, long, value_name = "MODEL")]
    output: PathBuf,
    /// Folder of paintings to paint more like, sub-folders included; without one the model paints as
    /// every model does
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// Encoder of styles made by train-encoder; MODEL will carry it [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// What to train; `style` continues from the geometry that MODEL has
    #[arg(long, value_enum, default_value = "all")]
    stage: StageArg,
    /// Sizes and schedules to start from
    #[arg(long, value_enum, default_value = "fast")]
    preset: Preset,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Shrink the photos this many times
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    downscale: u32,
    /// Use only so many of the training photos, evenly spread in order of name; held-out ones stay
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    train_photos: Option<u32>,
    /// Format of the capture, where it should not be detected: colmap, transforms, nerf++ or llff
    #[arg(long)]
    format: Option<Format>,
    /// What becomes of what the pictures in the folder `masks` beside the photos hide (black, or
    /// transparent)
    #[arg(long, value_enum, default_value = "ignore")]
    masks: MasksArg,
    /// Start of the random numbers; the same seed and steps give the same model
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// TOML or JSON file with settings that differ from the preset's
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Go on with the interrupted run that MODEL holds; without one, begin
    #[arg(long)]
    resume: bool,
    /// Time between two checkpoints, from which --resume goes on; 0s for one after each step
    #[arg(long, value_name = "TIME", default_value = "2m", value_parser = interval)]
    checkpoint_every: Duration,
    #[command(flatten)]
    device: DeviceArgs,
    /// One setting, e.g. style.style_weight=30; after the file's; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum StageArg {
    /// Geometry, then style
    All,
    /// The scene as photographed
    Geometry,
    /// How to repaint it
    Style,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MasksArg {
    /// It is not there: never learned from or compared with
    Ignore,
    /// It is white background, as where a photo is transparent
    Transparent,
    /// Masks are not used
    Off,
}

/// Sizes and schedules to start from.
#[derive(Debug, Clone, Copy, Default, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// For a CPU: hash grids and small networks
    #[default]
    Fast,
    /// The paper's architecture and schedule
    Paper,
}

impl Preset {
    /// What it stands for.
    pub fn config(self) -> TrainConfig {
        match self {
            Self::Fast => TrainConfig::fast(),
            Self::Paper => TrainConfig::paper(),
        }
    }
}

/// How long to train.
#[derive(Debug, Clone, Copy, Args)]
pub struct BudgetArgs {
    /// Time for training, e.g. 90s, 10m or 1h30m [default: 3m, or 10m where paintings are learned from;
    /// 2m for the demo]
    #[arg(long, value_name = "TIME", value_parser = duration, conflicts_with = "steps")]
    pub budget: Option<Duration>,
    /// Number of steps of training, instead of a time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
}

impl BudgetArgs {
    /// Training time where nothing else is asked for and the place alone is learned.
    pub const GEOMETRY: Duration = Duration::from_secs(180);
    /// Where paintings are learned from as well.
    pub const DEFAULT: Duration = Duration::from_secs(600);

    /// The usual one of the two: the preset's painter need not learn, unless from paintings that are given.
    pub fn usual(preset: Preset, styles: bool) -> Duration {
        match preset {
            Preset::Fast if !styles => Self::GEOMETRY,
            _ => Self::DEFAULT,
        }
    }

    /// The budget that was asked for, or `default`.
    pub fn get_or(self, default: Duration) -> Budget {
        match self.steps {
            Some(steps) => Budget::Steps(steps),
            None => Budget::Time(self.budget.unwrap_or(default)),
        }
    }
}

/// What an interruption does.
const STOPPING: &str =
    "stopping after this step; once more leaves at once, with the last checkpoint";

/// Runs the command.
pub fn run(args: &TrainArgs) -> Result<CommandOutput, CliError> {
    let preset = args.preset.config();
    let config = settings::configure(&preset, args.config.as_deref(), &args.set)?;
    let device = args.device.open()?;
    let options = TrainOptions {
        styles: args.styles.clone(),
        encoder: args.encoder.clone(),
        stages: match args.stage {
            StageArg::All => Stages::All,
            StageArg::Geometry => Stages::Geometry,
            StageArg::Style => Stages::Style,
        },
        config,
        budget: args
            .budget
            .get_or(BudgetArgs::usual(args.preset, args.styles.is_some())),
        load: LoadOptions {
            downscale: args.downscale,
            format: args.format,
            masks: match args.masks {
                MasksArg::Ignore => MaskUse::Ignore,
                MasksArg::Transparent => MaskUse::Transparent,
                MasksArg::Off => MaskUse::Off,
            },
            train_photos: args.train_photos,
        },
        seed: args.seed,
        recovery: Recovery {
            unfinished: if args.resume {
                Unfinished::Resume
            } else {
                Unfinished::Keep
            },
            every: args.checkpoint_every,
            stop: interrupt::stop(STOPPING),
        },
        ..usual_options(&args.scene, &args.output, device)
    };
    let summary = watched(&options)?;
    Ok(CommandOutput {
        text: describe(&summary),
        json: to_json(&summary),
    })
}

/// Trains the fast preset on all photos, from the start; it paints as every model does.
pub fn usual_options(scene: &Path, output: &Path, device: Device) -> TrainOptions {
    TrainOptions {
        scene: scene.to_owned(),
        output: output.to_owned(),
        styles: None,
        encoder: None,
        cache: cache_folder(),
        stages: Stages::All,
        config: TrainConfig::fast(),
        budget: Budget::Time(BudgetArgs::GEOMETRY),
        load: LoadOptions::default(),
        seed: 0,
        device,
        recovery: Recovery::default(),
    }
}

/// Trains, with progress on stderr. That the model can be written is checked before.
pub fn watched(options: &TrainOptions) -> Result<TrainSummary, CliError> {
    check_folder(&options.output)?;
    let mut progress = TrainingProgress::default();
    Ok(train(options, &mut |event| progress.show(event))?)
}

/// A summary in words.
pub fn describe(summary: &TrainSummary) -> String {
    let kind = if summary.synthetic {
        " (synthetic scene)"
    } else {
        ""
    };
    let mut text = format!(
        "{}{kind}\n{} steps of geometry and {} of style in {}\n",
        summary.quality,
        summary.geometry_steps,
        summary.style_steps,
        clock(summary.seconds),
    );
    if summary.finished_before {
        text += "this run was over before: nothing was left to do\n";
    }
    if summary.unreadable_paintings > 0 {
        text += &format!(
            "{} files of the style folder are no readable pictures and were left out\n",
            summary.unreadable_paintings
        );
    }
    text + &format!("model: {}", summary.model.display())
}
