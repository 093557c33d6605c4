//! What a run must have in common with the one that it continues.

use crate::TrainError;
use crate::config::TrainConfig;
use crate::hash::Hash;
use crate::style_folder::StyleFolder;
use crate::train::{Stages, TrainOptions};
use impasto_scene::{Photo, Scene};
use impasto_style::StyleVae;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::borrow::Cow;

/// Everything that decides what a run makes, but its length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    stages: Stages,
    seed: u64,
    downscale: u32,
    config: TrainConfig,
    /// Of the encoder's file, where it is not the shipped one.
    encoder: Option<u64>,
    photos: Vec<PhotoMark>,
    /// Of names and sizes of the paintings' files.
    paintings: Option<u64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PhotoMark {
    name: String,
    /// Of its camera, split, mask, and the pixels that the mask shows.
    hash: u64,
}

impl PhotoMark {
    fn of(photo: &Photo) -> Self {
        let camera = serde_json::to_string(&photo.camera).unwrap_or_default();
        let mask = photo.mask.iter().flatten();
        let mask: Vec<u8> = mask.map(|shown| u8::from(*shown)).collect();
        let mut pixels = Cow::Borrowed(photo.pixels.as_raw());
        if !mask.is_empty() {
            let hidden = pixels.to_mut().chunks_exact_mut(3).zip(&mask);
            let hidden = hidden.filter(|(_, shown)| **shown == 0);
            hidden.for_each(|(pixel, _)| pixel.fill(0));
        }
        let hash = Hash::of(&photo.name)
            .with_words(&pixels)
            .with_words(&mask)
            .and(&camera)
            .and(&format!("{:?}", photo.split));
        Self {
            name: photo.name.clone(),
            hash: hash.0,
        }
    }
}

impl Identity {
    pub(crate) fn of(
        options: &TrainOptions,
        scene: &Scene,
        paintings: Option<&StyleFolder>,
        encoder: Option<&StyleVae>,
    ) -> Result<Self, TrainError> {
        let encoder = encoder.map(StyleVae::to_bytes).transpose()?;
        Ok(Self {
            stages: options.stages,
            seed: options.seed,
            downscale: options.downscale,
            config: options.config.clone(),
            encoder: encoder.map(|bytes| Hash::of_bytes(&bytes).0),
            photos: scene.photos.iter().map(PhotoMark::of).collect(),
            paintings: paintings.map(StyleFolder::identity),
        })
    }

    /// The first thing in which `other` differs so that it cannot continue this, as the end of a
    /// sentence about this run.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
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
    pub(crate) fn same_paintings(&self, other: &Self) -> bool {
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

    fn identity(change: impl Fn(&mut Identity)) -> Identity {
        let mark = |name: &str| PhotoMark {
            name: name.into(),
            hash: 7,
        };
        let mut identity = Identity {
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
        let said = |change: fn(&mut Identity)| ours.difference(&identity(change));
        assert_eq!(said(|_| ()), None);
        assert_eq!(said(|i| i.paintings = Some(1)), None);
        for (change, wanted) in [
            (
                (|i| i.stages = Stages::Style) as fn(&mut Identity),
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
