//! Finds the photos of a folder.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use image::ImageFormat;

use super::{LeftOut, Source};
use crate::error::PrepareError;

/// Photos as phones and cameras store them that no decoder here reads.
const UNREADABLE: [&str; 13] = [
    "heic", "heif", "avif", "jxl", "dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "raw",
];

/// What a folder has, sorted by name.
struct Found {
    sources: Vec<Source>,
    left_out: Vec<LeftOut>,
    /// Folders that were looked into, so that links in a circle end.
    visited: BTreeSet<PathBuf>,
    /// The capture that is being made.
    skip: Option<PathBuf>,
}

/// Files that could be photos, in `folder` and below, in the order of their names, and those that
/// could not. Hidden files, and the folder `scene` if it is in there, are passed over.
pub(crate) fn list(
    folder: &Path,
    scene: &Path,
) -> Result<(Vec<Source>, Vec<LeftOut>), PrepareError> {
    let mut found = Found {
        sources: Vec::new(),
        left_out: Vec::new(),
        visited: BTreeSet::new(),
        skip: scene.canonicalize().ok(),
    };
    found.look(folder, "")?;
    found.sources.sort_by(|a, b| a.name.cmp(&b.name));
    Ok((found.sources, found.left_out))
}

impl Found {
    fn look(&mut self, folder: &Path, above: &str) -> Result<(), PrepareError> {
        let whole = folder.canonicalize().map_err(PrepareError::read(folder))?;
        if self.skip.as_ref() == Some(&whole) || !self.visited.insert(whole) {
            return Ok(());
        }
        let mut entries = Vec::new();
        for entry in fs::read_dir(folder).map_err(PrepareError::read(folder))? {
            entries.push(entry.map_err(PrepareError::read(folder))?.file_name());
        }
        // The first of two links to one folder is the same one everywhere.
        entries.sort();
        for file_name in entries {
            let path = folder.join(&file_name);
            let name = format!("{above}{}", file_name.to_string_lossy());
            if file_name.to_string_lossy().starts_with('.') {
                continue;
            }
            // Follows links; broken ones are files that cannot be read.
            match fs::metadata(&path) {
                Ok(data) if data.is_dir() => self.look(&path, &format!("{name}/"))?,
                Ok(data) if data.is_file() => {
                    let reason = match file_name.to_str() {
                        Some(_) => why_not(&path),
                        None => Some("its name is not UTF-8; rename it".into()),
                    };
                    match reason {
                        Some(reason) => self.left_out.push(LeftOut { file: name, reason }),
                        None => self.sources.push(Source { name, path }),
                    }
                }
                Ok(_) => self.left_out.push(LeftOut {
                    file: name,
                    reason: "not a regular file".into(),
                }),
                Err(error) => self.left_out.push(LeftOut {
                    file: name,
                    reason: format!("cannot be read ({error})"),
                }),
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
