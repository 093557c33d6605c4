//! A run's configuration: the preset, then a file, then single settings.
//!
//! Works on the configuration's JSON form, so that a new field can be set without a word here.
//! Every change is checked at once; an error names the key that caused it.

use std::path::Path;

use impasto::TrainConfig;
use impasto::scene::file::read_text;
use serde_json::Value;

use super::values::{has_ending, line_of};
use super::{CliError, to_json};

/// Applies `file` (TOML, or JSON when its name ends so) and then `settings`, each `KEY=VALUE`
/// with a dotted key and a JSON value (anything else is text), to the preset.
pub fn configure(
    preset: &TrainConfig,
    file: Option<&Path>,
    settings: &[String],
) -> Result<TrainConfig, CliError> {
    let mut config = Settings::of(preset);
    if let Some(path) = file {
        let value = read(path)?;
        config
            .merge("", value)
            .map_err(|problem| CliError::Refused(format!("{}: {problem}", path.display())))?;
    }
    for setting in settings {
        let (key, text) = setting
            .split_once('=')
            .ok_or_else(|| CliError::Usage(format!("--set {setting}: write it as KEY=VALUE")))?;
        let value = serde_json::from_str(text).unwrap_or_else(|_| Value::from(text));
        config
            .merge(key, value)
            .map_err(|problem| CliError::Refused(format!("--set {setting}: {problem}")))?;
    }
    Ok(config.checked)
}

fn read(path: &Path) -> Result<Value, CliError> {
    let text = read_text(path).map_err(CliError::read(path))?;
    let value = if has_ending(path, "json") {
        serde_json::from_str(&text)
            .map_err(|e| format!("line {}: not valid JSON ({})", e.line(), without_place(&e)))
    } else {
        toml::from_str(&text).map_err(|e| {
            let line = line_of(&e, &text).unwrap_or(1);
            format!("line {line}: not valid TOML ({})", e.message())
        })
    };
    match value {
        Ok(value @ Value::Object(_)) => Ok(value),
        Ok(_) => Err(CliError::Refused(format!(
            "{}: not a table of settings; write {{\"KEY\": VALUE}}",
            path.display()
        ))),
        Err(problem) => Err(CliError::Refused(format!("{}, {problem}", path.display()))),
    }
}

/// serde's message without the position in a text that the user has not seen.
fn without_place(error: &serde_json::Error) -> String {
    let message = error.to_string();
    match message.rfind(" at line ") {
        Some(end) => message[..end].to_owned(),
        None => message,
    }
}

struct Settings {
    value: Value,
    checked: TrainConfig,
}

impl Settings {
    fn of(preset: &TrainConfig) -> Self {
        Self {
            value: to_json(preset),
            checked: preset.clone(),
        }
    }

    /// Replaces the value at `key` (everything if empty); tables are merged entry by entry.
    fn merge(&mut self, key: &str, new: Value) -> Result<(), String> {
        match new {
            Value::Object(entries) if !self.is_choice(key, entries.keys()) => {
                for (name, value) in entries {
                    self.merge(&below(key, &name), value)?;
                }
                Ok(())
            }
            new => self.replace(key, new),
        }
    }

    /// Whether new names stand where one of several alternatives (an enum's variant, or nothing)
    /// stands: then the whole is replaced, and the configuration's own check decides.
    fn is_choice<'a>(&self, key: &str, names: impl Iterator<Item = &'a String>) -> bool {
        let names: Vec<&String> = names.collect();
        match self.value.pointer(&pointer(key)) {
            Some(Value::Object(old)) => {
                old.len() == 1 && names.len() == 1 && !old.contains_key(names[0])
            }
            Some(_) => true,
            None => false,
        }
    }

    fn replace(&mut self, key: &str, new: Value) -> Result<(), String> {
        let mut value = self.value.clone();
        match value.pointer_mut(&pointer(key)) {
            Some(place) if !key.is_empty() => *place = new,
            _ => return Err(self.unknown(key)),
        }
        // From text, because numbers are then read as the fields' own types.
        self.checked = serde_json::from_str(&value.to_string())
            .map_err(|e| format!("\"{key}\" cannot be that ({})", without_place(&e)))?;
        self.value = value;
        Ok(())
    }

    fn unknown(&self, key: &str) -> String {
        let mut keys = Vec::new();
        leaves(&self.value, "", &mut keys);
        keys.sort_by_cached_key(|candidate| distance(key, candidate));
        keys.truncate(3);
        format!(
            "there is no setting \"{key}\"; the closest are {}",
            keys.join(", ")
        )
    }
}

