//! What a model notes of the run that made it.

use crate::budget::Budget;
use crate::config::TrainConfig;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Which stages to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stages {
    /// Both.
    All,
    /// Photos → field only.
    Geometry,
    /// Paintings → hypernetwork only, on the model that the output folder holds.
    Style,
}

impl Stages {
    /// As the command line calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Geometry => "geometry",
            Self::Style => "style",
        }
    }
}

/// Everything that decides what a run makes, but its length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunIdentity {
    /// Stages.
    pub stages: Stages,
    /// Seed of everything random.
    pub seed: u64,
    /// Photos are shrunk this many times.
    pub downscale: u32,
    /// Sizes and rates.
    pub config: TrainConfig,
    /// Hash of the encoder's file, where it is not the shipped one.
    pub encoder: Option<u64>,
    /// All photos.
    pub photos: Vec<PhotoMark>,
    /// Hash of names and sizes of the paintings' files.
    pub paintings: Option<u64>,
}

/// A photo of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoMark {
    /// Its name.
    pub name: String,
    /// Hash of its camera, split, mask, and the pixels that the mask shows.
    pub hash: u64,
}

/// The run that made a model, once it is over.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainingRecord {
    /// What decided its result.
    pub identity: RunIdentity,
    /// Length that was asked for.
    pub budget: Budget,
    /// Steps of the geometry stage.
    pub geometry_steps: u64,
    /// Steps of the style stage.
    pub style_steps: u64,
    /// Files in the style folder, less those that are known to be no pictures.
    pub paintings: usize,
    /// Files in the style folder that the style stage found to be no pictures.
    pub unreadable_paintings: usize,
}

impl RunIdentity {
    /// The first thing in which `other` differs so that it cannot continue this, as the end of a
    /// sentence about this run.
    pub fn difference(&self, other: &Self) -> Option<String> {
        if self.stages != other.stages {
            return Some(format!(
                "has --stage {}, not {}",
                self.stages.name(),
                other.stages.name()
            ));
        }
        if self.seed != other.seed {
            return Some(format!("has --seed {}, not {}", self.seed, other.seed));
        }
        if self.downscale != other.downscale {
            let (ours, theirs) = (self.downscale, other.downscale);
            return Some(format!("has --downscale {ours}, not {theirs}"));
        }
        if self.encoder != other.encoder {
            return Some("has another --encoder".into());
        }
        let settings = [self, other].map(|run| serde_json::to_value(&run.config));
        if let [Ok(ours), Ok(theirs)] = settings
            && let Some((key, ours, theirs)) = first_difference(&ours, &theirs, String::new())
        {
            return Some(format!("has the setting {key} = {ours}, not {theirs}"));
        }
        self.photo_difference(other)
    }

    fn photo_difference(&self, other: &Self) -> Option<String> {
        let (ours, theirs) = (&self.photos, &other.photos);
        if ours.len() != theirs.len() {
            return Some(format!("has {} photos, not {}", ours.len(), theirs.len()));
        }
        let changed = ours.iter().zip(theirs).find(|(a, b)| a != b);
        changed.map(|(photo, _)| {
            format!(
                "has a photo {} of other pixels, pose, mask or split than there is now",
                photo.name
            )
        })
    }

    /// Whether the same files are in the folder of paintings.
    pub fn same_paintings(&self, other: &Self) -> bool {
        self.paintings == other.paintings
    }
}

/// The dotted path of the first setting that differs, with both values.
fn first_difference(a: &Value, b: &Value, path: String) -> Option<(String, Value, Value)> {
    match (a, b) {
        (Value::Object(ours), Value::Object(theirs)) => {
            let keys = ours.keys().chain(theirs.keys());
            keys.into_iter().find_map(|key| {
                let below = match path.is_empty() {
                    true => key.clone(),
                    false => format!("{path}.{key}"),
                };
                let value = |from: &serde_json::Map<_, _>| from.get(key).cloned();
                first_difference(
                    &value(ours).unwrap_or_default(),
                    &value(theirs).unwrap_or_default(),
                    below,
                )
            })
        }
        _ if a != b => Some((path, a.clone(), b.clone())),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity(change: impl Fn(&mut RunIdentity)) -> RunIdentity {
        let mark = |name: &str| PhotoMark {
            name: name.into(),
            hash: 7,
        };
        let mut identity = RunIdentity {
            stages: Stages::All,
            seed: 3,
            downscale: 2,
            config: TrainConfig::fast(),
            encoder: None,
            photos: vec![mark("a.jpg"), mark("b.jpg")],
            paintings: None,
        };
        change(&mut identity);
        identity
    }

    #[test]
    fn a_difference_is_named() {
        let ours = identity(|_| ());
        let said = |change: fn(&mut RunIdentity)| ours.difference(&identity(change));
        assert_eq!(said(|_| ()), None);
        assert_eq!(said(|i| i.paintings = Some(1)), None);
        for (change, wanted) in [
            (
                (|i| i.stages = Stages::Style) as fn(&mut RunIdentity),
                "has --stage all, not style",
            ),
            (|i| i.seed = 4, "has --seed 3, not 4"),
            (|i| i.downscale = 1, "has --downscale 2, not 1"),
            (|i| i.encoder = Some(1), "has another --encoder"),
            (
                |i| i.config.geometry.grid_every = 99,
                "has the setting geometry.grid_every = 16, not 99",
            ),
            (|i| i.photos.truncate(1), "has 2 photos, not 1"),
            (
                |i| i.photos[1].hash = 8,
                "has a photo b.jpg of other pixels, pose, mask or split than there is now",
            ),
        ] {
            assert_eq!(said(change).as_deref(), Some(wanted));
        }
    }
}
