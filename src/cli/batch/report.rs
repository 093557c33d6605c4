//! What became of the items of a batch.

use std::path::{Path, PathBuf};

use impasto::TrainSummary;
use serde::Serialize;
use serde_json::{Value, json};

use super::plan::RenderItem;
use crate::cli::shard::Shard;
use crate::cli::values::clock;
use crate::cli::{CliError, CommandOutput, console, to_json};

/// What became of the items.
#[derive(Default)]
pub struct BatchReport {
    /// Model folders, with the summaries of those that were trained just now.
    models: Vec<(PathBuf, Option<Value>)>,
    renders: Vec<Value>,
    /// Frames rendered, and frames that were there.
    frames: [usize; 2],
    complete: usize,
    failures: Vec<Failure>,
}

#[derive(Serialize)]
struct Failure {
    item: usize,
    output: PathBuf,
    problem: String,
}

impl BatchReport {
    /// A model that was there.
    pub fn kept(&mut self, model: &Path) {
        self.models.push((model.to_owned(), None));
    }

    /// A model that was trained.
    pub fn trained(&mut self, model: &Path, summary: &TrainSummary) {
        let summary = Some(to_json(summary));
        self.models.push((model.to_owned(), summary));
    }

    /// A folder of frames; `generated` says so of a painting that nobody painted.
    pub fn rendered(
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

    /// A render that failed.
    pub fn failed(&mut self, item: &RenderItem, error: &CliError) {
        self.fail(item.number, &item.output, error);
    }

    /// Renders that failed for the same reason.
    pub fn all_failed<'a>(
        &mut self,
        items: impl IntoIterator<Item = &'a RenderItem>,
        error: &CliError,
    ) {
        for item in items {
            self.failed(item, error);
        }
    }

    /// An item that failed.
    pub fn fail(&mut self, item: usize, output: &Path, error: &CliError) {
        let failure = Failure {
            item,
            output: output.to_owned(),
            // One failure is one line.
            problem: error
                .to_string()
                .split_whitespace()
                .collect::<Vec<_>>()
                .join(" "),
        };
        console::note(failure.line());
        self.failures.push(failure);
    }

    /// Whether nothing failed.
    pub fn is_clean(&self) -> bool {
        self.failures.is_empty()
    }

    /// All of it, for people and for programs.
    pub fn output(&self, shard: Shard, seconds: f64) -> CommandOutput {
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
        CommandOutput {
            text: lines.join("\n"),
            json: json!({
                "shard": shard.to_string(),
                "models": models.collect::<Vec<_>>(),
                "renders": self.renders,
                "rendered": rendered,
                "kept": kept,
                "failed": self.failures,
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
