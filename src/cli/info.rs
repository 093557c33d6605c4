//! `impasto info`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use impasto::Model;
use impasto::scene::{Format, LoadOptions, Scene, Split, load};
use impasto_train::MODEL_FILE;
use serde_json::{Map, Value, json};

use super::train::Preset;
use super::{Answer, CliError, to_json};

/// Describe a capture, a model or a preset
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A capture's or a model's folder
    #[arg(value_name = "SCENE|MODEL", required_unless_present = "preset")]
    path: Option<PathBuf>,
    /// Describe what this preset would train
    #[arg(long, value_enum, conflicts_with = "path")]
    preset: Option<Preset>,
    /// Format of the capture, where it should not be detected: colmap, transforms, nerf++ or llff
    #[arg(long)]
    format: Option<Format>,
}

/// Runs the command.
pub fn run(args: &InfoArgs) -> Result<Answer, CliError> {
    let (kind, facts) = match (&args.preset, &args.path) {
        (Some(preset), _) => ("preset", preset.config().info()),
        (None, Some(path)) if is_model(path) => ("model", Model::load(path)?.file.info()),
        (None, path) => {
            let options = LoadOptions {
                format: args.format,
                ..LoadOptions::default()
            };
            let path = path.as_deref().unwrap_or(Path::new("."));
            ("scene", describe(&load(path, &options)?))
        }
    };
    let mut all = Map::new();
    all.insert("kind".into(), kind.into());
    if let Value::Object(facts) = facts {
        all.extend(facts);
    }
    let json = Value::Object(all);
    Ok(Answer {
        text: outline(&json),
        json,
    })
}

fn is_model(path: &Path) -> bool {
    path.join(MODEL_FILE).is_file() || path.extension().is_some_and(|e| e == "safetensors")
}

fn describe(scene: &Scene) -> Value {
    let mut sizes = BTreeMap::new();
    for photo in &scene.photos {
        *sizes.entry(photo.pixels.dimensions()).or_insert(0) += 1;
    }
    let sizes: Vec<Value> = sizes
        .into_iter()
        .map(|((width, height), count)| json!({"w": width, "h": height, "photos": count}))
        .collect();
    let names = |split| -> Vec<&str> {
        let photos = scene.photos.iter().filter(|photo| photo.split == split);
        photos.map(|photo| photo.name.as_str()).collect()
    };
    json!({
        "name": scene.name,
        "format": scene.format,
        "synthetic": scene.synthetic,
        "photos": scene.photos.len(),
        "sizes": sizes,
        "train": names(Split::Train),
        "test": names(Split::Test),
        "points": scene.points.len(),
        "normalisation": to_json(&scene.normalisation),
    })
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
