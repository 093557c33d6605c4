//! The models that COLMAP made.

use std::fs;
use std::path::{Path, PathBuf};

use impasto_scene::colmap_photo_names;

use crate::error::PrepareError;
use crate::log::Log;

/// One of COLMAP's models.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Model {
    /// Its folder.
    pub(crate) folder: PathBuf,
    /// Names of the photos that it has poses for, sorted.
    pub(crate) photos: Vec<String>,
}

/// All models in the folder `models`, the one with the most photos first.
pub(crate) fn models(models: &Path, log: &Log) -> Result<Vec<Model>, PrepareError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(models).map_err(PrepareError::read(models))? {
        let folder = entry.map_err(PrepareError::read(models))?.path();
        if folder.join("images.bin").is_file() {
            let photos = colmap_photo_names(&folder).map_err(|source| PrepareError::Scene {
                source,
                log: log.destination().to_owned(),
            })?;
            found.push(Model { folder, photos });
        }
    }
    found.sort_by(|a, b| {
        let size = b.photos.len().cmp(&a.photos.len());
        size.then_with(|| a.folder.cmp(&b.folder))
    });
    Ok(found)
}

/// Whether nothing is in the folder `models`.
pub(super) fn is_empty(models: &Path) -> bool {
    fs::read_dir(models).is_ok_and(|mut entries| entries.next().is_none())
}
