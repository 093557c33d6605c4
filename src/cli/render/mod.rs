//! `impasto render`.

mod args;
mod between;
mod film;
mod frames;
mod job;
mod settings;
mod sharded;
mod styles;
mod summary;
mod views;

use std::time::Instant;

use impasto::Model;

pub use self::args::RenderArgs;
pub use self::film::{FilmJob, film, film_formats};
pub use self::frames::FrameRenderer;
pub use self::job::{KnownModel, distinguished_mixtures};
pub use self::settings::RenderSettings;
pub use self::styles::{Mixture, Styles, coats_of};
use self::summary::RenderSummary;
pub use self::views::{FRAMES, ViewSource, views};
use super::progress::FrameProgress;
use super::{CliError, CommandOutput, interrupt};

/// What an interruption does.
const STOPPING: &str =
    "stopping after this frame, nothing will be written; once more leaves at once";

/// Runs the command.
pub fn run(args: &RenderArgs) -> Result<CommandOutput, CliError> {
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
    let model = Model::load_on(&args.model, &args.device.open()?)?;
    let variants = styles.variants(&model, args.refinement(), &args.settings)?;
    let views = views(&model, &args.views, args.size, args.frames)?;

    let layout = args.layout(styles.names());
    let coats = variants.iter().map(Vec::as_slice);
    let renderer = FrameRenderer::new(&model, coats, &layout, args.settings.supersampling);
    let synthetic = model.file.scene.synthetic;
    let sink = target.open(&layout, synthetic)?;
    let stop = interrupt::stop(STOPPING);
    let mut progress = FrameProgress::new("render", views.len());
    let outputs = renderer.all(&views, sink, &mut |_| progress.tick(), &stop)?;
    drop(progress);
    let summary = RenderSummary {
        outputs: &outputs,
        views: views.len(),
        styles: &styles,
        synthetic,
        seconds: start.elapsed().as_secs_f64(),
    };
    Ok(summary.output("", ""))
}
