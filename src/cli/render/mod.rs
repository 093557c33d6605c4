//! `impasto render`.

mod between;
mod film;
mod frames;
mod job;
mod sharded;
mod styles;
mod views;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use impasto::{Coat, Keep, MaskSpec, Model};
use serde_json::json;

pub use self::film::{FilmOrder, film, film_formats};
pub use self::frames::Rendering;
pub use self::job::{KnownModel, distinguished};
pub use self::styles::{Styles, coats_of};
pub use self::views::{FRAMES, ViewSource, views};
use super::device::DeviceArgs;
use super::ffmpeg::FfmpegArgs;
use super::painting::StyleArg;
use super::progress::Frames;
use super::shard::Shard;
use super::values::{clock, duration, fps, keep, mask, share, size};
use super::{Answer, CliError, interrupt};
use crate::output::{Ffmpeg, Layout, Target, Wanted};

/// Render a model as photographed, or in the style of paintings
///
/// Several styles without weights are rendered side by side from one pass over the geometry: in a
/// folder each has a sub-folder of its name, a film becomes one file per style, and a contact sheet
/// has one column per style; with --side-by-side, each frame shows the original and all styles in a
/// row. Styles with weights (IMAGE:0.7) are mixed into one. With --interpolate, two or four styles
/// span a grid of what lies between them. A file of coats, as the studio saves them, paints several
/// styles over each other, each in a region of its own.
///
/// MP4 (H.264) and WebM (VP9, or AV1) are made by the installed ffmpeg; GIF, PNG and ZIP need
/// nothing. Where a frame's width or height is odd, these films double its last column or row.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct RenderArgs {
    /// The model's folder
    model: PathBuf,
    /// A painting, with a weight to mix several (IMAGE:0.7); may be repeated. random:SEED is the
    /// generated painting of a number
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
    /// Show the scene as photographed on the left of each frame, beside its styles. Depth files, which
    /// have one view's size, are written without it
    #[arg(long, conflicts_with_all = ["depth", "interpolate"])]
    side_by_side: bool,
    /// Frames a second of a film [default: the camera path's own, or else 24, and 12.5 of a GIF]
    #[arg(long, value_name = "N", value_parser = fps, conflicts_with_all = ["interpolate", "shard"])]
    fps: Option<f64>,
    /// Write depth too (NumPy float32, along the camera's axis, scene units); folders only
    #[arg(long)]
    depth: bool,
    /// Render only the frames I, I + N, I + 2N … of N tasks' (I from 0) into a folder that they share,
    /// and of those only what is not there yet: for job arrays
    #[arg(long, value_name = "I/N", conflicts_with_all = ["interpolate", "refine"])]
    shard: Option<Shard>,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    ffmpeg: FfmpegArgs,
    /// A folder for numbered PNGs and cameras.json, the same as a ZIP, a PNG (contact sheet of all
    /// views), or a film
    #[arg(
        short,
        long,
        value_name = "DIR|FILE.png|FILE.mp4|FILE.webm|FILE.gif|FILE.zip"
    )]
    output: PathBuf,
}

/// What an interruption does.
const STOPPING: &str =
    "stopping after this frame, nothing will be written; once more leaves at once";

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
        let styles = match &self.coats {
            Some(path) => Styles::read_coats(path)?,
            None => Styles::read(&self.styles)?,
        };
        if self.side_by_side && styles.is_empty() {
            return Err(CliError::Usage(
                "--side-by-side shows the scene beside its styles: give --style or --coats".into(),
            ));
        }
        Ok(styles)
    }

    fn target(&self) -> Result<Target, CliError> {
        let wanted = Wanted {
            depth: self.depth,
            fps: self.fps,
            path_fps: self.views.fps()?,
            ffmpeg: Ffmpeg::new(&self.ffmpeg.program),
        };
        Target::new(&self.output, &wanted)
    }

    /// What each frame shows of variants of these names.
    fn layout(&self, names: Vec<String>) -> Layout {
        match self.side_by_side {
            true => Layout::side_by_side(names),
            false => Layout::Each(names),
        }
    }
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
    let target = args.target()?;
    let styles = args.read_styles()?;
    target.check()?;
    let model = Model::load_on(&args.model, args.device.open()?)?;
    let variants = styles.variants(&model, args.refine, &args.settings)?;
    let names: Vec<String> = variants.iter().map(|v| v.name.clone()).collect();
    let views = views(&model, &args.views, args.size, args.frames)?;

    let layout = args.layout(names.clone());
    let rendering = Rendering::new(&model, &variants, &layout, args.settings.supersampling);
    let synthetic = model.file.scene.synthetic;
    let sink = target.open(&layout, synthetic)?;
    let stop = interrupt::stop(STOPPING);
    let mut progress = Frames::new(views.len());
    let outputs = rendering.all(&views, sink, &mut |_| progress.tick(), &stop)?;
    drop(progress);
    let seconds = start.elapsed().as_secs_f64();
    let generated = styles.generated(&args.styles);
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
            "{} views{kind} in {}: {}{}",
            views.len(),
            clock(seconds),
            paths.join(", "),
            told(&generated)
        ),
        json: json!({
            "outputs": paths,
            "views": views.len(),
            "styles": if styles.is_empty() { Vec::new() } else { names },
            "generated": generated,
            "synthetic": synthetic,
            "seconds": seconds,
        }),
    })
}

/// A line about paintings that nobody painted.
fn told(generated: &[String]) -> String {
    match generated {
        [] => String::new(),
        labels => format!("\ngenerated paintings: {}", labels.join("; ")),
    }
}
