//! `impasto render`.

mod between;
mod job;
mod sharded;
mod styles;
mod views;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use impasto::{Coat, Keep, MaskSpec, Model};
use serde_json::json;

pub use self::job::{KnownModel, distinguished};
pub use self::styles::{Styles, painting};
pub use self::views::{FRAMES, ViewSource, views};
use super::device::DeviceArgs;
use super::progress::Frames;
use super::shard::Shard;
use super::values::{StyleArg, clock, duration, keep, mask, share, size};
use super::{Answer, CliError};
use crate::output::{Frame, Target};

/// Render a model as photographed, or in the style of paintings
///
/// Several styles without weights are rendered side by side from one pass over the geometry: in a
/// folder each has a sub-folder of its name, a GIF becomes one file per style, and a contact sheet
/// has one column per style. Styles with weights (IMAGE:0.7) are mixed into one. With --interpolate,
/// two or four styles span a grid of what lies between them. A file of coats, as the studio saves
/// them, paints several styles over each other, each in a region of its own.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct RenderArgs {
    /// The model's folder
    model: PathBuf,
    /// A painting, with a weight to mix several (IMAGE:0.7); may be repeated
    #[arg(long = "style", value_name = "IMAGE[:WEIGHT]")]
    styles: Vec<StyleArg>,
    /// Coats of paint, one over the other, in place of styles: a JSON file as the studio saves it
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["styles", "strength", "keep", "mask", "refine", "interpolate"])]
    coats: Option<PathBuf>,
    #[command(flatten)]
    settings: RenderSettings,
    /// Let each style's look go on learning from its painting for this long, e.g. 15s, so that it
    /// comes closer: what is rendered at once is a prediction
    #[arg(long, value_name = "TIME", value_parser = duration, requires = "styles")]
    refine: Option<Duration>,
    /// Between two styles N looks in a row, between four N×N in a square, of the first view; PNG only
    #[arg(long, value_name = "N", requires = "styles", conflicts_with_all = ["frames", "depth", "refine"],
          value_parser = clap::value_parser!(u16).range(2..=between::MOST))]
    interpolate: Option<u16>,
    /// Viewpoints: train, test (those of the photos), orbit, spiral, or a camera path's JSON file
    #[arg(long, default_value = "orbit", value_name = "VIEWS")]
    views: ViewSource,
    /// Size of a frame in pixels [default: the photos' as trained]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
    /// Number of frames; of photos' views, this many evenly spaced ones [default: all, or 60]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Write depth too (NumPy float32, along the camera's axis, scene units); folders only
    #[arg(long)]
    depth: bool,
    /// Render only the frames I, I + N, I + 2N … of N tasks' (I from 0) into a folder that they share,
    /// and of those only what is not there yet: for job arrays
    #[arg(long, value_name = "I/N", conflicts_with_all = ["interpolate", "refine"])]
    shard: Option<Shard>,
    #[command(flatten)]
    device: DeviceArgs,
    /// A folder for numbered PNGs and cameras.json, a PNG (contact sheet of all views) or a GIF
    #[arg(short, long, value_name = "DIR|FILE.png|FILE.gif")]
    output: PathBuf,
}

/// How views are rendered.
#[derive(Debug, Clone, Args)]
pub struct RenderSettings {
    /// From the photos' colours (0) to the style's (1)
    #[arg(long, value_name = "0..1", default_value = "1", value_parser = share, requires = "styles")]
    pub strength: f32,
    /// Keep the scene's colours: only lightness is the painting's (luminance, if nothing else is
    /// said), or the paint is moved to the mean and contrast of the scene's own colours (palette)
    #[arg(long = "keep-color", alias = "keep-colour", value_name = "luminance|palette", value_parser = keep,
          num_args = 0..=1, default_missing_value = "luminance", default_value = "none", hide_default_value = true, requires = "styles")]
    pub keep: Keep,
    /// Paint only there: near, far, depth:FROM..TO, box:X,Y,Z,X,Y,Z, sphere:X,Y,Z,RADIUS or
    /// surface:X,Y,Z[,TOLERANCE], in scene units; not:SHAPE is everywhere else
    #[arg(long, value_name = "SHAPE", value_parser = mask, requires = "styles", allow_hyphen_values = true)]
    pub mask: Option<MaskSpec>,
    /// Rays along each side of a pixel: 2 takes four times as long and flickers less
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4))]
    pub supersampling: u32,
}

/// One picture per view is made of each variant.
pub struct Variant {
    name: String,
    /// How the scene is painted.
    pub coats: Vec<Coat>,
}

impl RenderArgs {
    fn read_styles(&self) -> Result<Styles, CliError> {
        match &self.coats {
            Some(path) => Styles::read_coats(path),
            None => Styles::read(&self.styles),
        }
    }
}

/// What variants paint a view with.
pub fn coats(variants: &[Variant]) -> Vec<&[Coat]> {
    variants.iter().map(|v| v.coats.as_slice()).collect()
}

/// Runs the command.
pub fn run(args: &RenderArgs) -> Result<Answer, CliError> {
    let start = Instant::now();
    if let Some(count) = args.interpolate {
        return between::run(args, count.into(), start);
    }
    if let Some(shard) = args.shard {
        return sharded::run(args, shard, start);
    }
    let target = Target::new(&args.output, args.depth)?;
    let styles = args.read_styles()?;
    target.check()?;
    let model = Model::load_on(&args.model, args.device.open()?)?;
    let variants = styles.variants(&model, args.refine, &args.settings)?;
    let names: Vec<String> = variants.iter().map(|v| v.name.clone()).collect();
    let views = views(&model, &args.views, args.size, args.frames)?;

    let coats = coats(&variants);
    let synthetic = model.file.scene.synthetic;
    let mut sink = target.open(&names, synthetic)?;
    let mut progress = Frames::new(views.len());
    for view in &views {
        let rendered = model.render_coats(&view.camera, &coats, args.settings.supersampling);
        sink.add(Frame {
            view,
            pictures: (0..variants.len())
                .map(|look| rendered.image(look))
                .collect(),
            depth: &rendered.depth,
        })?;
        progress.tick();
    }
    drop(progress);
    let outputs = sink.finish()?;
    let seconds = start.elapsed().as_secs_f64();
    let paths: Vec<String> = outputs
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    let kind = if synthetic {
        " of a synthetic scene"
    } else {
        ""
    };
    Ok(Answer {
        text: format!(
            "{} views{kind} in {}: {}",
            views.len(),
            clock(seconds),
            paths.join(", ")
        ),
        json: json!({
            "outputs": paths,
            "views": views.len(),
            "styles": if styles.is_empty() { Vec::new() } else { names },
            "synthetic": synthetic,
            "seconds": seconds,
        }),
    })
}
