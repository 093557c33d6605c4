//! `--shard`: one process's part of the frames.

use std::time::Instant;

use super::args::RenderArgs;
use super::frames::FrameRenderer;
use super::job::{KnownModel, distinguished};
use super::styles::Styles;
use super::summary::RenderSummary;
use super::views::views;
use crate::cli::progress::FrameProgress;
use crate::cli::shard::Shard;
use crate::cli::{CliError, CommandOutput};
use crate::output::{FrameLayout, SharedFolder, SharedFrames, Viewpoint};

/// Renders the frames of one shard that are not there yet.
pub fn run(args: &RenderArgs, shard: Shard, start: Instant) -> Result<CommandOutput, CliError> {
    if !args.target()?.is_folder() {
        return Err(CliError::Usage(format!(
            "--shard needs a folder as its output, not {}: tasks cannot share one file",
            args.output.display()
        )));
    }
    let styles = args.read_styles()?;
    let known = KnownModel::load(&args.model, &args.device.open()?)?;
    let views = views(&known.model, &args.views, args.size, args.frames)?;
    let layout = args.layout(styles.names());
    let folder = open(args, &known, &styles, &views, &layout)?;

    let own = || (0..views.len()).filter(|&frame| shard.takes(frame));
    let missing: Vec<usize> = own().filter(|&frame| folder.lacks(frame)).collect();
    if !missing.is_empty() {
        let variants = styles.variants(&known.model, None, &args.settings)?;
        let coats = variants.iter().map(Vec::as_slice);
        let supersampling = args.settings.supersampling;
        let renderer = FrameRenderer::new(&known.model, coats, &layout, supersampling);
        fill(&folder, &missing, &views, &renderer)?;
    }
    let (rendered, kept) = (missing.len(), own().count() - missing.len());
    let complete = folder.finish()?;
    let summary = RenderSummary {
        outputs: &folder.folders,
        views: views.len(),
        styles: &styles,
        synthetic: known.model.file.scene.synthetic,
        seconds: start.elapsed().as_secs_f64(),
    };
    let before = format!("shard {shard}: {rendered} of ");
    let mut output = summary.output(&before, &format!(", {}", state(kept, complete)));
    output.json["shard"] = shard.to_string().into();
    output.json["rendered"] = rendered.into();
    output.json["kept"] = kept.into();
    output.json["complete"] = complete.into();
    Ok(output)
}

/// Takes the folder, or joins those who write to it.
fn open(
    args: &RenderArgs,
    known: &KnownModel,
    styles: &Styles,
    views: &[Viewpoint],
    layout: &FrameLayout,
) -> Result<SharedFolder, CliError> {
    let styles = distinguished(styles);
    let (cameras, job) = known.job(&styles, views, &args.settings, layout, args.depth);
    let contents = SharedFrames {
        layout,
        frames: views.len(),
        depth: args.depth,
        cameras: &cameras,
        job: &job,
    };
    SharedFolder::open(&args.output, &contents)
}

/// Renders frames into the folder, those of the given numbers.
fn fill(
    folder: &SharedFolder,
    missing: &[usize],
    views: &[Viewpoint],
    renderer: &FrameRenderer<'_>,
) -> Result<(), CliError> {
    let mut progress = FrameProgress::new("render", missing.len());
    for &number in missing {
        renderer.one(&views[number], |frame| folder.add(number, &frame))?;
        progress.tick();
    }
    Ok(())
}

/// How the folder stands; `kept` frames of this shard's own were there.
fn state(kept: usize, complete: bool) -> String {
    let kept = match kept {
        0 => String::new(),
        kept => format!("{kept} more were there, "),
    };
    if complete {
        kept + "all frames are there"
    } else {
        kept + "other shards' frames are still to come"
    }
}
