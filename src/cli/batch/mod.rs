//! `impasto batch`: scenes × styles × views, as a file lists them.

mod file;
mod plan;
mod render;
mod train;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use impasto::Device;
use serde_json::{Value, json};

use self::plan::{Plan, RenderItem};
use super::device::DeviceArgs;
use super::shard::Shard;
use super::values::clock;
use super::{Answer, CliError, console};

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
pub fn run(args: &BatchArgs) -> Result<Answer, CliError> {
    let start = Instant::now();
    let plan = Plan::new(file::read(&args.jobs)?, &args.jobs)?;
    if args.list {
        return Ok(list(&plan, args));
    }
    let device = args.device.open()?;
    let mut report = Report::default();
    if args.includes(Part::Train) {
        train_models(&plan, args.shard, &device, &mut report);
    }
    if args.includes(Part::Render) {
        render_models(&plan, args.shard, &device, &mut report);
    }
    let answer = report.answer(args.shard, start.elapsed().as_secs_f64());
    match report.failures.is_empty() {
        true => Ok(answer),
        false => Err(CliError::SomeFailed(Box::new(answer))),
    }
}

fn train_models(plan: &Plan, shard: Shard, device: &Device, report: &mut Report) {
    for (number, table) in plan.trains.iter().enumerate() {
        if !shard.takes(number) {
            continue;
        }
        let model = table.model.as_path();
        match train::is_done(table) {
            Ok(true) => report.models.push((model.to_owned(), None)),
            Ok(false) => match train::train(table, device.clone()) {
                Ok(summary) => {
                    let summary = super::to_json(&summary);
                    report.models.push((model.to_owned(), Some(summary)));
                }
                Err(error) => report.fail(number, model, &error.to_string()),
            },
            Err(error) => report.fail(number, model, &error.to_string()),
        }
    }
}

fn render_models(plan: &Plan, shard: Shard, device: &Device, report: &mut Report) {
    for work in &plan.models {
        let table = plan.trains.iter().find(|table| table.model == work.path);
        let state = table.map_or(Ok(true), train::is_done);
        let error = match state {
            Ok(true) => {
                render::run(work, shard, device.clone(), report);
                continue;
            }
            Ok(false) => CliError::Refused(format!(
                "the model {} is not trained yet",
                work.path.display()
            )),
            Err(error) => error,
        };
        for group in &work.groups {
            report.all_failed(&group.items, &error);
        }
    }
}

/// The items that a shard has a part in.
fn list(plan: &Plan, args: &BatchArgs) -> Answer {
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
    let text = match lines.is_empty() {
        true => "nothing for this task".into(),
        false => lines.join("\n"),
    };
    Answer {
        text,
        json: json!({"shard": args.shard.to_string(), "items": items}),
    }
}

/// What became of the items.
#[derive(Default)]
struct Report {
    /// Model folders, with the summaries of those that were trained just now.
    models: Vec<(PathBuf, Option<Value>)>,
    renders: Vec<Value>,
    /// Frames rendered, and frames that were there.
    frames: [usize; 2],
    complete: usize,
    failures: Vec<Failure>,
}

struct Failure {
    item: usize,
    output: PathBuf,
    problem: String,
}

impl Report {
    /// `generated` says so of a painting that nobody painted.
    fn rendered(
        &mut self,
        item: &RenderItem,
        [rendered, kept]: [usize; 2],
        complete: bool,
        generated: Option<&str>,
    ) {
        self.frames[0] += rendered;
        self.frames[1] += kept;
        self.complete += usize::from(complete);
        self.renders.push(json!({
            "item": item.number, "output": item.output, "rendered": rendered, "kept": kept,
            "complete": complete, "generated": generated,
        }));
    }

    fn failed(&mut self, item: &RenderItem, error: &CliError) {
        self.fail(item.number, &item.output, &error.to_string());
    }

    fn all_failed(&mut self, items: &[RenderItem], error: &CliError) {
        for item in items {
            self.failed(item, error);
        }
    }

    fn fail(&mut self, item: usize, output: &Path, problem: &str) {
        let failure = Failure {
            item,
            output: output.to_owned(),
            // One failure is one line.
            problem: problem.split_whitespace().collect::<Vec<_>>().join(" "),
        };
        console::note(failure.line());
        self.failures.push(failure);
    }

    fn answer(&self, shard: Shard, seconds: f64) -> Answer {
        let [rendered, kept] = self.frames;
        let trained = self.models.iter().filter(|(_, new)| new.is_some()).count();
        let mut lines = vec![format!(
            "shard {shard} in {}: {trained} models trained and {} there, {rendered} frames rendered \
             and {kept} there, {} of {} folders complete",
            clock(seconds),
            self.models.len() - trained,
            self.complete,
            self.renders.len(),
        )];
        lines.extend(self.failures.iter().map(Failure::line));
        let models = self.models.iter().map(|(model, summary)| {
            json!({"output": model, "trained": summary.is_some(), "summary": summary})
        });
        let failures = self.failures.iter().map(|failure| {
            json!({
                "item": failure.item, "output": failure.output, "problem": failure.problem,
            })
        });
        Answer {
            text: lines.join("\n"),
            json: json!({
                "shard": shard.to_string(),
                "models": models.collect::<Vec<_>>(),
                "renders": self.renders,
                "rendered": rendered,
                "kept": kept,
                "failed": failures.collect::<Vec<_>>(),
                "seconds": seconds,
            }),
        }
    }
}

impl Failure {
    fn line(&self) -> String {
        let (item, output) = (self.item, self.output.display());
        format!("failed: item {item}, {output}: {}", self.problem)
    }
}
