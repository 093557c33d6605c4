//! Files that survive whatever ends the program, and folders that one run has to itself.

use crate::TrainError;
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::Path;

/// Ending of files that are being written.
const TEMPORARY: &str = "tmp";

/// Writes a file under a temporary name, flushes it to the disk and renames it, so that nobody
/// ever sees half of it and a crash leaves the old file or the new one.
///
/// # Errors
/// If the folder cannot be written. The old file is then still there.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    write_verified(path, bytes, &|_| true)
}

/// [`write_whole`] that reads the new file back and lets it take the old one's place only if
/// `right` accepts it.
pub(crate) fn write_verified(
    path: &Path,
    bytes: &[u8],
    right: &dyn Fn(&[u8]) -> bool,
) -> Result<(), TrainError> {
    let temporary = path.with_extension(TEMPORARY);
    let written = write_synced(&temporary, bytes).and_then(|()| {
        if !right(&std::fs::read(&temporary)?) {
            let problem = "what was written is not what can be read back; check the disk";
            return Err(io::Error::other(problem));
        }
        std::fs::rename(&temporary, path)?;
        sync_folder(path)
    });
    written.map_err(|e| {
        // Best effort: the write error is what matters.
        let _ = std::fs::remove_file(&temporary);
        TrainError::write(path, &e)
    })
}

fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Makes a rename last. Only Unix can open folders.
fn sync_folder(path: &Path) -> io::Result<()> {
    match path.parent() {
        Some(folder) if cfg!(unix) => File::open(folder)?.sync_all(),
        _ => Ok(()),
    }
}

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

/// Removes what a killed run was writing.
fn remove_leftovers(folder: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == TEMPORARY) {
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
    fn a_file_that_reads_back_wrong_does_not_replace_the_old_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.safetensors");
        write_whole(&path, b"old").unwrap();
        let error = write_verified(&path, b"new", &|bytes| bytes != b"new").unwrap_err();
        assert!(error.to_string().contains("check the disk"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        write_verified(&path, b"new", &|bytes| bytes == b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

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
