//! Favourites: coats saved beside the model, with the paintings that they need.
//!
//! `MODEL/favourites/NAME.json` holds coats whose paintings are paths below that folder, so that
//! `impasto render --coats` reads it as it is.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use impasto_scene::file::{plainly, read_whole};
use impasto_train::Coats;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::gallery::Gallery;

/// Begins the id of a favourite's painting.
pub(crate) const SAVED: &str = "saved:";
/// Folder of the paintings, below that of the favourites.
const PAINTINGS: &str = "paintings";
/// Longest name of a favourite, in characters.
const LONGEST_NAME: usize = 64;
/// Most favourites, and bytes of one.
const MOST: usize = 500;
const LARGEST: u64 = 1 << 20;

/// Why a favourite was not saved, read or removed.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Unsaved {
    /// The name cannot be a file's.
    Name(String),
    /// There is no such favourite.
    Unknown(String),
    /// A painting of it is not to be had.
    Painting(String),
    /// The disk refuses.
    Disk(String),
}

/// The folder of favourites.
pub(crate) struct Shelf {
    folder: PathBuf,
    /// Held while it is changed.
    changing: Mutex<()>,
}

impl Shelf {
    pub(crate) fn new(model: &Path) -> Self {
        let above = match model.is_file() {
            true => model.parent().unwrap_or(model),
            false => model,
        };
        Self {
            folder: above.join("favourites"),
            changing: Mutex::default(),
        }
    }

    fn file(&self, name: &str) -> Result<PathBuf, Unsaved> {
        match is_safe(name) {
            true => Ok(self.folder.join(format!("{name}.json"))),
            false => Err(Unsaved::Name(format!(
                "a favourite cannot be called that; use 1 to {LONGEST_NAME} letters, digits, blanks, \
                 - and _"
            ))),
        }
    }

    /// Names of the files that paintings were copied to, sorted.
    pub(crate) fn paintings(&self) -> Vec<String> {
        names(&self.folder.join(PAINTINGS), |name| {
            is_painting(name).then(|| name.to_owned())
        })
    }

    /// Where a copied painting is.
    pub(crate) fn painting(&self, file: &str) -> Option<PathBuf> {
        let path = self.folder.join(PAINTINGS).join(file);
        (is_painting(file) && path.is_file()).then_some(path)
    }

    /// All favourites, sorted by name; what is no favourite is left out.
    pub(crate) fn list(&self) -> Vec<Value> {
        let named = names(&self.folder, |name| {
            let name = name.strip_suffix(".json")?;
            is_safe(name).then(|| name.to_owned())
        });
        let read = |name: &String| {
            let bytes = read_whole(&self.folder.join(format!("{name}.json")), LARGEST).ok()?;
            let mut coats: Coats = serde_json::from_slice(&bytes).ok()?;
            coats.check().ok()?;
            rename(&mut coats, |painting| {
                let file = painting.strip_prefix(PAINTINGS)?.strip_prefix('/')?;
                Some(format!("{SAVED}{file}"))
            });
            Some(json!({"name": name, "coats": coats.coats}))
        };
        named.iter().filter_map(read).collect()
    }

    /// Saves a favourite with its paintings.
    pub(crate) fn save(
        &self,
        name: &str,
        mut coats: Coats,
        gallery: &Gallery,
    ) -> Result<(), Unsaved> {
        let path = self.file(name)?;
        let disk = |e: io::Error| {
            Unsaved::Disk(format!("the favourite cannot be saved ({})", plainly(&e)))
        };
        let _changing = self.changing.lock().unwrap_or_else(PoisonError::into_inner);
        let is_known = path.is_file();
        if !is_known && self.list().len() >= MOST {
            return Err(Unsaved::Disk(format!(
                "there are {MOST} favourites already; remove one first"
            )));
        }
        fs::create_dir_all(self.folder.join(PAINTINGS)).map_err(disk)?;
        let mut failed = None;
        rename(&mut coats, |painting| {
            self.copy(painting, gallery).unwrap_or_else(|e| {
                failed.get_or_insert(e);
                None
            })
        });
        if let Some(failed) = failed {
            return Err(failed);
        }
        let text = serde_json::to_vec_pretty(&coats).map_err(|e| disk(e.into()))?;
        write_whole(&path, &text).map_err(disk)
    }

