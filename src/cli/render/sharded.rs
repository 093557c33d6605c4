//! `--shard`: one process's part of the frames.

use std::time::Instant;

use impasto::Model;
use serde_json::json;

use super::job::{KnownModel, distinguished};
use super::styles::Styles;
use super::{RenderArgs, Rendering, told, views};
use crate::cli::progress::Frames;
use crate::cli::shard::Shard;
use crate::cli::values::clock;
use crate::cli::{Answer, CliError};
use crate::output::{Contents, Layout, SharedFolder, View};

/// What one process did.
struct Done {
    rendered: usize,
    /// Frames of its own that were there.
    kept: usize,
    /// Whether all processes' frames are there.
    complete: bool,
}

/// Renders the frames of one shard that are not there yet.
pub fn run(args: &RenderArgs, shard: Shard, start: Instant) -> Result<Answer, CliError> {
    if !args.target()?.is_folder() {
        return Err(CliError::Usage(format!(
            "--shard needs a folder as its output, not {}: tasks cannot share one file",
            args.output.display()
        )));
    }
    let styles = args.read_styles()?;
    let known = KnownModel::load(&args.model, args.device.open()?)?;
    let model = &known.model;
    let views = views(model, &args.views, args.size, args.frames)?;
    let distinguished = distinguished(&styles);
    let names: Vec<String> = styles.wanted().into_iter().map(|(name, _)| name).collect();
    let layout = args.layout(names.clone());
    let shown = (&layout, args.depth);
    let (cameras, job) = known.job(&distinguished, &views, &args.settings, shown);
    let folder = SharedFolder::open(
        &args.output,
        &Contents {
            variants: layout.variants(),
            frames: views.len(),
            depth: args.depth,
            cameras: &cameras,
            job: &job,
        },
    )?;

    let own = || (0..views.len()).filter(|&frame| shard.takes(frame));
    let missing: Vec<usize> = own().filter(|&frame| folder.lacks(frame)).collect();
    fill(&folder, &missing, &views, (model, &styles, &layout), args)?;
    let done = Done {
        rendered: missing.len(),
        kept: own().count() - missing.len(),
        complete: folder.finish()?,
    };
    let outputs = folder.folders();
    let paths = outputs.iter().map(|path| path.display().to_string());
    let paths: Vec<String> = paths.collect();
    let synthetic = model.file.scene.synthetic;
    let kind = match synthetic {
        true => " of a synthetic scene",
        false => "",
    };
    let generated = styles.generated(&args.styles);
    let seconds = start.elapsed().as_secs_f64();
    Ok(Answer {
        text: format!(
            "shard {shard}: {} of {} views{kind} in {}, {}: {}{}",
            done.rendered,
            views.len(),
            clock(seconds),
            state(&done),
            paths.join(", "),
            told(&generated)
        ),
        json: json!({
            "outputs": paths,
            "views": views.len(),
            "shard": shard.to_string(),
            "rendered": done.rendered,
            "kept": done.kept,
            "complete": done.complete,
            "styles": if styles.is_empty() { Vec::new() } else { names },
            "generated": generated,
            "synthetic": synthetic,
            "seconds": seconds,
        }),
    })
}

/// Renders frames into the folder, those of the given numbers.
fn fill(
    folder: &SharedFolder,
    missing: &[usize],
    views: &[View],
    (model, styles, layout): (&Model, &Styles, &Layout),
    args: &RenderArgs,
) -> Result<(), CliError> {
    if missing.is_empty() {
        return Ok(());
    }
    let variants = styles.variants(model, None, &args.settings)?;
    let rendering = Rendering::new(model, &variants, layout, args.settings.supersampling);
    let mut progress = Frames::new(missing.len());
    for &number in missing {
        rendering.one(&views[number], |frame| folder.add(number, &frame))?;
        progress.tick();
    }
    Ok(())
}

fn state(done: &Done) -> String {
    let kept = match done.kept {
        0 => String::new(),
        kept => format!("{kept} more were there, "),
    };
    let rest = match done.complete {
        true => "all frames are there",
        false => "other shards' frames are still to come",
    };
    kept + rest
}
