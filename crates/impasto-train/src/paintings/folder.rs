//! Folders of paintings.

use crate::TrainError;
use crate::hash::Hash;
use impasto_scene::file::plainly;
use impasto_scene::{PictureFile, PictureFolder};
use std::path::Path;

/// Of a file: changes when the name, the size or the time of the last change does.
pub(crate) fn file_identity(file: &PictureFile) -> u64 {
    Hash::of(&file.name).and(&file.bytes).and(&file.changed).0
}

/// Of names and sizes of all files, so that a copy of the folder is the same.
pub(crate) fn folder_identity(folder: &PictureFolder) -> u64 {
    let count = Hash::of(&folder.files.len());
    let files = folder.files.iter();
    files
        .fold(count, |hash, file| hash.and(&file.name).and(&file.bytes))
        .0
}

/// The folder of a run: at least one file of it is a picture.
///
/// # Errors
/// If there is no readable picture.
pub fn painting_folder(path: &Path) -> Result<PictureFolder, TrainError> {
    let fault = |reason: String| TrainError::Styles {
        path: path.to_owned(),
        reason,
    };
    let folder = PictureFolder::walk(path)
        .map_err(|e| fault(format!("cannot be read ({})", plainly(&e))))?;
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use std::fs;

    #[test]
    fn a_changed_file_has_another_identity() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.png");
        let identity = |bytes: &str| {
            fs::write(&path, bytes).unwrap();
            file_identity(&PictureFolder::walk(dir.path()).unwrap().files[0])
        };
        assert_ne!(identity("one"), identity("three"));
    }

    #[test]
    fn a_folder_without_pictures_says_why() {
        let dir = tempfile::tempdir().unwrap();
        let message = |dir: &Path| painting_folder(dir).unwrap_err().to_string();
        assert!(message(dir.path()).contains("is empty"));
        fs::write(dir.path().join("notes.txt"), "none").unwrap();
        let said = message(dir.path());
        assert!(said.contains("no readable painting") && said.contains("notes.txt"));
    }
}
