//! What the command says of rendered views.

use std::path::PathBuf;

use serde_json::json;

use super::styles::Styles;
use crate::cli::values::clock;
use crate::cli::{CommandOutput, of_synthetic};

/// What was rendered.
pub struct RenderSummary<'a> {
    /// Files or folders.
    pub outputs: &'a [PathBuf],
    /// Number of views.
    pub views: usize,
    /// What the scene is painted with.
    pub styles: &'a Styles,
    /// Whether the scene was made by a program.
    pub synthetic: bool,
    /// How long it took.
    pub seconds: f64,
}

impl RenderSummary<'_> {
    /// In words, with more before the number of views and after the time, and as JSON.
    pub fn output(&self, before: &str, after: &str) -> CommandOutput {
        let outputs = self.outputs.iter().map(|path| path.display().to_string());
        let outputs: Vec<String> = outputs.collect();
        let Styles { generated, .. } = self.styles;
        CommandOutput {
            text: format!(
                "{before}{} views{} in {}{after}: {}{}",
                self.views,
                of_synthetic(self.synthetic),
                clock(self.seconds),
                outputs.join(", "),
                generated_note(generated)
            ),
            json: json!({
                "outputs": outputs,
                "views": self.views,
                "styles": if self.styles.is_empty() { Vec::new() } else { self.styles.names() },
                "generated": generated,
                "synthetic": self.synthetic,
                "seconds": self.seconds,
            }),
        }
    }
}

/// A line about paintings that nobody painted.
pub fn generated_note(generated: &[String]) -> String {
    match generated {
        [] => String::new(),
        labels => format!("\ngenerated paintings: {}", labels.join("; ")),
    }
}
