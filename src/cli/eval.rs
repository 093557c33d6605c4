//! `impasto eval`: how faithful a model's styles are.

use std::path::PathBuf;

use clap::Args;
use impasto::eval::style_fidelity;
use impasto::{Model, read_paintings};
use serde_json::json;

use super::{Answer, CliError, to_json};

/// Measure how well a model takes on paintings it never saw
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// A model folder
    model: PathBuf,
    /// Folder of paintings, sub-folders included, best ones that the model was not trained on
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
}

/// Runs the command.
pub fn run(args: &EvalArgs) -> Result<Answer, CliError> {
    let model = Model::load(&args.model)?;
    let read = read_paintings(&args.styles).map_err(|source| CliError::Read {
        path: args.styles.clone(),
        source,
    })?;
    let fidelity = style_fidelity(&model, &read.named)?;
    let quality = model.file.quality;
    let mut text = format!(
        "reconstruction: PSNR {:.2} dB, SSIM {:.3} over {} held-out views\n\
         style: gain {:.3}, retrieval {:.1} % over {} paintings × {} views",
        quality.psnr,
        quality.ssim,
        quality.views,
        fidelity.style_gain,
        fidelity.retrieval * 100.0,
        fidelity.paintings.len(),
        fidelity.views,
    );
    if !read.unreadable.is_empty() {
        let count = read.unreadable.len();
        text += &format!("\n{count} files of the style folder are no readable pictures");
    }
    Ok(Answer {
        text,
        json: json!({
            "synthetic": model.file.scene.synthetic,
            "unreadable": read.unreadable.iter().map(|(path, _)| path).collect::<Vec<_>>(),
            "reconstruction": to_json(&quality),
            "methods": { "impasto": to_json(&fidelity) },
        }),
    })
}
