//! The file of a batch: what its tables may say.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use impasto::scene::Format;
use impasto::{ColorPreservation, MaskSpec};
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use crate::cli::CliError;
use crate::cli::painting::PaintingSource;
use crate::cli::render::RenderSettings;
use crate::cli::train::Preset;
use crate::cli::values;

/// What is to be trained, and what rendered.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobsFile {
    /// Models to train first.
    #[serde(default)]
    pub train: Vec<TrainTable>,
    /// Products of models, styles and views.
    #[serde(default)]
    pub render: Vec<RenderTable>,
}

/// One model to train. Options are those of `impasto train`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainTable {
    /// The capture.
    pub scene: PathBuf,
    /// The model's folder.
    pub model: PathBuf,
    /// A folder of paintings.
    pub styles: Option<PathBuf>,
    /// An encoder of styles.
    pub encoder: Option<PathBuf>,
    /// What to train.
    #[serde(default)]
    pub stage: BatchStages,
    /// Sizes and schedules to start from.
    #[serde(default)]
    pub preset: Preset,
    /// Time for training.
    #[serde(default, deserialize_with = "budget")]
    pub budget: Option<Duration>,
    /// Steps of training, instead of a time.
    #[serde(default, deserialize_with = "positive")]
    pub steps: Option<u64>,
    /// How many times to shrink the photos.
    #[serde(default = "one", deserialize_with = "downscale")]
    pub downscale: u32,
    /// The capture's format, where it is not to be detected.
    pub format: Option<Format>,
    /// Start of the random numbers.
    #[serde(default)]
    pub seed: u64,
    /// A file of settings.
    pub config: Option<PathBuf>,
    /// Single settings, `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// The table as it is written.
    #[serde(skip)]
    pub written: Value,
}

/// Stages to train.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BatchStages {
    /// Geometry, then style.
    #[default]
    All,
    /// The scene as photographed.
    Geometry,
}

/// Every model in every style from all views.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RenderTable {
    /// Model folders.
    pub models: Vec<PathBuf>,
    /// Paintings and folders of paintings; without any, as photographed.
    pub styles: Option<Vec<PathBuf>>,
    /// As `impasto render --views` takes them.
    #[serde(default = "orbit")]
    pub views: Vec<String>,
    /// Size of a frame in pixels.
    #[serde(default, deserialize_with = "size")]
    pub size: Option<(u32, u32)>,
    /// Number of frames.
    #[serde(default, deserialize_with = "frames")]
    pub frames: Option<usize>,
    /// From the photos' colours to the style's.
    #[serde(default = "whole", deserialize_with = "strength")]
    pub strength: f32,
    /// How large strokes are.
    #[serde(default = "whole", deserialize_with = "stroke_size")]
    pub stroke_size: f32,
    /// From the scene in the painting's colours to all strokes.
    #[serde(default = "whole", deserialize_with = "strength")]
    pub stroke_strength: f32,
    /// Whose colours the paint has.
    #[serde(default)]
    pub keep_color: ColorPreservation,
    /// Where the paint goes.
    #[serde(default, deserialize_with = "mask")]
    pub mask: Option<MaskSpec>,
    /// Rays along each side of a pixel.
    #[serde(default = "one", deserialize_with = "supersampling")]
    pub supersampling: u32,
    /// Whether to write depth too.
    #[serde(default)]
    pub depth: bool,
    /// Whether to show the scene as photographed beside each style.
    #[serde(default)]
    pub side_by_side: bool,
    /// The folder of each render, with `{model}`, `{style}` and `{views}` in it.
    #[serde(default = "output")]
    pub output: String,
}

impl RenderTable {
    /// How its frames are rendered.
    pub fn settings(&self) -> RenderSettings {
        RenderSettings {
            strength: self.strength,
            stroke_size: self.stroke_size,
            stroke_strength: self.stroke_strength,
            supersampling: self.supersampling,
            keep: self.keep_color,
            mask: self.mask.clone(),
        }
    }
}

fn orbit() -> Vec<String> {
    vec!["orbit".into()]
}

fn whole() -> f32 {
    1.0
}

fn one() -> u32 {
    1
}

fn output() -> String {
    "out/{model}/{style}/{views}".into()
}

/// A value that is written as on the command line.
fn parsed<'de, D: Deserializer<'de>, T>(
    from: D,
    parse: fn(&str) -> Result<T, String>,
) -> Result<Option<T>, D::Error> {
    let text = String::deserialize(from)?;
    parse(&text).map(Some).map_err(D::Error::custom)
}

fn budget<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Duration>, D::Error> {
    parsed(from, values::duration)
}

fn size<'de, D: Deserializer<'de>>(from: D) -> Result<Option<(u32, u32)>, D::Error> {
    parsed(from, values::size)
}

fn mask<'de, D: Deserializer<'de>>(from: D) -> Result<Option<MaskSpec>, D::Error> {
    parsed(from, values::mask)
}

fn strength<'de, D: Deserializer<'de>>(from: D) -> Result<f32, D::Error> {
    let number = f32::deserialize(from)?;
    values::share(&number.to_string()).map_err(D::Error::custom)
}

fn stroke_size<'de, D: Deserializer<'de>>(from: D) -> Result<f32, D::Error> {
    let number = f32::deserialize(from)?;
    values::stroke_size(&number.to_string()).map_err(D::Error::custom)
}

