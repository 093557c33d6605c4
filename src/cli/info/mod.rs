//! `impasto info`.

mod capture;
mod training;
mod warnings;
mod words;

use std::path::{Path, PathBuf};

use clap::Args;
use impasto::Model;
use impasto_model::MODEL_FILE;
use serde_json::Value;

use self::capture::{CaptureArgs, CaptureInfo};
use super::train::Preset;
use super::{CliError, CommandOutput};

/// Describe a capture and what is wrong with it, a model or a preset
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A capture's or a model's folder
    #[arg(value_name = "SCENE|MODEL", required_unless_present = "preset")]
    path: Option<PathBuf>,
    /// Describe what this preset would train
    #[arg(long, value_enum, conflicts_with = "path")]
    preset: Option<Preset>,
    #[command(flatten)]
    capture: CaptureArgs,
}

/// Runs the command.
pub fn run(args: &InfoArgs) -> Result<CommandOutput, CliError> {
    let path = args.path.as_deref().unwrap_or(Path::new("."));
    let (kind, facts) = match &args.preset {
        Some(preset) => ("preset", preset.config().info()),
        None if !is_model(path) => {
            let info = CaptureInfo::load(path, &args.capture)?;
            return Ok(CommandOutput {
                text: words::report(&info),
                json: labelled("scene", info.json()),
            });
        }
        None if args.capture.picture.is_some() => {
            return Err(CliError::Usage(format!(
                "--picture shows captures, and {} is a model: give the capture's folder",
                path.display()
            )));
        }
        None => ("model", Model::load(path)?.file.info()),
    };
    let json = labelled(kind, facts);
    Ok(CommandOutput {
        text: outline(&json),
        json,
    })
}

/// Facts with what they are facts of.
fn labelled(kind: &str, mut facts: Value) -> Value {
    facts["kind"] = kind.into();
    facts
}

fn is_model(path: &Path) -> bool {
    path.join(MODEL_FILE).is_file() || path.extension().is_some_and(|e| e == "safetensors")
}

/// JSON as indented lines for people.
fn outline(value: &Value) -> String {
    let mut text = String::new();
    write_outline(value, 0, &mut text);
    text
}

fn write_outline(value: &Value, depth: usize, text: &mut String) {
    let Value::Object(entries) = value else {
        return;
    };
    for (name, value) in entries {
        text.push_str(&"  ".repeat(depth));
        text.push_str(&name.replace('_', " "));
        match value {
            Value::Object(_) => {
                text.push('\n');
                write_outline(value, depth + 1, text);
            }
            _ => {
                text.push_str(": ");
                text.push_str(&inline(value));
                text.push('\n');
            }
        }
    }
}

/// A value on one line; long lists are cut, their length told.
fn inline(value: &Value) -> String {
    const SHOWN: usize = 6;
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => {
            let shown: Vec<String> = items.iter().take(SHOWN).map(inline).collect();
            let more = if items.len() > SHOWN {
                format!(", … ({} in all)", items.len())
            } else {
                String::new()
            };
            format!("{}{more}", shown.join(", "))
        }
        Value::Object(entries) => {
            let parts: Vec<String> = entries
                .iter()
                .map(|(k, v)| format!("{k} {}", inline(v)))
                .collect();
            parts.join(" ")
        }
        Value::Null => "–".into(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn an_outline_shows_every_fact_once() {
        let facts = json!({
            "name": "fox",
            "sizes": [{"w": 3, "h": 4}],
            "test": ["a", "b", "c", "d", "e", "f", "g"],
            "field": {"base_width": 64, "note": null},
        });
        assert_eq!(
            outline(&facts),
            "field\n  base width: 64\n  note: –\nname: fox\nsizes: h 4 w 3\n\
             test: a, b, c, d, e, f, … (7 in all)\n"
        );
    }
}
