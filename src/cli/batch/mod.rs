//! `impasto batch`: scenes × styles × views, as a file lists them.

mod file;
mod plan;
mod render;
mod report;
mod train;

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use impasto::Device;
use serde_json::json;

use self::plan::BatchPlan;
use self::report::BatchReport;
use super::device::DeviceArgs;
use super::shard::Shard;
use super::{CliError, CommandOutput};

/// Train models and render them in many styles from many views, as a TOML file lists them
///
/// What is done already is left as it is, so that the same command goes on where it was stopped;
/// what fails does not keep the rest from being done. With --shard, several tasks share the work;
/// docs/cluster.md describes the file and how job arrays run it.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct BatchArgs {
    /// The file with [[train]] and [[render]] tables; paths in it start where it is
    #[arg(value_name = "JOBS.toml")]
    jobs: PathBuf,
    /// Do the part of the I-th (from 0) of N tasks
    #[arg(long, value_name = "I/N", default_value_t = Shard::WHOLE)]
    shard: Shard,
    /// Do only this: renders of models that other tasks train have to wait for them
    #[arg(long, value_enum)]
    only: Option<Part>,
    /// Print the items and their numbers, and do nothing
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Part {
    /// The models
    Train,
    /// The frames
    Render,
}

impl BatchArgs {
    fn includes(&self, part: Part) -> bool {
        self.only.is_none_or(|only| only == part)
    }
}

/// Runs the command.
pub fn run(args: &BatchArgs) -> Result<CommandOutput, CliError> {
    let start = Instant::now();
    let plan = BatchPlan::new(file::read(&args.jobs)?, &args.jobs)?;
    if args.list {
        return Ok(list(&plan, args));
    }
    let device = args.device.open()?;
    let mut report = BatchReport::default();
    if args.includes(Part::Train) {
        train_models(&plan, args.shard, &device, &mut report);
    }
    if args.includes(Part::Render) {
        render_models(&plan, args.shard, &device, &mut report);
    }
    let output = report.output(args.shard, start.elapsed().as_secs_f64());
    if report.is_clean() {
        Ok(output)
    } else {
        Err(CliError::SomeFailed(Box::new(output)))
    }
}

fn train_models(plan: &BatchPlan, shard: Shard, device: &Device, report: &mut BatchReport) {
    for (number, table) in plan.trains.iter().enumerate() {
        if !shard.takes(number) {
            continue;
        }
        let model = table.model.as_path();
        let trained = train::is_done(table).and_then(|done| {
            let train = || train::train(table, device.clone());
            (!done).then(train).transpose()
        });
        match trained {
            Ok(None) => report.kept(model),
            Ok(Some(summary)) => report.trained(model, &summary),
            Err(error) => report.fail(number, model, &error),
        }
    }
}

fn render_models(plan: &BatchPlan, shard: Shard, device: &Device, report: &mut BatchReport) {
    for work in &plan.models {
        let table = plan.trains.iter().find(|table| table.model == work.path);
        let rendered = table.map_or(Ok(true), train::is_done).and_then(|trained| {
            if trained {
                return render::run(work, shard, device, report);
            }
            Err(CliError::Refused(format!(
                "the model {} is not trained yet",
                work.path.display()
            )))
        });
        if let Err(error) = rendered {
            report.all_failed(work.items(), &error);
        }
    }
}

/// The items that a shard has a part in.
fn list(plan: &BatchPlan, args: &BatchArgs) -> CommandOutput {
    let (mut lines, mut items) = (Vec::new(), Vec::new());
    if args.includes(Part::Train) {
        for (number, table) in plan.trains.iter().enumerate() {
            if args.shard.takes(number) {
                let (scene, model) = (table.scene.display(), table.model.display());
                lines.push(format!("{number:>5}  train   {model}  from {scene}"));
                items.push(json!({
                    "item": number, "kind": "train", "scene": table.scene, "output": table.model,
                }));
            }
        }
    }
    for work in plan.models.iter().filter(|_| args.includes(Part::Render)) {
        for group in &work.groups {
            let frames = group.known_frames();
            let count = match frames {
                Some(frames) => format!("{frames} frames"),
                None => "as many frames as there are views".into(),
            };
            let block = frames.map(|n| args.shard.block(n * group.items.len(), group.turn));
            if block.is_some_and(|block| block.is_empty()) {
                continue;
            }
            for item in &group.items {
                let style = &work.styles[item.style].name;
                lines.push(format!(
                    "{:>5}  render  {}  in {style} from {}, {count}",
                    item.number,
                    item.output.display(),
                    group.name
                ));
                items.push(json!({
                    "item": item.number, "kind": "render", "model": work.path, "style": style,
                    "views": group.name, "frames": frames, "output": item.output,
                }));
            }
        }
    }
    let text = if lines.is_empty() {
        "nothing for this task".into()
    } else {
        lines.join("\n")
    };
    CommandOutput {
        text,
        json: json!({"shard": args.shard.to_string(), "items": items}),
    }
}
