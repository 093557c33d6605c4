//! What is in a folder.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::PrepareError;

/// Paths of what is in a folder, in order.
pub(crate) fn paths_in(folder: &Path) -> Result<Vec<PathBuf>, PrepareError> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(PrepareError::read(folder))? {
        paths.push(entry.map_err(PrepareError::read(folder))?.path());
    }
    paths.sort();
    Ok(paths)
}
