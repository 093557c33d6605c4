//! Finds the photos of a folder.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use image::ImageFormat;

use super::{LeftOut, PhotoSource};
use crate::error::PrepareError;
use crate::listing::paths_in;

/// Photos as phones and cameras store them that no decoder here reads.
const UNREADABLE: [&str; 13] = [
    "heic", "heif", "avif", "jxl", "dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "raw",
];

/// What a folder has, sorted by name.
struct Found {
    sources: Vec<PhotoSource>,
    left_out: Vec<LeftOut>,
    /// Folders that were searched, so that links in a circle end.
    visited: BTreeSet<PathBuf>,
    /// The capture that is being made.
    skip: Option<PathBuf>,
}

/// Files that could be photos, in `folder` and below, in the order of their names, and those that
/// could not. Hidden files, and the folder `scene` if it is in there, are passed over.
pub(crate) fn list(
    folder: &Path,
    scene: &Path,
) -> Result<(Vec<PhotoSource>, Vec<LeftOut>), PrepareError> {
    let mut found = Found {
        sources: Vec::new(),
        left_out: Vec::new(),
        visited: BTreeSet::new(),
        skip: scene.canonicalize().ok(),
    };
    found.search(folder, "")?;
    found.sources.sort_by(|a, b| a.name.cmp(&b.name));
    Ok((found.sources, found.left_out))
}

impl Found {
    fn search(&mut self, folder: &Path, above: &str) -> Result<(), PrepareError> {
        let whole = folder.canonicalize().map_err(PrepareError::read(folder))?;
        if self.skip.as_ref() == Some(&whole) || !self.visited.insert(whole) {
            return Ok(());
        }
        // In order: the first of two links to one folder is the same one everywhere.
        for path in paths_in(folder)? {
            let file_name = path.file_name().unwrap_or_default();
            let shown = file_name.to_string_lossy();
            if shown.starts_with('.') {
                continue;
            }
            let name = format!("{above}{shown}");
            // Follows links; broken ones are files that cannot be read.
            let reason = match fs::metadata(&path) {
                Ok(data) if data.is_dir() => {
                    self.search(&path, &format!("{name}/"))?;
                    continue;
                }
                Ok(data) if !data.is_file() => Some("not a regular file".into()),
                Ok(_) if file_name.to_str().is_none() => {
                    Some("its name is not UTF-8; rename it".into())
                }
                Ok(_) => why_not(&path),
                Err(error) => Some(format!("cannot be read ({error})")),
            };
            match reason {
                Some(reason) => self.left_out.push(LeftOut { file: name, reason }),
                None => self.sources.push(PhotoSource { name, path }),
            }
        }
        Ok(())
    }
}

/// Why a file is no photo, by its ending; `None` when it could be one.
fn why_not(path: &Path) -> Option<String> {
    let ending = path.extension()?.to_string_lossy().to_ascii_lowercase();
    if ImageFormat::from_extension(&ending).is_some_and(|format| format.reading_enabled()) {
        None
    } else if UNREADABLE.contains(&ending.as_str()) {
        Some(format!("{ending} is not read; convert it to JPEG"))
    } else {
        Some("not a photo by its ending".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_tell_photos_from_others() {
        assert_eq!(why_not(Path::new("a/b.JPG")), None);
        assert_eq!(why_not(Path::new("b.png")), None);
        assert!(why_not(Path::new("b.HEIC")).is_some_and(|r| r.contains("JPEG")));
        assert!(why_not(Path::new("notes.txt")).is_some());
    }

    #[test]
    fn a_file_without_an_ending_is_looked_at() {
        assert_eq!(why_not(Path::new("photo")), None);
    }
}
