//! Folders of paintings, of any size and depth: what is there, without reading it.

use crate::TrainError;
use crate::hash::Hash;
use image::RgbImage;
use impasto_scene::file::plainly;
use impasto_scene::{SceneError, read_rgb};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// One file of a [`StyleFolder`].
#[derive(Debug, Clone)]
pub struct StyleFile {
    /// Path within the folder, parts separated by `/`.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// Changes when the name, the size or the time of the last change does.
    pub(crate) identity: u64,
}

impl StyleFile {
    /// Reads the picture; the error is the reason alone.
    pub(crate) fn read(&self) -> Result<RgbImage, String> {
        read_rgb(&self.path).map_err(|error| match error {
            SceneError::Photo { problem, .. } => problem,
            SceneError::Io { source, .. } => plainly(&source),
            other => other.to_string(),
        })
    }
}

/// A folder of paintings with its sub-folders.
#[derive(Debug, Clone, Default)]
pub struct StyleFolder {
    /// The folder.
    pub path: PathBuf,
    /// Its files in the order of their names, pictures or not.
    pub files: Vec<StyleFile>,
    /// Files and folders that cannot be looked at, with the reason.
    pub unreadable: Vec<(PathBuf, String)>,
}

impl StyleFolder {
    /// Lists all files below a folder, through links too, each real folder once. Names that begin
    /// with a dot are left out.
    ///
    /// # Errors
    /// If the folder itself cannot be listed.
    pub fn walk(path: &Path) -> std::io::Result<Self> {
        let mut folder = Self {
            path: path.to_owned(),
            ..Self::default()
        };
        let mut seen = HashSet::from([path.canonicalize()?]);
        let mut waiting = vec![(path.to_owned(), String::new())];
        let mut is_root = true;
        while let Some((dir, prefix)) = waiting.pop() {
            let listed: std::io::Result<Vec<_>> =
                std::fs::read_dir(&dir).and_then(Iterator::collect);
            match listed {
                Ok(entries) => {
                    for entry in entries {
                        let name = entry.file_name().to_string_lossy().into_owned();
                        if !name.starts_with('.') {
                            let name = format!("{prefix}{name}");
                            folder.meet(entry.path(), name, &mut seen, &mut waiting);
                        }
                    }
                }
                Err(error) if is_root => return Err(error),
                Err(error) => folder.unreadable.push((dir, plainly(&error))),
            }
            is_root = false;
        }
        folder.files.sort_by(|a, b| a.name.cmp(&b.name));
        folder.unreadable.sort();
        Ok(folder)
    }

    fn meet(
        &mut self,
        path: PathBuf,
        name: String,
        seen: &mut HashSet<PathBuf>,
        waiting: &mut Vec<(PathBuf, String)>,
    ) {
        // Follows links.
        match std::fs::metadata(&path) {
            Ok(facts) if facts.is_dir() => {
                if path.canonicalize().is_ok_and(|real| seen.insert(real)) {
                    waiting.push((path, format!("{name}/")));
                }
            }
            Ok(facts) if facts.is_file() => {
                let changed = facts.modified().ok();
                let changed = changed.and_then(|t| t.duration_since(UNIX_EPOCH).ok());
                let changed = changed.map_or(0, |t| t.as_nanos());
                let identity = Hash::of(&name).and(&facts.len()).and(&changed).0;
                self.files.push(StyleFile {
                    name,
                    path,
                    identity,
                });
            }
            // Sockets and pipes.
            Ok(_) => {}
            Err(error) => self.unreadable.push((path, plainly(&error))),
        }
    }

    /// Of names and sizes of all files, so that a copy of the folder is the same.
    pub(crate) fn identity(&self) -> u64 {
        let count = Hash::of(&self.files.len());
        let files = self.files.iter().fold(count, |hash, file| {
            let size = std::fs::metadata(&file.path).map_or(0, |facts| facts.len());
            hash.and(&file.name).and(&size)
        });
        files.0
    }

    /// The folder of a run: at least one file of it is a picture.
    ///
    /// # Errors
    /// If there is no readable picture.
    pub fn of_paintings(path: &Path) -> Result<Self, TrainError> {
        let fault = |reason: String| TrainError::Styles {
            path: path.to_owned(),
            reason,
        };
        let folder =
            Self::walk(path).map_err(|e| fault(format!("cannot be read ({})", plainly(&e))))?;
        let mut first = None;
        for file in &folder.files {
            match file.read() {
                Ok(_) => return Ok(folder),
                Err(reason) => first = first.or(Some((file.path.clone(), reason))),
            }
        }
        Err(fault(
            match first.or_else(|| folder.unreadable.first().cloned()) {
                None => "is empty; put paintings there (JPEG, PNG, WebP, TIFF or GIF)".into(),
                Some((path, reason)) => format!(
                    "holds no readable painting; {}, for one: {reason}",
                    path.display()
                ),
            },
        ))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use std::fs;

    fn names(folder: &StyleFolder) -> Vec<&str> {
        folder.files.iter().map(|f| f.name.as_str()).collect()
    }

    #[test]
    fn sub_folders_are_walked_in_order() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b/x.png", "a/deep/y.jpg", "c.png", ".hidden/z.png", ".dot"] {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, name).unwrap();
        }
        let folder = StyleFolder::walk(dir.path()).unwrap();
        assert_eq!(names(&folder), ["a/deep/y.jpg", "b/x.png", "c.png"]);
        assert!(StyleFolder::walk(&dir.path().join("none")).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn loops_of_links_end_and_broken_ones_are_named() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("a")).unwrap();
        fs::write(dir.path().join("a/x.png"), "").unwrap();
        symlink(dir.path(), dir.path().join("a/up")).unwrap();
        symlink("nowhere", dir.path().join("broken.png")).unwrap();
        let folder = StyleFolder::walk(dir.path()).unwrap();
        assert_eq!(names(&folder), ["a/x.png"]);
        assert_eq!(folder.unreadable.len(), 1);
        assert!(folder.unreadable[0].0.ends_with("broken.png"));
    }

    #[test]
    fn a_changed_file_has_another_identity() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.png");
        let identity = |bytes: &str| {
            fs::write(&path, bytes).unwrap();
            StyleFolder::walk(dir.path()).unwrap().files[0].identity
        };
        assert_ne!(identity("one"), identity("three"));
    }

    #[test]
    fn a_folder_without_pictures_says_why() {
        let dir = tempfile::tempdir().unwrap();
        let message = |dir: &Path| StyleFolder::of_paintings(dir).unwrap_err().to_string();
        assert!(message(dir.path()).contains("is empty"));
        fs::write(dir.path().join("notes.txt"), "none").unwrap();
        let said = message(dir.path());
        assert!(said.contains("no readable painting") && said.contains("notes.txt"));
    }
}
