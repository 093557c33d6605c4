//! The arguments of `impasto render`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::settings::RenderSettings;
use super::styles::{RefineRequest, Styles};
use super::views::ViewSource;
use crate::cli::CliError;
use crate::cli::device::DeviceArgs;
use crate::cli::ffmpeg::FfmpegArgs;
use crate::cli::painting::StyleArg;
use crate::cli::shard::Shard;
use crate::cli::values::{duration, fps, size};
use crate::output::{FfmpegProgram, FrameLayout, Target, TargetOptions, check_folder, parent};

/// Most looks along a side of what `--interpolate` renders: all of them are rendered at once.
const MOST_LOOKS: i64 = 12;

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
    pub model: PathBuf,
    /// A painting, with a weight to mix several (IMAGE:0.7); may be repeated. random:SEED is the
    /// generated painting of a number
    #[arg(long = "style", value_name = "IMAGE[:WEIGHT]", group = "paint")]
    pub styles: Vec<StyleArg>,
    /// A look that --save-look has kept, of this place or of another one
    #[arg(long, value_name = "FILE.safetensors", group = "paint", conflicts_with_all = ["refine", "interpolate"])]
    pub look: Option<PathBuf>,
    /// Coats of paint, one over the other, in place of styles: a JSON file as the studio saves it
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["styles", "look", "strength", "stroke_size", "stroke_strength", "keep", "mask", "refine", "interpolate"])]
    pub coats: Option<PathBuf>,
    #[command(flatten)]
    pub settings: RenderSettings,
    /// Let each style's look go on learning from its painting for this long, e.g. 15s, so that it
    /// comes closer: what is rendered at once is a prediction
    #[arg(long, value_name = "TIME", value_parser = duration, requires = "styles")]
    pub refine: Option<Duration>,
    /// Keep the refined look in a file, for --look: of one style, or of one mix
    #[arg(long, value_name = "FILE.safetensors", requires = "refine")]
    pub save_look: Option<PathBuf>,
    /// Between two styles N looks in a row, between four N×N in a square, of the first view; PNG only
    #[arg(long, value_name = "N", requires = "styles", conflicts_with_all = ["frames", "depth", "refine"],
          value_parser = clap::value_parser!(u16).range(2..=MOST_LOOKS))]
    pub interpolate: Option<u16>,
    /// Viewpoints: train, test (those of the photos), orbit, spiral, or a camera path's JSON file
    #[arg(long, default_value = "orbit", value_name = "VIEWS")]
    pub views: ViewSource,
    /// Size of a frame in pixels [default: the photos' as trained]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    /// Number of frames; of photos' views, this many evenly spaced ones [default: all, or 60]
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Show the scene as photographed on the left of each frame, beside its styles. Depth files, which
    /// have one view's size, are written without it
    #[arg(long, conflicts_with_all = ["depth", "interpolate"])]
    pub side_by_side: bool,
    /// Frames a second of a film [default: the camera path's own, or else 24, and 12.5 of a GIF]
    #[arg(long, value_name = "N", value_parser = fps, conflicts_with_all = ["interpolate", "shard"])]
    pub fps: Option<f64>,
    /// Write depth too (NumPy float32, along the camera's axis, scene units); folders only
    #[arg(long)]
    pub depth: bool,
    /// Render only the frames I, I + N, I + 2N … of N tasks' (I from 0) into a folder that they share,
    /// and of those only what is not there yet: for job arrays
    #[arg(long, value_name = "I/N", conflicts_with_all = ["interpolate", "refine"])]
    pub shard: Option<Shard>,
    #[command(flatten)]
    pub device: DeviceArgs,
    #[command(flatten)]
    pub ffmpeg: FfmpegArgs,
    /// A folder for numbered PNGs and cameras.json, the same as a ZIP, a PNG (contact sheet of all
    /// views), or a film
    #[arg(
        short,
        long,
        value_name = "DIR|FILE.png|FILE.mp4|FILE.webm|FILE.gif|FILE.zip"
    )]
    pub output: PathBuf,
}

impl RenderArgs {
    /// Reads the paintings.
    pub fn read_styles(&self) -> Result<Styles, CliError> {
        let styles = Styles::load(&self.styles, self.coats.as_deref(), self.look.as_deref())?;
        if self.side_by_side && styles.is_empty() {
            return Err(CliError::Usage(
                "--side-by-side shows the scene beside its styles: give --style or --coats".into(),
            ));
        }
        if let Some(path) = &self.save_look {
            check_folder(&parent(path))?;
            if styles.names().len() > 1 {
                return Err(CliError::Usage(
                    "--save-look keeps one look: give one --style, or all of them weights".into(),
                ));
            }
        }
        Ok(styles)
    }

    /// How looks are refined, where they are.
    pub fn refinement(&self) -> Option<RefineRequest<'_>> {
        let save = self.save_look.as_deref();
        self.refine.map(|time| RefineRequest { time, save })
    }

    /// Where the frames go.
    pub fn target(&self) -> Result<Target, CliError> {
        let wanted = TargetOptions {
            depth: self.depth,
            fps: self.fps,
            path_fps: self.views.fps()?,
            ffmpeg: FfmpegProgram::new(&self.ffmpeg.program),
        };
        Target::new(&self.output, &wanted)
    }

    /// What each frame shows of variants of these names.
    pub fn layout(&self, names: Vec<String>) -> FrameLayout {
        FrameLayout::new(names, self.side_by_side)
    }
}
