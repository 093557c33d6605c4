//! `impasto export`.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use impasto::Model;
use impasto::export::{Exported, ViewSelection, Views, Watch, export_points, export_splats};
use serde_json::json;

use super::device::DeviceArgs;
use super::painting::StyleArg;
use super::progress::TimedBar;
use super::render::{RenderSettings, Styles};
use super::values::{clock, has_ending, size};
use super::{CliError, CommandOutput, interrupt, of_synthetic};
use crate::output::{check_folder, parent};

/// Export a model's surfaces, as photographed or painted, for other programs
///
/// Splats are 3-D Gaussians (.ply as 3DGS programs read it: names and order of its properties,
/// colours as f_dc without f_rest), fitted to the model's pictures, the sky included. Points are a
/// cloud with normals and colours (.ply for Blender, MeshLab, CloudCompare). Coordinates are those of
/// the capture's camera poses.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct ExportArgs {
    /// The model's folder
    model: PathBuf,
    /// A painting; several are mixed by their weights (IMAGE:0.7)
    #[arg(long = "style", value_name = "IMAGE[:WEIGHT]", group = "paint")]
    styles: Vec<StyleArg>,
    /// A look that `impasto render --save-look` has kept
    #[arg(long, value_name = "FILE.safetensors", group = "paint")]
    look: Option<PathBuf>,
    /// Coats of paint, one over the other, in place of styles: a JSON file as the studio saves it
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["styles", "look", "strength", "stroke_size", "stroke_strength", "keep", "mask"])]
    coats: Option<PathBuf>,
    #[command(flatten)]
    settings: RenderSettings,
    /// What is exported
    #[arg(long, value_enum, default_value_t)]
    kind: Kind,
    /// Most views that surfaces are looked at from, evenly spaced among the training views
    /// [default: 48]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    views: Option<u32>,
    /// Size of these views in pixels; the larger, the denser the export [default: the photos' as
    /// trained, at most 200,000 pixels]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
    #[command(flatten)]
    device: DeviceArgs,
    /// The file
    #[arg(short, long, value_name = "FILE.ply")]
    output: PathBuf,
}

/// What files hold.
#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum Kind {
    /// 3-D Gaussians
    #[default]
    Splats,
    /// Points with normals and colours
    Points,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Splats => "splats",
            Self::Points => "points",
        }
    }
}

/// Runs the command.
pub fn run(args: &ExportArgs) -> Result<CommandOutput, CliError> {
    let start = Instant::now();
    if !has_ending(&args.output, "ply") {
        return Err(CliError::Usage(
            "an export is one file: give -o FILE.ply".into(),
        ));
    }
    if args.styles.len() > 1 && args.styles.iter().all(|style| style.weight.is_none()) {
        return Err(CliError::Usage(
            "an export has one look: give each --style a weight (IMAGE:0.5) to mix them".into(),
        ));
    }
    let styles = Styles::load(&args.styles, args.coats.as_deref(), args.look.as_deref())?;
    check_folder(&parent(&args.output))?;
    let model = Model::load_on(&args.model, &args.device.open()?)?;
    let mut variants = styles.variants(&model, None, &args.settings)?;
    let coats = variants.pop().unwrap_or_default();

    let mut bar = TimedBar::new("export");
    let mut progress = |what: &'static str, share: f64| bar.show(share, what);
    let stop = interrupt::stop("stopping; nothing is written; once more leaves at once");
    let mut watch = Watch {
        progress: &mut progress,
        stop: &stop,
    };
    let options = ViewSelection {
        views: args.views.map(|views| views as usize),
        size: args.size,
    };
    let views = Views::of_model(&model, &coats, &options, &mut watch)?;
    let exported = match args.kind {
        Kind::Splats => export_splats(&views, &args.output, &mut watch)?,
        Kind::Points => export_points(&views, &args.output, &mut watch)?,
    };
    drop(bar);
    let seconds = start.elapsed().as_secs_f64();
    Ok(output(args, &views, &exported, seconds))
}

fn output(args: &ExportArgs, views: &Views, exported: &Exported, seconds: f64) -> CommandOutput {
    let synthetic = views.synthetic;
    let kind = of_synthetic(synthetic);
    let quality = exported.psnr.map_or(String::new(), |psnr| {
        format!(", {psnr:.1} dB from the model's own pictures")
    });
    CommandOutput {
        text: format!(
            "{} {}{kind} ({:.1} MB{quality}) in {}: {}",
            exported.count,
            args.kind.name(),
            exported.bytes as f64 / 1e6,
            clock(seconds),
            args.output.display()
        ),
        json: json!({
            "outputs": [args.output],
            "kind": args.kind.name(),
            "count": exported.count,
            "bytes": exported.bytes,
            "psnr": exported.psnr,
            "views": views.len(),
            "synthetic": synthetic,
            "seconds": seconds,
        }),
    }
}
