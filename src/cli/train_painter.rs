//! `impasto train-painter`: the painter that models come with.

use std::path::PathBuf;

use clap::Args;
use impasto::{PainterOptions, cache_folder, train_painter};

use super::device::DeviceArgs;
use super::progress::TrainingProgress;
use super::settings;
use super::train::{BudgetArgs, Preset};
use super::values::clock;
use super::{CliError, CommandOutput, to_json};
use crate::output::{check_folder, parent, write_file};

/// Learn a painter on several scenes, for all others
///
/// A painter is what a model paints with: a hypernetwork from a painting's style code to the weights of
/// a small network, which says how much of the painting's own detail goes where. It sees nothing
/// that is one scene's own. A built-in one comes with every model.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct TrainPainterArgs {
    /// Models whose scenes are painted; only their geometry is used
    #[arg(long, value_name = "MODEL", required = true, num_args = 1..)]
    scenes: Vec<PathBuf>,
    /// Folder of paintings to learn from, sub-folders included
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
    /// File to write the painter to, every two minutes and at the end
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Painter to go on from [default: random weights]
    #[arg(long, value_name = "FILE")]
    init: Option<PathBuf>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Start of the random numbers; the same seed, steps and files give the same painter
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Set one value, as of `impasto train`, e.g. style.content_weight=2; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Runs the command.
pub fn run(args: &TrainPainterArgs) -> Result<CommandOutput, CliError> {
    check_folder(&parent(&args.output))?;
    let options = PainterOptions {
        scenes: args.scenes.clone(),
        styles: args.styles.clone(),
        init: args.init.clone(),
        config: settings::configure(&Preset::Fast.config(), None, &args.set)?,
        budget: args.budget.get_or(BudgetArgs::DEFAULT),
        seed: args.seed,
        cache: cache_folder(),
        device: args.device.open()?,
    };
    let mut progress = TrainingProgress::default();
    let mut keep = |painter: &impasto::StyleModel| -> Result<(), CliError> {
        write_file(&args.output, &painter.to_bytes()?)?;
        Ok(())
    };
    let summary = train_painter(&options, &mut keep, &mut |event| progress.show(event))?;
    drop(progress);
    let mut json = to_json(&summary);
    json["painter"] = to_json(&args.output);
    Ok(CommandOutput {
        text: format!(
            "{} updates on {} scenes and {} pictures in {}: content {:.3}, style {:.3}\npainter: {}",
            summary.steps,
            summary.scenes,
            summary.pictures,
            clock(summary.seconds),
            summary.content,
            summary.style,
            args.output.display(),
        ),
        json,
    })
}