/// A whole number from `least` to `most`.
fn ranged<'de, D: Deserializer<'de>>(from: D, least: u64, most: u64) -> Result<u64, D::Error> {
    let number = u64::deserialize(from)?;
    if (least..=most).contains(&number) {
        return Ok(number);
    }
    let upper = match most {
        u64::MAX => "up".to_owned(),
        most => format!("to {most}"),
    };
    Err(D::Error::custom(format!(
        "{number} is not a number from {least} {upper}"
    )))
}

fn positive<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u64>, D::Error> {
    ranged(from, 1, u64::MAX).map(Some)
}

fn downscale<'de, D: Deserializer<'de>>(from: D) -> Result<u32, D::Error> {
    ranged(from, 1, u32::MAX.into()).map(|number| number as u32)
}

fn frames<'de, D: Deserializer<'de>>(from: D) -> Result<Option<usize>, D::Error> {
    ranged(from, 1, u32::MAX.into()).map(|number| Some(number as usize))
}

fn supersampling<'de, D: Deserializer<'de>>(from: D) -> Result<u32, D::Error> {
    ranged(from, 1, 4).map(|number| number as u32)
}

/// Reads the file; paths in it are made relative to where it is.
pub fn read(path: &Path) -> Result<JobsFile, CliError> {
    let text = fs::read_to_string(path).map_err(CliError::read(path))?;
    let refuse = |error: toml::de::Error| {
        let line = values::line_of(&error, &text);
        let line = line.map_or_else(String::new, |line| format!(", line {line}"));
        CliError::Refused(format!("{}{line}: {}", path.display(), error.message()))
    };
    let mut file: JobsFile = toml::from_str(&text).map_err(refuse)?;
    let written: Value = toml::from_str(&text).map_err(refuse)?;
    let base = path.parent().unwrap_or(Path::new(""));
    let place = |path: &mut PathBuf| *path = base.join(&*path);
    for (i, table) in file.train.iter_mut().enumerate() {
        if table.budget.is_some() && table.steps.is_some() {
            return Err(CliError::Refused(format!(
                "{}: [[train]] of {} has both budget and steps; give one of them",
                path.display(),
                table.model.display()
            )));
        }
        table.written = written["train"][i].clone();
        place(&mut table.scene);
        place(&mut table.model);
        let optional = [&mut table.styles, &mut table.encoder, &mut table.config];
        optional.into_iter().flatten().for_each(place);
    }
    for table in &mut file.render {
        let is_file = |style: &&mut PathBuf| {
            let named = PaintingSource::named(&style.to_string_lossy(), base);
            matches!(named, Ok(PaintingSource::File(_)))
        };
        let styles = table.styles.iter_mut().flatten().filter(is_file);
        table.models.iter_mut().chain(styles).for_each(place);
        table.output = base.join(&table.output).to_string_lossy().into_owned();
        for views in &mut table.views {
            if !["train", "test", "orbit", "spiral"].contains(&views.as_str()) {
                *views = base.join(&*views).to_string_lossy().into_owned();
            }
        }
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<JobsFile, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("jobs.toml");
        fs::write(&path, text).unwrap();
        read(&path).map_err(|e| e.to_string())
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let wrong = [
            ("[[render]]\nmodels = []\nstile = 3", "line 3", "`stile`"),
            ("[[rendr]]\nmodels = []", "line 1", "`rendr`"),
            ("[[render]]\nstyles = []", "line 1", "`models`"),
            (
                "[[render]]\nmodels = []\nsize = \"big\"",
                "line 3",
                "\"big\"",
            ),
            ("[[render]]\nmodels = []\nstrength = 1.5", "line 3", "1.5"),
            ("[[render]]\nmodels = []\nmask = \"sky\"", "line 3", "sky"),
            ("[[render]]\nmodels = []\nframes = 0", "line 3", "0 is not"),
            (
                "[[render]]\nmodels = []\nsupersampling = 5",
                "line 3",
                "to 4",
            ),
            (
                "[[train]]\nscene = \"s\"\nmodel = \"m\"\nstage = \"style\"",
                "line 4",
                "geometry",
            ),
            (
                "[[train]]\nscene = \"s\"\nmodel = \"m\"\nbudget = \"soon\"",
                "line 4",
                "\"soon\"",
            ),
            (
                "[[train]]\nscene = \"s\"\nmodel = \"m\"\nbudget = \"9s\"\nsteps = 1",
                "both",
                "m",
            ),
            ("[[render]\n", "line 1", ":"),
        ];
        for (text, line, what) in wrong {
            let problem = parsed(text).unwrap_err();
            let message = &problem[problem.find("jobs.toml").unwrap()..];
            assert!(
                message.contains(line) && message.contains(what),
                "{message}"
            );
        }
    }

    #[test]
    fn paths_start_at_the_file() {
        let file = parsed(
            "[[render]]\nmodels = [\"a\", \"/b\"]\nviews = [\"orbit\", \"walk.json\"]\nstrength = 0.25\n\
             [[train]]\nscene = \"s\"\nmodel = \"m\"\nsteps = 3",
        )
        .unwrap();
        let render = &file.render[0];
        assert!(render.models[0].ends_with("a") && render.models[0].is_absolute());
        assert_eq!(render.models[1], Path::new("/b"));
        assert_eq!(render.views[0], "orbit");
        assert!(Path::new(&render.views[1]).is_absolute());
        assert_eq!((render.strength, render.supersampling), (0.25, 1));
        assert_eq!(file.train[0].written["model"], "m");
    }
}
