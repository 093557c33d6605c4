//! The capture's folder while it is being made.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

use crate::error::PrepareError;
use crate::listing::paths_in;
use crate::log::CommandLog;

/// Everything in the making is in this hidden folder inside the capture's.
const WORK: &str = ".impasto-prepare";
/// Held by the process that is at work.
const LOCK: &str = "lock";
const LOG: &str = "colmap.log";
/// What a finished capture has, in the order in which it is moved to its place: readers look for
/// the last one.
const PARTS: [&str; 3] = ["images", "capture.png", "sparse"];

/// A capture in the making. Dropped without [`SceneFolder::finish`], it leaves the log at most.
pub(crate) struct SceneFolder {
    scene: PathBuf,
    /// Folders that were made for this, outermost first.
    made: Vec<PathBuf>,
    lock: Option<File>,
}

/// Whether a capture may be made at `scene`: nothing is there, or nothing but what an earlier,
/// unfinished run has left.
pub(crate) fn check(scene: &Path) -> Result<(), PrepareError> {
    if !scene.exists() {
        return Ok(());
    }
    let begun = scene.join(WORK).is_dir();
    for path in paths_in(scene)? {
        let name = path.file_name().unwrap_or_default();
        let ours =
            name == WORK || name == LOG || (begun && PARTS[..2].iter().any(|&part| name == part));
        if !ours {
            return Err(PrepareError::Occupied {
                path: scene.to_owned(),
                found: name.to_string_lossy().into_owned(),
            });
        }
    }
    Ok(())
}

impl SceneFolder {
    /// Makes the folders, or takes over those of an unfinished run and empties them.
    pub(crate) fn new(scene: &Path) -> Result<Self, PrepareError> {
        check(scene)?;
        let mut folder = Self {
            scene: scene.to_owned(),
            made: Vec::new(),
            lock: None,
        };
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = scene.ancestors().take_while(is_missing).collect();
        for path in missing.into_iter().rev() {
            fs::create_dir(path).map_err(PrepareError::write(path))?;
            folder.made.push(path.to_owned());
        }
        let work = folder.work();
        fs::create_dir_all(&work).map_err(PrepareError::write(scene))?;
        let lock = File::create(work.join(LOCK)).map_err(PrepareError::write(scene))?;
        // File systems without locks are worked on without one.
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(PrepareError::Busy(scene.to_owned()));
        }
        folder.lock = Some(lock);
        folder.clear()?;
        Ok(folder)
    }

    /// Where everything is made.
    pub(crate) fn work(&self) -> PathBuf {
        self.scene.join(WORK)
    }

    /// Where the finished parts are put together.
    pub(crate) fn ready(&self) -> PathBuf {
        self.work().join("scene")
    }

    /// Begins the log.
    pub(crate) fn log(&self) -> Result<CommandLog, PrepareError> {
        CommandLog::new(self.work().join(LOG), self.scene.join(LOG))
    }

    /// Moves the finished parts and the log to their places.
    pub(crate) fn finish(self) -> Result<(), PrepareError> {
        self.keep_log();
        for part in PARTS {
            let to = self.scene.join(part);
            fs::rename(self.ready().join(part), &to).map_err(PrepareError::write(&to))?;
        }
        Ok(())
    }

    fn keep_log(&self) {
        let (from, to) = (self.work().join(LOG), self.scene.join(LOG));
        if fs::metadata(&from).is_ok_and(|log| log.len() > 0) {
            // A log that cannot be kept is no reason to lose the capture, or to hide an error.
            let _ = fs::rename(from, to);
        }
    }

    fn clear(&self) -> Result<(), PrepareError> {
        let begun = paths_in(&self.work())?.into_iter();
        let begun = begun.filter(|path| !path.ends_with(LOCK));
        let parts = PARTS.map(|part| self.scene.join(part)).into_iter();
        let mut all = begun.chain(parts.filter(|path| path.exists()));
        all.try_for_each(|path| remove(&path))
    }
}

impl Drop for SceneFolder {
    fn drop(&mut self) {
        // Without the lock, the files are another process's.
        if self.lock.is_some() {
            self.keep_log();
            let _ = fs::remove_dir_all(self.work());
        }
        for folder in self.made.iter().rev() {
            // Fails, as it should, where something was put into it.
            let _ = fs::remove_dir(folder);
        }
    }
}

fn remove(path: &Path) -> Result<(), PrepareError> {
    let removed = if path.is_dir() && !path.is_symlink() {
        fs::remove_dir_all(path)
    } else {
        fs::remove_file(path)
    };
    removed.map_err(PrepareError::write(path))
}