/// The dotted key of a name in the table at `key`.
fn below(key: &str, name: &str) -> String {
    match key {
        "" => name.to_owned(),
        key => format!("{key}.{name}"),
    }
}

/// A dotted key as a JSON pointer.
fn pointer(key: &str) -> String {
    match key {
        "" => String::new(),
        key => {
            let key = key.replace('~', "~0").replace('/', "~1");
            format!("/{}", key.replace('.', "/"))
        }
    }
}

/// All keys that hold a value rather than a table.
fn leaves(value: &Value, key: &str, into: &mut Vec<String>) {
    match value {
        Value::Object(entries) => {
            for (name, value) in entries {
                leaves(value, &below(key, name), into);
            }
        }
        _ => into.push(key.to_owned()),
    }
}

/// How unlike two keys are: edits between their last parts first, then between the whole.
fn distance(a: &str, b: &str) -> (usize, usize) {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    (edits(&last(a), &last(b)), edits(a, b))
}

/// Levenshtein distance.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn set(settings: &[&str]) -> Result<TrainConfig, String> {
        let settings: Vec<String> = settings.iter().map(ToString::to_string).collect();
        configure(&TrainConfig::fast(), None, &settings).map_err(|e| e.to_string())
    }

    #[test]
    fn a_dotted_key_sets_one_value() {
        let config = set(&["geometry.grid_rate=0.5", "style.patch=[9, 7]"]).unwrap();
        assert_eq!(
            (config.geometry.grid_rate, config.style.patch),
            (0.5, [9, 7])
        );
        let unchanged = TrainConfig {
            geometry: TrainConfig::fast().geometry,
            style: TrainConfig::fast().style,
            ..config
        };
        assert_eq!(unchanged, TrainConfig::fast());
    }

    #[test]
    fn an_unknown_key_is_named_with_its_neighbours() {
        let problem = set(&["geometry.gird_rate=1"]).unwrap_err();
        assert!(problem.contains("\"geometry.gird_rate\""), "{problem}");
        assert!(
            problem.contains("closest are geometry.grid_rate"),
            "{problem}"
        );
    }

    #[test]
    fn a_value_of_the_wrong_kind_is_named() {
        let problem = set(&["style.patch=wide"]).unwrap_err();
        assert!(problem.contains("\"style.patch\""), "{problem}");
        assert!(set(&["style.patch"]).is_err());
    }

    #[test]
    fn an_alternative_is_replaced_as_a_whole() {
        let config = set(&["style.shading=samples"]).unwrap();
        assert_eq!(to_json(&config.style.shading), "samples");
        let frequency = r#"field.inner.encoding={"frequency": {"bands": 4}}"#;
        let config = set(&[frequency]).unwrap();
        assert_eq!(config.field.inner.encoding.hash_grid(), None);
        assert!(set(&[r#"field.inner.encoding={"wavelet": {}}"#]).is_err());
    }

    #[test]
    fn files_are_toml_or_json_and_settings_win() {
        let folder = tempfile::tempdir().unwrap();
        let files = [
            (
                "run.toml",
                "geometry_share = 0.25\n[geometry]\ngrid_rate = 0.5\n",
            ),
            (
                "run.json",
                r#"{"geometry_share": 0.25, "geometry": {"grid_rate": 0.5}}"#,
            ),
        ];
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            let settings = ["geometry.grid_rate=0.125".to_owned()];
            let config = configure(&TrainConfig::fast(), Some(&path), &settings).unwrap();
            assert_eq!(
                (config.geometry_share, config.geometry.grid_rate),
                (0.25, 0.125)
            );
        }
        let wrong = folder.path().join("wrong.toml");
        fs::write(&wrong, "[geometry]\nspeed = 3\n").unwrap();
        let problem = configure(&TrainConfig::fast(), Some(&wrong), &[])
            .unwrap_err()
            .to_string();
        assert!(
            problem.contains("wrong.toml") && problem.contains("geometry.speed"),
            "{problem}"
        );
    }
}
