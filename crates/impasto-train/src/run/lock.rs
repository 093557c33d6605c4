//! Folders that one run has to itself.

use crate::TrainError;
use impasto_scene::file::name_of_temporary;
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::Path;

/// The right to write to a folder, held until it is dropped or the process ends, however it ends.
#[derive(Debug)]
pub(crate) struct FolderLock {
    _file: File,
}

/// File that is locked. It stays, since removing it would let two runs in.
const LOCK_FILE: &str = ".lock";

impl FolderLock {
    /// Takes the lock of a folder, which is made where missing. File systems that cannot lock let
    /// everybody in.
    pub(crate) fn take(folder: &Path) -> Result<Self, TrainError> {
        std::fs::create_dir_all(folder).map_err(|e| TrainError::write(folder, &e))?;
        let path = folder.join(LOCK_FILE);
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options
            .open(&path)
            .map_err(|e| TrainError::write(&path, &e))?;
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            let mut process = String::new();
            // Who it is only helps; the refusal does not depend on it.
            let _ = file.take(20).read_to_string(&mut process);
            return Err(TrainError::Busy {
                folder: folder.to_owned(),
                process: process.trim().to_owned(),
            });
        }
        remove_leftovers(folder).map_err(|e| TrainError::write(folder, &e))?;
        let noted = file.set_len(0).and_then(|()| file.rewind());
        noted
            .and_then(|()| writeln!(file, "{}", std::process::id()))
            .map_err(|e| TrainError::write(&path, &e))?;
        Ok(Self { _file: file })
    }
}

/// Removes what a killed run was writing, and nothing of anybody else.
fn remove_leftovers(folder: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if name.and_then(name_of_temporary).is_some() {
            std::fs::remove_file(path)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn a_folder_has_one_writer_at_a_time() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("model");
        let lock = FolderLock::take(&folder).unwrap();
        let error = FolderLock::take(&folder).unwrap_err().to_string();
        assert!(error.contains(&std::process::id().to_string()), "{error}");
        drop(lock);
        FolderLock::take(&folder).unwrap();
    }
}