    /// Copies a painting here; its path relative to the favourites, or `None` for one that needs no
    /// file.
    fn copy(&self, painting: &str, gallery: &Gallery) -> Result<Option<String>, Unsaved> {
        let Some((path, name)) = gallery.file(painting).map_err(Unsaved::Painting)? else {
            return Ok(None);
        };
        if let Some(file) = painting.strip_prefix(SAVED) {
            return Ok(Some(format!("{PAINTINGS}/{file}")));
        }
        let bytes = gallery.bytes(&path).map_err(Unsaved::Painting)?;
        let digest = Sha256::digest(&bytes);
        let hash: String = digest.iter().take(8).map(|b| format!("{b:02x}")).collect();
        let file = format!("{hash}-{}", file_name(&name));
        let to = self.folder.join(PAINTINGS).join(&file);
        if !to.is_file() {
            write_whole(&to, &bytes).map_err(|e| {
                Unsaved::Disk(format!("the painting cannot be saved ({})", plainly(&e)))
            })?;
        }
        Ok(Some(format!("{PAINTINGS}/{file}")))
    }

    /// Removes a favourite. Its paintings stay: others may need them.
    pub(crate) fn remove(&self, name: &str) -> Result<(), Unsaved> {
        let path = self.file(name)?;
        fs::remove_file(&path).map_err(|e| match e.kind() {
            io::ErrorKind::NotFound => {
                Unsaved::Unknown(format!("there is no favourite \"{name}\""))
            }
            _ => Unsaved::Disk(format!("the favourite cannot be removed ({})", plainly(&e))),
        })
    }
}

/// Gives paintings other names, where `to` has one.
fn rename(coats: &mut Coats, mut to: impl FnMut(&str) -> Option<String>) {
    for coat in &mut coats.coats {
        for painting in &mut coat.paintings {
            if let Some(name) = to(&painting.painting) {
                painting.painting = name;
            }
        }
    }
}

/// What `of` makes of the names in a folder, sorted; nothing where there is no folder.
fn names(folder: &Path, of: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| of(entry.file_name().to_str()?))
        .collect();
    names.sort();
    names
}

fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let temporary = path.with_extension("tmp");
    let written = fs::write(&temporary, bytes).and_then(|()| fs::rename(&temporary, path));
    if written.is_err() {
        // The first failure is the one to be told.
        let _ = fs::remove_file(&temporary);
    }
    written
}

/// Whether a favourite may be called so. No system gives these characters a meaning within names.
fn is_safe(name: &str) -> bool {
    let plain = |c: char| c.is_alphanumeric() || " -_".contains(c);
    let count = name.chars().count();
    (1..=LONGEST_NAME).contains(&count) && name.chars().all(plain) && name.trim() == name
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
    let plain = |c: char| match c.is_ascii_alphanumeric() || "-_.".contains(c) {
        true => c,
        false => '_',
    };
    let characters: Vec<char> = last.chars().map(plain).collect();
    // The end, which says what kind of file it is.
    characters[characters.len().saturating_sub(60)..]
        .iter()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_folder() {
        for name in ["evening", "Blue 2", "a_b-c", "für Elise", &"x".repeat(64)] {
            assert!(is_safe(name), "{name}");
        }
        for name in [
            "",
            "..",
            "../x",
            "a/b",
            "a\\b",
            ".hidden",
            "a.json",
            " a",
            "a\0",
            "c:",
            "a\n",
            "*",
            &"x".repeat(65),
        ] {
            assert!(!is_safe(name), "{name}");
        }
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
