//! `impasto eval`: how faithful a model's styles are, and how well its frames agree.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use impasto::Budget;
use impasto::eval::consistency::Consistency;
use impasto::eval::methods::Stylizer;
use impasto::eval::report::{EvalReport, Settings};
use impasto::eval::{
    EvalOptions, Evaluation, FailedGuard, MethodResult, PHOTO, Reconstruct, RecordPlan, evaluate,
    small_orbit,
};
use impasto_bench::Machine;
use serde_json::Value;

use super::device::DeviceArgs;
use super::methods::{JudgedArgs, MethodArgs};
use super::progress::FrameProgress;
use super::values::{clock, duration};
use super::{CliError, CommandOutput, run_facts, to_json};
use crate::output::{Staging, check_folder};

/// Measure how well a model takes on paintings it never saw, and how well its frames agree
#[derive(Debug, Args)]
pub struct EvalArgs {
    #[command(flatten)]
    judged: JudgedArgs,
    #[command(flatten)]
    methods: MethodArgs,
    /// Also refine each painting's look for this long, e.g. 15s, as a method of its own; see render
    #[arg(long, value_name = "TIME", value_parser = duration)]
    refine: Option<Duration>,
    /// Also reconstruct the place from what the compared methods make of its training views,
    /// training for this long, e.g. 60s
    #[arg(long, value_name = "TIME", value_parser = duration, requires = "against")]
    reconstruct: Option<Duration>,
    /// Paintings to do that with, the first ones
    #[arg(
        long, value_name = "N", default_value_t = 1,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    reconstruct_paintings: u32,
    /// Frames of the orbit on which consistency is measured; 0 leaves it out
    #[arg(long, value_name = "N", default_value_t = 60)]
    frames: usize,
    /// Rays along each side of a rendered pixel: 2 takes four times as long and flickers less
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4))]
    supersampling: u32,
    #[command(flatten)]
    device: DeviceArgs,
    /// Folder for a report: a page with pictures (report.html), tables (report.csv) and what --json
    /// prints (report.json)
    #[arg(short, long, value_name = "REPORT_DIR")]
    output: Option<PathBuf>,
}

/// Longest side of the walk's frames.
const LONGEST: u32 = 400;

/// Runs the command.
pub fn run(args: &EvalArgs) -> Result<CommandOutput, CliError> {
    let start = Instant::now();
    if let Some(folder) = &args.output {
        check_folder(folder)?;
    }
    let (model, read) = args.judged.load(&args.device.open()?)?;
    let path = small_orbit(&model, args.frames, LONGEST)?;
    let opened = args.methods.open()?;
    let against: Vec<&dyn Stylizer> = opened.iter().map(Box::as_ref).collect();
    let options = EvalOptions {
        paintings: &read.named,
        path: &path,
        supersampling: args.supersampling,
        against: &against,
        record: args.output.as_ref().map(|_| RecordPlan::default()),
        refine: args.refine.map(Budget::Time),
        reconstruct: args.reconstruct.map(|time| Reconstruct {
            budget: Budget::Time(time),
            paintings: args.reconstruct_paintings as usize,
        }),
    };
    let mut bar = FrameProgress::new("evaluate", options.pictures(&model));
    let evaluation = evaluate(&model, &options, &mut || bar.tick())?;
    drop(bar);
    let unreadable: Vec<PathBuf> = read.unreadable.into_iter().map(|(path, _)| path).collect();
    let report = EvalReport {
        evaluation: &evaluation,
        reconstruction: model.file.quality,
        scene: &model.file.scene.name,
        synthetic: model.file.scene.synthetic,
        unreadable: &unreadable,
        settings: settings(args, &options),
        version: env!("CARGO_PKG_VERSION"),
        command: run_facts::command(),
        machine: Machine::this().to_string(),
        date: run_facts::now(),
        seconds: start.elapsed().as_secs_f64(),
    };
    let json = to_json(&report);
    let mut text = summary(&report);
    if let Some(folder) = &args.output {
        let page = write(folder, &report, &json)?;
        text += &format!("\nreport: {}", page.display());
    }
    Ok(CommandOutput { text, json })
}

fn settings(args: &EvalArgs, options: &EvalOptions<'_>) -> Settings {
    let size = options.path.first().map(|camera| camera.intrinsics);
    Settings {
        model: args.judged.model.clone(),
        styles: args.judged.styles.clone(),
        paintings: options.paintings.len(),
        frames: options.path.len(),
        frame_size: size.map(|k| [k.width, k.height]),
        supersampling: options.supersampling,
        against: options.against.iter().map(|m| m.name().into()).collect(),
    }
}

/// Writes the report's files; the page's path.
fn write(folder: &Path, report: &EvalReport<'_>, json: &Value) -> Result<PathBuf, CliError> {
    let page = folder.join("report.html");
    let files = [
        ("report.csv", report.csv()),
        (
            "report.html",
            report.html().map_err(CliError::encode(&page))?,
        ),
        ("report.json", format!("{json}\n")),
    ];
    let mut staging = Staging::new(folder)?;
    for (name, text) in files {
        staging.write(name, text)?;
    }
    staging.commit()?;
    Ok(page)
}

fn summary(report: &EvalReport<'_>) -> String {
    let quality = report.reconstruction;
    let mut text = format!("reconstruction: {quality}\n{}", table(report.evaluation),);
    if !report.unreadable.is_empty() {
        let count = report.unreadable.len();
        text += &format!("\n{count} files of the style folder are no readable pictures");
    }
    text + &format!("\nevaluated in {}", clock(report.seconds))
}

fn table(evaluation: &Evaluation) -> String {
    let mut lines = Vec::new();
    for (name, result) in &evaluation.methods {
        let MethodResult { fidelity, .. } = result;
        let mut line = format!(
            "{name}: style gain {:.3}, retrieval {:.1} %, content {:.2}, over {} paintings × {} views",
            fidelity.style_gain,
            fidelity.retrieval * 100.0,
            fidelity.content_loss,
            fidelity.paintings.len(),
            fidelity.views,
        );
        if let Some(strokes) = result.strokes {
            line += &format!(
                "\n  stroke score {:.3}, stroke retrieval {:.1} %",
                strokes.stroke_score,
                strokes.stroke_retrieval * 100.0,
            );
        }
        if let (Some(exact), Some(sharpness)) = (&result.consistency, result.sharpness) {
            line += &format!(
                "\n  consistency E×100 {} short, {} long, sharpness {sharpness:.2}",
                agreement(&exact.short),
                agreement(&exact.long),
            );
            if let Some(truth) = &result.true_depth {
                line += &format!(
                    "\n  by true depth {} short, {} long",
                    agreement(&truth.consistency.short),
                    agreement(&truth.consistency.long),
                );
            }
            if let Some(ratio) = result.over_photo.filter(|_| name != PHOTO) {
                line += &format!(
                    "\n  with contrast divided out, {} short and {} long times the photo's",
                    times(ratio.short),
                    times(ratio.long),
                );
            }
        }
        for failed in FailedGuard::of(name, result) {
            line += &format!("\n  {failed}");
        }
        lines.push(line);
    }
    lines.join("\n")
}

/// E × 100 and what it was measured on.
fn agreement(found: &Consistency) -> String {
    if found.pairs == 0 {
        return "– (no pair shares enough)".into();
    }
    format!(
        "{:.3} ({:.0} % of pixels)",
        found.e100,
        found.coverage * 100.0
    )
}

/// A ratio, or a dash where there is none.
fn times(ratio: f64) -> String {
    if ratio.is_nan() {
        return "–".into();
    }
    format!("{ratio:.2}")
}
