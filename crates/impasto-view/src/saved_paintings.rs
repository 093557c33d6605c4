//! The paintings that favourites need, copied beside them.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use impasto_scene::file::write_atomic;

use crate::names::{plain_name, short_hash};

/// Begins the id of a favourite's painting.
pub(crate) const SAVED: &str = "saved:";
/// Folder of the paintings, below that of the favourites.
const PAINTINGS: &str = "paintings";

/// The folder of a model's favourites.
pub(crate) fn favourites_folder(model: &Path) -> PathBuf {
    let above = if model.is_file() {
        model.parent().unwrap_or(model)
    } else {
        model
    };
    above.join("favourites")
}

/// The folder of the paintings.
pub(crate) struct SavedPaintings(PathBuf);

impl SavedPaintings {
    pub(crate) fn new(model: &Path) -> Self {
        Self(favourites_folder(model).join(PAINTINGS))
    }

    /// Makes the folder where missing.
    pub(crate) fn create(&self) -> io::Result<()> {
        fs::create_dir_all(&self.0)
    }

    /// Names of the files, sorted.
    pub(crate) fn list(&self) -> Vec<String> {
        names(&self.0, |name| is_painting(name).then(|| name.to_owned()))
    }

    /// Where a painting is.
    pub(crate) fn path(&self, file: &str) -> Option<PathBuf> {
        let path = self.0.join(file);
        (is_painting(file) && path.is_file()).then_some(path)
    }

    /// Copies a painting here that has this name elsewhere; the name of its file.
    pub(crate) fn add(&self, name: &str, bytes: &[u8]) -> io::Result<String> {
        let file = format!("{}-{}", short_hash(bytes), file_name(name));
        let to = self.0.join(&file);
        if !to.is_file() {
            write_atomic(&to, bytes)?;
        }
        Ok(file)
    }
}

/// The path of a painting's file relative to the favourites.
pub(crate) fn relative(file: &str) -> String {
    format!("{PAINTINGS}/{file}")
}

/// The id of the painting at such a path.
pub(crate) fn id_of_relative(path: &str) -> Option<String> {
    let file = path.strip_prefix(PAINTINGS)?.strip_prefix('/')?;
    Some(format!("{SAVED}{file}"))
}

/// What `of` makes of the names in a folder, sorted; nothing where there is no folder.
pub(crate) fn names(folder: &Path, of: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| of(entry.file_name().to_str()?))
        .collect();
    names.sort();
    names
}

/// Whether a copied painting may be called so.
fn is_painting(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let hash = name.split_once('-').map_or("", |(hash, _)| hash);
    name.len() <= 100
        && name.chars().all(plain)
        && hash.len() == 16
        && hash.chars().all(|c| c.is_ascii_hexdigit())
}

/// The last part of a painting's name, as a file's name.
fn file_name(name: &str) -> String {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    // The end, which says what kind of file it is.
    let cut = last.chars().count().saturating_sub(60);
    plain_name(last).chars().skip(cut).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_folder() {
        for name in [
            "../0123456789abcdef-x",
            "0123456789abcdef",
            "0123456789abcdeg-x.png",
            "0123456789abcdef-../x",
            "-x.png",
        ] {
            assert!(!is_painting(name), "{name}");
        }
        let file = format!(
            "0123456789abcdef-{}",
            file_name("../a ü/..\\my picture.jpg")
        );
        assert_eq!(file, "0123456789abcdef-my_picture.jpg");
        assert!(is_painting(&file));
    }
}
