//! `checkpoint.safetensors`: all that an interrupted run needs to go on as if nothing had been.

use crate::event::Stage;
use crate::geometry::GeometryProgress;
use crate::progress::Reported;
use crate::style::StyleProgress;
use crate::{TrainError, hash::Hash};
use burn::tensor::Device;
use impasto_model::tensors::{Entry, TensorReader, serialize};
use impasto_model::{Budget, CHECKPOINT_FILE, RunIdentity};
use impasto_scene::file::{LARGEST_FILE, plainly, read_whole, write_verified};
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Keys of the JSON and of its hash with the tensors' in the file's metadata.
const KEYS: [&str; 2] = ["impasto_checkpoint", "hash"];
/// Raised when a checkpoint of an earlier version can no longer be read.
pub(crate) const VERSION: u32 = 3;

/// Where a run stands.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Position {
    pub(crate) version: u32,
    pub(crate) identity: RunIdentity,
    /// Length that was asked for.
    pub(crate) budget: Budget,
    /// Time that the run has taken, all its parts together, and how much of it when the stage began.
    pub(crate) ran: Duration,
    pub(crate) began: Duration,
    /// Steps of the stage, and the time that they took.
    pub(crate) steps: u64,
    pub(crate) stepping: Duration,
    /// Steps of the geometry stage, once it is over.
    pub(crate) geometry_steps: u64,
    pub(crate) reported: Reported,
    pub(crate) stage: StageProgress,
}

/// What a stage remembers beside its tensors.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) enum StageProgress {
    Geometry(GeometryProgress),
    Style(StyleProgress),
}

impl StageProgress {
    pub(crate) fn stage(&self) -> Stage {
        match self {
            Self::Geometry(_) => Stage::Geometry,
            Self::Style(_) => Stage::Style,
        }
    }
}

impl Position {
    /// Writes the checkpoint of a model folder; the one before is replaced once the new one has
    /// been read back whole.
    pub(crate) fn save(
        &self,
        folder: &Path,
        mut tensors: Vec<Entry>,
    ) -> Result<PathBuf, TrainError> {
        let path = folder.join(CHECKPOINT_FILE);
        let failed = |e: &dyn std::error::Error| TrainError::write(&path, &e);
        let json = serde_json::to_string(self).map_err(|e| failed(&e))?;
        tensors.sort_by(|a, b| a.name.cmp(&b.name));
        let all = tensors.iter().map(|entry| &entry.bytes[..]);
        let hash = hash_of(&json, all);
        let metadata = KEYS.map(str::to_owned).into_iter().zip([json, hash]);
        let bytes = serialize(&tensors, metadata.collect()).map_err(|e| failed(&e))?;
        write_verified(&path, &bytes, &|read| opened(read).is_ok()).map_err(|e| failed(&e))?;
        Ok(path)
    }
}

/// Of a header and its tensors, in the order of their names.
fn hash_of<'a>(json: &str, tensors: impl Iterator<Item = &'a [u8]>) -> String {
    let hash = Hash::of_bytes(json.as_bytes());
    format!("{:016x}", tensors.fold(hash, Hash::with_words).0)
}

/// A checkpoint as read.
#[derive(Debug)]
pub(crate) struct Checkpoint {
    path: PathBuf,
    bytes: Vec<u8>,
    pub(crate) position: Position,
}

impl Checkpoint {
    /// The one of a model folder, if it has one.
    ///
    /// # Errors
    /// If it is damaged or cannot be read.
    pub(crate) fn load(folder: &Path) -> Result<Option<Self>, TrainError> {
        let path = folder.join(CHECKPOINT_FILE);
        let failed = |reason: String| TrainError::Checkpoint {
            path: path.clone(),
            reason,
        };
        let bytes = match read_whole(&path, LARGEST_FILE) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(failed(format!("cannot be read ({})", plainly(&e)))),
        };
        let position = opened(&bytes).map_err(failed)?;
        Ok(Some(Self {
            path,
            bytes,
            position,
        }))
    }

    /// Hands its tensors to a stage that takes over.
    pub(crate) fn restore(
        &self,
        device: &Device,
        stage: impl FnOnce(&TensorReader<'_>) -> Result<(), String>,
    ) -> Result<(), TrainError> {
        let tensors = SafeTensors::deserialize(&self.bytes).map_err(|e| e.to_string());
        let restored = tensors.and_then(|tensors| {
            stage(&TensorReader {
                tensors: &tensors,
                device,
            })
        });
        restored.map_err(|reason| TrainError::Checkpoint {
            path: self.path.clone(),
            reason,
        })
    }

    /// Removes the one of a model folder, if it has one.
    pub(crate) fn remove(folder: &Path) -> Result<(), TrainError> {
        let path = folder.join(CHECKPOINT_FILE);
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(TrainError::write(&path, &e)),
            _ => Ok(()),
        }
    }
}

/// The header of a whole checkpoint.
fn opened(bytes: &[u8]) -> Result<Position, String> {
    let damaged = |e: &dyn std::fmt::Display| format!("is damaged ({e})");
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| damaged(&e))?;
    let tensors = SafeTensors::deserialize(bytes).map_err(|e| damaged(&e))?;
    let metadata = metadata.metadata().as_ref();
    let [json, hash] = KEYS.map(|key| metadata.and_then(|m| m.get(key)));
    let (Some(json), Some(hash)) = (json, hash) else {
        return Err("is a safetensors file, but no checkpoint of Impasto".into());
    };
    let mut all = tensors.tensors();
    all.sort_by(|a, b| a.0.cmp(&b.0));
    if hash_of(json, all.iter().map(|(_, tensor)| tensor.data())) != *hash {
        return Err("is damaged (its contents do not have the hash that it states)".into());
    }
    #[derive(Deserialize)]
    struct Version {
        version: u32,
    }
    let version = serde_json::from_str::<Version>(json).map(|v| v.version);
    match version {
        Ok(VERSION) => serde_json::from_str(json).map_err(|e| damaged(&e)),
        Ok(other) => Err(format!(
            "is of version {other}, this program goes on from {VERSION} only"
        )),
        Err(e) => Err(damaged(&e)),
    }
}
