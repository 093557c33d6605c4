//! Favourites: coats saved beside the model, with the paintings that they need.
//!
//! `MODEL/favourites/NAME.json` holds coats whose paintings are paths below that folder, so that
//! `impasto render --coats` reads it as it is.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use impasto_model::StyleLayers;
use impasto_scene::file::{plainly, read_whole, write_atomic};
use serde_json::{Value, json};

use crate::gallery::PaintingLibrary;
use crate::saved_paintings::{
    SAVED, SavedPaintings, favourites_folder, id_of_relative, names, relative,
};
use crate::sync::lock;

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
pub(crate) struct Favourites {
    folder: PathBuf,
    paintings: SavedPaintings,
    /// Held while it is changed.
    changing: Mutex<()>,
}

impl Favourites {
    pub(crate) fn new(model: &Path) -> Self {
        Self {
            folder: favourites_folder(model),
            paintings: SavedPaintings::new(model),
            changing: Mutex::default(),
        }
    }

    fn file(&self, name: &str) -> Result<PathBuf, Unsaved> {
        if is_safe(name) {
            return Ok(self.folder.join(format!("{name}.json")));
        }
        Err(Unsaved::Name(format!(
            "a favourite cannot be called that; use 1 to {LONGEST_NAME} letters, digits, blanks, - \
             and _"
        )))
    }

    /// All favourites, sorted by name; what is no favourite is left out.
    pub(crate) fn list(&self) -> Vec<Value> {
        let named = names(&self.folder, |name| {
            let name = name.strip_suffix(".json")?;
            is_safe(name).then(|| name.to_owned())
        });
        let read = |name: &String| {
            let bytes = read_whole(&self.folder.join(format!("{name}.json")), LARGEST).ok()?;
            let mut coats: StyleLayers = serde_json::from_slice(&bytes).ok()?;
            coats.check().ok()?;
            rename(&mut coats, id_of_relative);
            Some(json!({"name": name, "coats": coats.coats}))
        };
        named.iter().filter_map(read).collect()
    }

    /// Saves a favourite with its paintings.
    pub(crate) fn save(
        &self,
        name: &str,
        mut coats: StyleLayers,
        library: &PaintingLibrary,
    ) -> Result<(), Unsaved> {
        let path = self.file(name)?;
        let disk = |e: io::Error| {
            Unsaved::Disk(format!("the favourite cannot be saved ({})", plainly(&e)))
        };
        let _changing = lock(&self.changing);
        let is_known = path.is_file();
        if !is_known && self.list().len() >= MOST {
            return Err(Unsaved::Disk(format!(
                "there are {MOST} favourites already; remove one first"
            )));
        }
        self.paintings.create().map_err(disk)?;
        let mut failed = None;
        rename(&mut coats, |painting| {
            self.copy(painting, library).unwrap_or_else(|e| {
                failed.get_or_insert(e);
                None
            })
        });
        if let Some(failed) = failed {
            return Err(failed);
        }
        let text = serde_json::to_vec_pretty(&coats).map_err(|e| disk(e.into()))?;
        write_atomic(&path, &text).map_err(disk)
    }

    /// Copies a painting here; its path relative to the favourites, or `None` for one that needs no
    /// file.
    fn copy(&self, painting: &str, library: &PaintingLibrary) -> Result<Option<String>, Unsaved> {
        let Some((path, name)) = library.file(painting).map_err(Unsaved::Painting)? else {
            return Ok(None);
        };
        if let Some(file) = painting.strip_prefix(SAVED) {
            return Ok(Some(relative(file)));
        }
        let bytes = library.bytes(&path).map_err(Unsaved::Painting)?;
        let file = self.paintings.add(&name, &bytes).map_err(|e| {
            Unsaved::Disk(format!("the painting cannot be saved ({})", plainly(&e)))
        })?;
        Ok(Some(relative(&file)))
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
fn rename(coats: &mut StyleLayers, mut to: impl FnMut(&str) -> Option<String>) {
    for coat in &mut coats.coats {
        for painting in &mut coat.paintings {
            if let Some(name) = to(&painting.painting) {
                painting.painting = name;
            }
        }
    }
}

/// Whether a favourite may be called so. No system gives these characters a meaning within names.
fn is_safe(name: &str) -> bool {
    let plain = |c: char| c.is_alphanumeric() || " -_".contains(c);
    let count = name.chars().count();
    (1..=LONGEST_NAME).contains(&count) && name.chars().all(plain) && name.trim() == name
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
    }
}
