//! `impasto train-encoder`: the network between a painting and its style code.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use impasto::{
    EncoderCheck, EncoderOptions, Network, StyleInput, StyleVae, cache_folder, check_encoder,
    read_encoder, train_encoder,
};

use super::progress::TrainingProgress;
use super::values::clock;
use super::{CliError, CommandOutput, to_json};
use crate::output::{check_folder, parent, write_file};

/// Train the encoder of styles on paintings of your own, or check one
///
/// The encoder turns a painting's statistics (mean and deviation of the perceptual network's
/// filters) into the 512 numbers from which a model predicts its colours. A built-in one is used
/// unless `train --encoder` names another. Its quality is the share of the variance of paintings
/// that it has not seen which it can rebuild (R²): 1 is perfect.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct TrainEncoderArgs {
    /// Folder of paintings to learn from, sub-folders included
    #[arg(long, value_name = "DIR", required_unless_present = "check")]
    styles: Option<PathBuf>,
    /// File to write the encoder to
    #[arg(short, long, value_name = "FILE", required_unless_present = "check")]
    output: Option<PathBuf>,
    /// Folder of paintings to check it on [default: every 8th painting is held out]
    #[arg(long, value_name = "DIR")]
    heldout: Option<PathBuf>,
    /// Train nothing: check FILE, or the built-in encoder, on the paintings of --heldout
    #[arg(long, value_name = "FILE", num_args = 0..=1, requires = "heldout",
          conflicts_with_all = ["styles", "output", "steps", "generated", "layers", "perceptual", "seed"])]
    check: Option<Option<PathBuf>>,
    /// Number of steps of training
    #[arg(long, value_name = "N", default_value_t = EncoderOptions::STEPS,
          value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Generated pictures to learn from beside the paintings
    #[arg(long, value_name = "N", default_value_t = EncoderOptions::GENERATED)]
    generated: usize,
    /// What it reads of a painting
    #[arg(long, value_enum, default_value = "all")]
    layers: Layers,
    /// The network that measures paintings; vgg19 has to be installed, see `impasto weights`
    #[arg(long, value_enum, default_value = "vgg16")]
    perceptual: PerceptualArg,
    /// Pixels a side of the squares that paintings are measured on: what the model's
    /// style.pictures.side will be
    #[arg(long, value_name = "PIXELS", default_value_t = EncoderOptions::SIDE,
          value_parser = clap::value_parser!(u32).range(16..=1024))]
    side: u32,
    /// Start of the random numbers; the same seed and pictures give the same encoder
    #[arg(long, default_value_t = EncoderOptions::SEED)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Layers {
    /// Statistics of four layers: colours, textures, shapes
    All,
    /// Statistics of the deepest layer alone, as in the paper
    #[value(name = "relu4_1")]
    Relu4_1,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PerceptualArg {
    /// VGG-16, shipped
    Vgg16,
    /// VGG-19, as in the paper
    Vgg19,
}

/// Runs the command.
pub fn run(args: &TrainEncoderArgs) -> Result<CommandOutput, CliError> {
    match (&args.check, &args.styles, &args.output, &args.heldout) {
        (Some(file), _, _, Some(heldout)) => check(file.as_deref(), (heldout, args.side)),
        (None, Some(styles), Some(output), _) => trained(args, styles, output),
        // The command line's own rules leave nothing else.
        _ => Err(CliError::Usage(
            "give --styles and -o to train, or --check and --heldout".into(),
        )),
    }
}

fn check(file: Option<&Path>, heldout: (&Path, u32)) -> Result<CommandOutput, CliError> {
    let vae = match file {
        Some(file) => read_encoder(file)?,
        None => StyleVae::shipped()?,
    };
    let mut progress = TrainingProgress::default();
    let cache = cache_folder();
    let (folder, side) = heldout;
    let check = check_encoder(&vae, folder, side, cache.as_deref(), &mut |event| {
        progress.show(event);
    })?;
    drop(progress);
    let mut json = to_json(&check);
    json["encoder"] = file.map_or("built-in".into(), |file| to_json(&file));
    Ok(CommandOutput {
        text: describe(&check),
        json,
    })
}

fn trained(
    args: &TrainEncoderArgs,
    styles: &Path,
    output: &Path,
) -> Result<CommandOutput, CliError> {
    check_folder(&parent(output))?;
    let options = EncoderOptions {
        styles: styles.to_owned(),
        heldout: args.heldout.clone(),
        steps: args.steps,
        generated: args.generated,
        network: match args.perceptual {
            PerceptualArg::Vgg16 => Network::Vgg16,
            PerceptualArg::Vgg19 => Network::Vgg19,
        },
        input: match args.layers {
            Layers::All => StyleInput::All,
            Layers::Relu4_1 => StyleInput::Relu4_1,
        },
        side: args.side,
        seed: args.seed,
        cache: cache_folder(),
    };
    let mut progress = TrainingProgress::default();
    let (vae, summary) = train_encoder(&options, &mut |event| progress.show(event))?;
    drop(progress);
    let bytes = vae.to_bytes()?;
    write_file(output, &bytes)?;
    let mut json = to_json(&summary);
    json["encoder"] = to_json(&output);
    Ok(CommandOutput {
        text: format!(
            "{}\nof the {} pictures and crops that it learned from: {:.1} %\n\
             trained for {} steps in {}\nencoder: {}",
            describe(&summary.heldout),
            summary.vectors,
            100.0 * summary.explained_of_training,
            summary.steps,
            clock(summary.seconds),
            output.display(),
        ),
        json,
    })
}

fn describe(check: &EncoderCheck) -> String {
    format!(
        "{:.1} % of the variance of {} held-out paintings is rebuilt",
        100.0 * check.explained,
        check.paintings
    )
}
