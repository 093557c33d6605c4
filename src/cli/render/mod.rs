//! `impasto render`.

mod between;
mod job;
mod sharded;
mod styles;
mod views;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use impasto::scene::Camera;
use impasto::{Look, Model, RenderedView};
use serde_json::json;

pub use self::job::{KnownModel, distinguished};
pub use self::styles::{Styles, painting};
pub use self::views::{FRAMES, ViewSource, views};
use super::device::DeviceArgs;
use super::progress::Frames;
use super::shard::Shard;
use super::values::{StyleArg, clock, duration, share, size};
use super::{Answer, CliError};
use crate::output::{Frame, Target, picture};

/// Render a model as photographed, or in the style of paintings
///
/// Several styles without weights are rendered side by side from one pass over the geometry: in a
/// folder each has a sub-folder of its name, a GIF becomes one file per style, and a contact sheet
/// has one column per style. Styles with weights (IMAGE:0.7) are mixed into one. With --interpolate,
/// two or four styles span a grid of what lies between them.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct RenderArgs {
    /// The model's folder
    model: PathBuf,
    /// A painting, with a weight to mix several (IMAGE:0.7); may be repeated
    #[arg(long = "style", value_name = "IMAGE[:WEIGHT]")]
    styles: Vec<StyleArg>,
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
#[derive(Debug, Clone, Copy, Args)]
pub struct RenderSettings {
    /// From the photos' colours (0) to the style's (1)
    #[arg(long, value_name = "0..1", default_value = "1", value_parser = share, requires = "styles")]
    pub strength: f32,
    /// Rays along each side of a pixel: 2 takes four times as long and flickers less
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4))]
    pub supersampling: u32,
}

/// One picture per view is made of each variant.
pub struct Variant {
    name: String,
    /// How it colours the scene.
    pub look: Look,
}

/// Renders a view with every look, moved towards the photo's where `--strength` is below 1.
pub fn render(
    model: &Model,
    camera: &Camera,
    looks: &[&Look],
    settings: &RenderSettings,
) -> RenderedView {
    let (strength, side) = (settings.strength, settings.supersampling);
    if strength >= 1.0 {
        return model.render_smooth(camera, looks, side);
    }
    let photo = model.photo_look();
    let looks = [looks, &[&photo]].concat();
    let mut rendered = model.render_smooth(camera, &looks, side);
    if let Some(photo) = rendered.pixels.pop() {
        for styled in &mut rendered.pixels {
            picture::blend(&photo, styled, strength);
        }
    }
    rendered
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
    let styles = Styles::read(&args.styles)?;
    target.check()?;
    let model = Model::load_on(&args.model, args.device.open()?)?;
    let variants = styles.variants(&model, args.refine)?;
    let names: Vec<String> = variants.iter().map(|v| v.name.clone()).collect();
    let views = views(&model, &args.views, args.size, args.frames)?;

    let looks: Vec<&Look> = variants.iter().map(|v| &v.look).collect();
    let synthetic = model.file.scene.synthetic;
    let mut sink = target.open(&names, synthetic)?;
    let mut progress = Frames::new(views.len());
    for view in &views {
        let rendered = render(&model, &view.camera, &looks, &args.settings);
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
