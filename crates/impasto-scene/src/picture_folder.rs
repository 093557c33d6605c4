//! Folders of pictures, of any size and depth: what is there, without reading it.

use crate::error::SceneError;
use crate::file::plainly;
use crate::picture_file::read_rgb;
use image::RgbImage;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// One file of a [`PictureFolder`].
#[derive(Debug, Clone)]
pub struct PictureFile {
    /// Path within the folder, parts separated by `/`.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// When it was last changed, nanoseconds since 1970; 0 where that is not known.
    pub changed: u128,
}

impl PictureFile {
    /// Reads the picture.
    ///
    /// # Errors
    /// The reason alone, if it cannot be read or is no picture.
    pub fn read(&self) -> Result<RgbImage, String> {
        read_rgb(&self.path).map_err(|error| match error {
            SceneError::Photo { problem, .. } => problem,
            SceneError::Io { source, .. } => plainly(&source),
            other => other.to_string(),
        })
    }
}

/// A folder of pictures with its sub-folders.
#[derive(Debug, Clone, Default)]
pub struct PictureFolder {
    /// The folder.
    pub path: PathBuf,
    /// Its files in the order of their names, pictures or not.
    pub files: Vec<PictureFile>,
    /// Files and folders that cannot be looked at, with the reason.
    pub unreadable: Vec<(PathBuf, String)>,
}

impl PictureFolder {
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
                self.files.push(PictureFile {
                    name,
                    path,
                    bytes: facts.len(),
                    changed,
                });
            }
            // Sockets and pipes.
            Ok(_) => {}
            Err(error) => self.unreadable.push((path, plainly(&error))),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use std::fs;

    fn names(folder: &PictureFolder) -> Vec<&str> {
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
        let folder = PictureFolder::walk(dir.path()).unwrap();
        assert_eq!(names(&folder), ["a/deep/y.jpg", "b/x.png", "c.png"]);
        assert!(PictureFolder::walk(&dir.path().join("none")).is_err());
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
        let folder = PictureFolder::walk(dir.path()).unwrap();
        assert_eq!(names(&folder), ["a/x.png"]);
        assert_eq!(folder.unreadable.len(), 1);
        assert!(folder.unreadable[0].0.ends_with("broken.png"));
    }
}
