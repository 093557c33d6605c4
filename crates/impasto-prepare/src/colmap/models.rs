//! The models that COLMAP made.

use std::cmp::Reverse;
use std::fs;
use std::path::{Path, PathBuf};

use impasto_scene::colmap_photo_names;

use crate::error::PrepareError;
use crate::listing::paths_in;
use crate::log::CommandLog;

/// One of COLMAP's models.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SparseModel {
    /// Its folder.
    pub(crate) folder: PathBuf,
    /// Names of the photos that it has poses for, sorted.
    pub(crate) photos: Vec<String>,
}

/// All models in the folder `models`, the one with the most photos first.
pub(crate) fn models(models: &Path, log: &CommandLog) -> Result<Vec<SparseModel>, PrepareError> {
    let mut found = Vec::new();
    for folder in paths_in(models)? {
        if folder.join("images.bin").is_file() {
            let photos = colmap_photo_names(&folder).map_err(|source| log.unusable(source))?;
            found.push(SparseModel { folder, photos });
        }
    }
    // Of two equals the one whose folder comes first stays first.
    found.sort_by_key(|model| Reverse(model.photos.len()));
    Ok(found)
}

/// Whether nothing is in the folder `models`.
pub(super) fn is_empty(models: &Path) -> bool {
    fs::read_dir(models).is_ok_and(|mut entries| entries.next().is_none())
}
