//! Paintings as they are named: files, and numbers of generated ones.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use image::RgbImage;
use impasto::paintings::{Recipe, label, random};
use impasto::scene::{SceneError, read_rgb};

use super::CliError;

/// What a generated painting's number comes after.
const RANDOM: &str = "random:";
/// Pixels along each side of a generated painting.
const GENERATED_SIDE: u32 = 256;

/// Where a painting comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum PaintingSource {
    /// A picture's file.
    File(PathBuf),
    /// The generated painting of a number.
    Generated(u64),
}

impl PaintingSource {
    /// What `name` stands for: `random:SEED`, or a file, whose path is relative to `folder`.
    ///
    /// # Errors
    /// When no number follows.
    pub fn named(name: &str, folder: &Path) -> Result<Self, String> {
        let path = folder.join(name);
        match name.strip_prefix(RANDOM) {
            // A file may really be called like that.
            Some(seed) if !path.is_file() => match seed.parse() {
                Ok(seed) => Ok(Self::Generated(seed)),
                Err(_) => Err(format!(
                    "\"{name}\" is no generated painting; write random:SEED with a whole number, like \
                     random:42"
                )),
            },
            _ => Ok(Self::File(path)),
        }
    }

    /// A name for files and folders: the file's own without its ending.
    pub fn stem(&self) -> String {
        match self {
            Self::File(path) => path
                .file_stem()
                .map_or("style".into(), |stem| stem.to_string_lossy().into_owned()),
            Self::Generated(seed) => format!("random-{seed}"),
        }
    }

    /// What to say of it wherever it is shown, if it is no real painting.
    pub fn label(&self) -> Option<String> {
        match self {
            Self::File(_) => None,
            Self::Generated(seed) => Some(label(&Recipe::random(*seed))),
        }
    }

    /// Reads or paints it.
    pub fn read(&self) -> Result<RgbImage, CliError> {
        match self {
            Self::Generated(seed) => Ok(random(*seed, GENERATED_SIDE).1),
            Self::File(path) => read_rgb(path).map_err(|error| match error {
                SceneError::Photo { path, problem } => CliError::Painting { path, problem },
                SceneError::Io { path, source } => CliError::Read { path, source },
                other => CliError::Scene(other),
            }),
        }
    }
}

/// A style image, `IMAGE` or `IMAGE:WEIGHT`, where `IMAGE` may be `random:SEED`.
#[derive(Debug, Clone, PartialEq)]
pub struct StyleArg {
    /// The painting.
    pub painting: PaintingSource,
    /// Its share in a mix.
    pub weight: Option<f32>,
}

impl FromStr for StyleArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // The number of a generated painting is no weight.
        let first = if text.starts_with(RANDOM) {
            RANDOM.len()
        } else {
            0
        };
        let split = text[first..]
            .rsplit_once(':')
            .and_then(|(name, weight)| Some((first + name.len(), weight.parse::<f32>().ok()?)));
        let (name, weight) = match split {
            // A file may really be called like that.
            Some(_) if Path::new(text).is_file() => (text, None),
            Some((_, weight)) if !weight.is_finite() || weight < 0.0 => {
                return Err(format!(
                    "the weight in \"{text}\" must be a number that is not negative"
                ));
            }
            Some((end, weight)) => (&text[..end], Some(weight)),
            None => (text, None),
        };
        Ok(Self {
            painting: PaintingSource::named(name, Path::new(""))?,
            weight,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_style_may_carry_a_weight() {
        let style = |text: &str| text.parse::<StyleArg>().map(|s| (s.painting, s.weight));
        let file = |path: &str| PaintingSource::File(path.into());
        assert_eq!(style("a.png:0.5"), Ok((file("a.png"), Some(0.5))));
        assert_eq!(style("C:\\a.png"), Ok((file("C:\\a.png"), None)));
        assert!(style("a.png:-1").is_err() && style("a.png:inf").is_err());
    }

    #[test]
    fn a_style_may_be_generated() {
        let style = |text: &str| text.parse::<StyleArg>().map(|s| (s.painting, s.weight));
        let made = PaintingSource::Generated;
        assert_eq!(style("random:42"), Ok((made(42), None)));
        assert_eq!(style("random:42:0.5"), Ok((made(42), Some(0.5))));
        assert_eq!(style("random:0:2"), Ok((made(0), Some(2.0))));
        for wrong in [
            "random:",
            "random:x",
            "random:-1",
            "random:1.5",
            "random:1:-1",
            "random:1:x",
        ] {
            assert!(style(wrong).is_err(), "{wrong}");
        }
        let painting = made(42);
        assert_eq!(painting.stem(), "random-42");
        assert!(
            painting
                .label()
                .is_some_and(|label| label.starts_with("synthetic"))
        );
        let picture = painting.read().unwrap();
        assert_eq!(picture, random(42, GENERATED_SIDE).1);
    }

    #[test]
    fn a_file_may_be_called_like_a_number() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("random:7"), "").unwrap();
        let named = |name: &str| PaintingSource::named(name, folder.path());
        assert_eq!(named("random:8"), Ok(PaintingSource::Generated(8)));
        let file = PaintingSource::File(folder.path().join("random:7"));
        assert_eq!(named("random:7"), Ok(file));
    }
}
