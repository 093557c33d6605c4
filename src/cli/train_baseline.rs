//! `impasto train-baseline`: the networks of methods to compare with.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use image::RgbImage;
use impasto::eval::training::{AdaInReport, AdaInTraining, train_adain};
use impasto::read_paintings;
use serde_json::json;

use super::progress::TimedBar;
use super::values::clock;
use super::{CliError, CommandOutput, to_json};
use crate::output::{check_folder, parent, write_file};

/// Train the network of a method that `eval` compares with
///
/// AdaIN's decoder makes pictures of VGG-16's features. A built-in one, made with the default
/// settings, is used unless `eval --adain-weights` names another.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct TrainBaselineArgs {
    /// The method
    #[arg(value_enum)]
    method: Baseline,
    /// Folder of photos to repaint, sub-folders included
    #[arg(long, value_name = "DIR")]
    photos: PathBuf,
    /// Folder of paintings to learn from, sub-folders included
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
    /// File to write the network to
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Number of steps of training
    #[arg(long, value_name = "N", default_value_t = AdaInTraining::default().steps,
          value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Start of the random numbers; the same seed and pictures give the same network
    #[arg(long, default_value_t = AdaInTraining::default().seed)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Baseline {
    /// Adaptive instance normalisation (Huang & Belongie 2017)
    Adain,
}

/// Steps that reported losses are the mean of, about.
const SMOOTH: f32 = 50.0;

/// Runs the command.
pub fn run(args: &TrainBaselineArgs) -> Result<CommandOutput, CliError> {
    let Baseline::Adain = args.method;
    check_folder(&parent(&args.output))?;
    let (photos, paintings) = (pictures(&args.photos)?, pictures(&args.styles)?);
    let training = AdaInTraining {
        steps: args.steps,
        seed: args.seed,
        ..AdaInTraining::default()
    };
    let start = Instant::now();
    let mut bar = TimedBar::new("decoder");
    let mut mean: Option<AdaInReport> = None;
    let bytes = train_adain(&photos, &paintings, &training, &mut |step, now| {
        let before = mean.unwrap_or(now);
        let smooth = |before: f32, now: f32| before + (now - before) / SMOOTH;
        let smoothed = AdaInReport {
            content: smooth(before.content, now.content),
            style: smooth(before.style, now.style),
        };
        mean = Some(smoothed);
        let AdaInReport { content, style } = smoothed;
        let measures = format!("content {content:.3}  style {style:.4}");
        bar.show_step(step + 1, args.steps, &measures);
    })?;
    drop(bar);
    write_file(&args.output, &bytes)?;
    let AdaInReport { content, style } = mean.unwrap_or_default();
    let seconds = start.elapsed().as_secs_f64();
    Ok(CommandOutput {
        text: format!(
            "trained for {} steps in {}: content {content:.3}, style {style:.4}\ndecoder: {}",
            args.steps,
            clock(seconds),
            args.output.display(),
        ),
        json: json!({
            "method": "adain",
            "steps": args.steps,
            "seconds": seconds,
            "content": content,
            "style": style,
            "photos": photos.len(),
            "paintings": paintings.len(),
            "output": to_json(&args.output),
        }),
    })
}

/// All readable pictures of a folder.
fn pictures(dir: &Path) -> Result<Vec<RgbImage>, CliError> {
    let read = read_paintings(dir).map_err(CliError::read(dir))?;
    if read.named.is_empty() {
        return Err(CliError::Refused(format!(
            "{}: holds no readable picture; give a folder of PNG or JPEG files",
            dir.display()
        )));
    }
    Ok(read.named.into_iter().map(|(_, image)| image).collect())
}
