//! Files that appear all at once.

use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};

use impasto::scene::file::write_atomic;
use tempfile::TempDir;

use crate::cli::CliError;

/// Files in the making, in a hidden folder within the folder where they will be. Dropped without
/// [`Staging::commit`], it leaves no trace.
///
/// Several files that belong together, of which others (ffmpeg, a ZIP's writer) may write one: more
/// than [`write_atomic`] does, which has the bytes of a single one.
pub struct Staging {
    target: PathBuf,
    /// Folders that were made for this, outermost first.
    made: Vec<PathBuf>,
    /// Taken only when dropped.
    temporary: Option<TempDir>,
    names: Vec<String>,
}

impl Staging {
    /// Makes `target` (and the folders above it) where missing.
    ///
    /// # Errors
    /// When `target` cannot be made or written to.
    pub fn new(target: &Path) -> Result<Self, CliError> {
        let mut staging = Self {
            target: target.to_owned(),
            made: Vec::new(),
            temporary: None,
            names: Vec::new(),
        };
        let missing: Vec<&Path> = target
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists())
            .collect();
        for folder in missing.into_iter().rev() {
            fs::create_dir(folder).map_err(CliError::write(folder))?;
            staging.made.push(folder.to_owned());
        }
        let temporary = tempfile::Builder::new()
            .prefix(".impasto-")
            .tempdir_in(target)
            // The temporary name would only puzzle; the folder is what matters.
            .map_err(|error| CliError::write(target)(error.kind().into()))?;
        staging.temporary = Some(temporary);
        Ok(staging)
    }

    /// The path at which to write the file that will be `name`, which may lie in sub-folders.
    pub fn file(&mut self, name: &str) -> Result<PathBuf, CliError> {
        let path = self.temporary().join(name);
        let folder = parent(&path);
        fs::create_dir_all(&folder).map_err(CliError::write(&folder))?;
        self.names.push(name.to_owned());
        Ok(path)
    }

    /// Writes the file that will be `name`.
    pub fn write(&mut self, name: &str, bytes: impl AsRef<[u8]>) -> Result<(), CliError> {
        let path = self.file(name)?;
        // The temporary name would only puzzle.
        fs::write(path, bytes).map_err(CliError::write(&self.target.join(name)))
    }

    /// Moves the files to their places, in the order in which they were named. An older file in
    /// the place of the last one is removed first: whoever finds the last file finds all.
    pub fn commit(self) -> Result<(), CliError> {
        if let Some(last) = self.names.last().map(|name| self.target.join(name)) {
            match fs::remove_file(&last) {
                Err(error) if last.exists() => return Err(CliError::write(&last)(error)),
                _ => {}
            }
        }
        for name in &self.names {
            let to = self.target.join(name);
            let folder = parent(&to);
            fs::create_dir_all(&folder).map_err(CliError::write(&folder))?;
            fs::rename(self.temporary().join(name), &to).map_err(CliError::write(&to))?;
        }
        Ok(())
    }

    fn temporary(&self) -> &Path {
        self.temporary
            .as_ref()
            .map_or(&self.target, |folder| folder.path())
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        drop(self.temporary.take());
        for folder in self.made.iter().rev() {
            // Fails, as it should, where something was put into it.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Whether files can be written to `folder`, which may not exist yet and is left as it was.
pub fn check_folder(folder: &Path) -> Result<(), CliError> {
    Staging::new(folder).map(drop)
}

/// Writes one file, and makes the folders above it where missing.
pub fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), CliError> {
    // Removes the folders that it made if nothing comes into them.
    let _folders = Staging::new(&parent(path))?;
    write_atomic(path, bytes.as_ref()).map_err(CliError::write(path))
}

/// The folder that a file is in.
pub fn parent(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => ".".into(),
    }
}

/// A file's name without its folder.
pub fn file_name(path: &Path) -> Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_without_a_commit() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("a/b");
        let mut staging = Staging::new(&target).unwrap();
        fs::write(staging.file("sub/x.txt").unwrap(), "half").unwrap();
        drop(staging);
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_commit_adds_to_what_is_there() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("mine.txt"), "kept").unwrap();
        fs::write(root.path().join("x.txt"), "old").unwrap();
        let mut staging = Staging::new(root.path()).unwrap();
        for name in ["sub/y.txt", "x.txt"] {
            fs::write(staging.file(name).unwrap(), "new").unwrap();
        }
        staging.commit().unwrap();
        let text = |name| fs::read_to_string(root.path().join(name)).unwrap();
        assert_eq!(
            (text("mine.txt"), text("x.txt"), text("sub/y.txt")),
            ("kept".into(), "new".into(), "new".into())
        );
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 3);
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        fs::write(&file, "").unwrap();
        for target in [file.clone(), file.join("below")] {
            let problem = check_folder(&target).unwrap_err().to_string();
            assert!(problem.contains("file"), "{problem}");
        }
    }
}
