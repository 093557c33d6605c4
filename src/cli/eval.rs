//! `impasto eval`: how faithful a model's styles are, and how well its frames agree.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use impasto::eval::consistency::Consistency;
use impasto::eval::methods::{Stylizer, Wct};
use impasto::eval::{EvalOptions, Evaluation, MethodResult, evaluate};
use impasto::scene::paths::orbit;
use impasto::scene::{Camera, Split};
use impasto::{Model, read_paintings};
use serde_json::json;

use super::{Answer, CliError, progress, to_json};

/// Measure how well a model takes on paintings it never saw, and how well its frames agree
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// A model folder
    model: PathBuf,
    /// Folder of paintings, sub-folders included, best ones that the model was not trained on
    #[arg(long, value_name = "DIR")]
    styles: PathBuf,
    /// Methods to compare with: wct
    #[arg(long, value_name = "METHODS", value_delimiter = ',', value_enum)]
    against: Vec<Against>,
    /// Networks of wct, distilled to a 16th, as a safetensors file
    #[arg(long, value_name = "FILE", required_if_eq("against", "wct"))]
    wct_weights: Option<PathBuf>,
    /// Frames of the orbit on which consistency is measured; 0 leaves it out
    #[arg(long, value_name = "N", default_value_t = 60)]
    frames: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Against {
    /// Whitening and colouring at four levels, frame by frame, and as a video
    Wct,
}

/// Longest side of the walk's frames.
const LONGEST: u32 = 400;

/// Runs the command.
pub fn run(args: &EvalArgs) -> Result<Answer, CliError> {
    let model = Model::load(&args.model)?;
    let read = read_paintings(&args.styles).map_err(|source| CliError::Read {
        path: args.styles.clone(),
        source,
    })?;
    let path = walk(&model, args.frames)?;
    let wct = match (&args.wct_weights, args.against.contains(&Against::Wct)) {
        (Some(file), true) => Some(Wct::open(file)?),
        _ => None,
    };
    let against: Vec<&dyn Stylizer> = wct.iter().map(|wct| wct as &dyn Stylizer).collect();
    let options = EvalOptions {
        paintings: &read.named,
        path: &path,
        against: &against,
    };
    let mut bar = progress::Frames::new(options.frames());
    let evaluation = evaluate(&model, &options, &mut || bar.tick())?;
    drop(bar);
    let quality = model.file.quality;
    let mut text = format!(
        "reconstruction: PSNR {:.2} dB, SSIM {:.3} over {} held-out views\n{}",
        quality.psnr,
        quality.ssim,
        quality.views,
        table(&evaluation),
    );
    if !read.unreadable.is_empty() {
        let count = read.unreadable.len();
        text += &format!("\n{count} files of the style folder are no readable pictures");
    }
    let mut json = to_json(&evaluation);
    json["synthetic"] = json!(model.file.scene.synthetic);
    json["unreadable"] = json!(read.unreadable.iter().map(|(p, _)| p).collect::<Vec<_>>());
    json["reconstruction"] = to_json(&quality);
    Ok(Answer { text, json })
}

/// Cameras around the scene, in small frames of the photos' shape.
fn walk(model: &Model, frames: usize) -> Result<Vec<Camera>, CliError> {
    let train = model.file.scene.cameras(Split::Train);
    let Some(first) = train.first().filter(|_| frames > 0) else {
        return Ok(Vec::new());
    };
    let (width, height) = (first.intrinsics.width, first.intrinsics.height);
    let scale = (f64::from(LONGEST) / f64::from(width.max(height))).min(1.0);
    let size = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    Ok(orbit(&train, frames, (size[0], size[1]))?)
}

fn table(evaluation: &Evaluation) -> String {
    let mut lines = Vec::new();
    for (name, result) in &evaluation.methods {
        let MethodResult { fidelity, .. } = result;
        let mut line = format!(
            "{name}: style gain {:.3}, retrieval {:.1} %, content {:.2}, over {} paintings × {} views",
            fidelity.style_gain,
            fidelity.retrieval * 100.0,
            fidelity.content_loss,
            fidelity.paintings.len(),
            fidelity.views,
        );
        if let (Some(short), Some(long), Some(sharpness)) =
            (result.short, result.long, result.sharpness)
        {
            line += &format!(
                "\n  consistency E×100 {} short, {} long, sharpness {sharpness:.2}",
                agreement(&short),
                agreement(&long),
            );
        }
        lines.push(line);
    }
    lines.join("\n")
}

/// E × 100 and what it was measured on.
fn agreement(found: &Consistency) -> String {
    if found.pairs == 0 {
        return "– (no pair shares enough)".into();
    }
    format!(
        "{:.3} ({:.0} % of pixels)",
        found.e100,
        found.coverage * 100.0
    )
}
