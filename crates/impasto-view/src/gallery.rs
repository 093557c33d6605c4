//! The paintings to choose from: a folder's, uploaded ones, those of favourites, generated ones.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use image::imageops::FilterType;
use image::{RgbImage, imageops};
use impasto_scene::PictureFolder;
use impasto_scene::file::{plainly, read_whole};
use impasto_scene::{decode_rgb, is_picture, read_rgb};
use serde::Serialize;

use crate::frame::jpeg;
use crate::names::short_hash;
use crate::options::{Limits, ViewOptions};
use crate::recent::Recent;
use crate::saved_paintings::{SAVED, SavedPaintings};
use crate::sync::lock;

/// Side of the generated paintings that coats are mixed from.
const GENERATED_SIDE: u32 = 256;
/// Longest side of a thumbnail.
const THUMBNAIL: u32 = 160;
const THUMBNAIL_QUALITY: u8 = 82;
/// Thumbnails that are kept.
const THUMBNAILS: usize = 2000;
/// Most paintings of a folder that are shown.
const SHOWN: usize = 2000;
/// Generated paintings that are shown.
const SHOWN_GENERATED: usize = 100;

const UPLOAD: &str = "upload:";
const RANDOM: &str = "random:";

/// A painting to choose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Painting {
    pub(crate) id: String,
    pub(crate) name: String,
    pub(crate) thumbnail: String,
}

impl Painting {
    fn new(id: &str, name: &str) -> Self {
        Self {
            id: id.to_owned(),
            name: name.to_owned(),
            thumbnail: format!("/api/thumbnail?id={}", escaped(id)),
        }
    }
}

/// Bytes that mean something in addresses, as `%XX`.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => {
                out.push(byte.into());
            }
            _ => out += &format!("%{byte:02X}"),
        }
    }
    out
}

struct Upload {
    id: String,
    name: String,
    path: PathBuf,
    bytes: u64,
}

#[derive(Default)]
struct Added {
    uploads: Vec<Upload>,
    generated: Vec<u64>,
}

/// Why a painting is not taken.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Untaken {
    /// There are too many already.
    Full(String),
    /// It is no picture, or none that may be decoded.
    NoPicture(String),
    /// The disk refuses it.
    Disk(String),
}

/// All paintings.
pub(crate) struct PaintingLibrary {
    folder: PictureFolder,
    scratch: PathBuf,
    limits: Limits,
    saved: SavedPaintings,
    added: Mutex<Added>,
    thumbnails: Mutex<Recent<String, Arc<Vec<u8>>>>,
}

impl PaintingLibrary {
    pub(crate) fn new(options: &ViewOptions) -> std::io::Result<Self> {
        let styles = options.styles.as_deref();
        let mut folder = styles
            .map(PictureFolder::walk)
            .transpose()?
            .unwrap_or_default();
        folder.files.retain(|file| is_picture(&file.path));
        Ok(Self {
            folder,
            scratch: options.scratch.clone(),
            limits: options.limits,
            saved: SavedPaintings::new(&options.model),
            added: Mutex::default(),
            thumbnails: Mutex::new(Recent::new(THUMBNAILS)),
        })
    }

    fn added(&self) -> MutexGuard<'_, Added> {
        lock(&self.added)
    }

    /// What there is to choose from: uploaded and generated ones first, the newest foremost.
    pub(crate) fn list(&self) -> Vec<Painting> {
        let added = self.added();
        let uploads = added.uploads.iter().rev();
        let mut all: Vec<_> = uploads.map(|u| Painting::new(&u.id, &u.name)).collect();
        let generated = added.generated.iter().rev();
        all.extend(generated.map(|seed| generated_painting(*seed)));
        drop(added);
        all.extend(self.saved.list().iter().map(|file| {
            let name = file.split_once('-').map_or(file.as_str(), |(_, name)| name);
            Painting::new(&format!("{SAVED}{file}"), name)
        }));
        let folder = self.folder.files.iter().take(SHOWN);
        all.extend(folder.map(|file| Painting::new(&file.name, &file.name)));
        all
    }

    /// Adds a generated painting.
    pub(crate) fn generate(&self) -> Painting {
        // Five digits are easily said and typed.
        let seed = rand::TryRng::try_next_u64(&mut rand::rngs::SysRng).unwrap_or(1) % 100_000;
        let mut added = self.added();
        if added.generated.len() >= SHOWN_GENERATED {
            added.generated.remove(0);
        }
        if !added.generated.contains(&seed) {
            added.generated.push(seed);
        }
        generated_painting(seed)
    }

    /// Takes a picture's file.
    pub(crate) fn take(&self, name: &str, bytes: &[u8]) -> Result<Painting, Untaken> {
        let hash = short_hash(bytes);
        let id = format!("{UPLOAD}{hash}");
        let known = |added: &Added| {
            let upload = added.uploads.iter().find(|u| u.id == id)?;
            Some(Painting::new(&upload.id, &upload.name))
        };
        if let Some(painting) = known(&self.added()) {
            return Ok(painting);
        }
        let picture = decode_rgb(bytes, self.limits.pixels).map_err(Untaken::NoPicture)?;
        let thumbnail = thumbnail(&picture).map_err(Untaken::NoPicture)?;
        drop(picture);
        let size = bytes.len() as u64;
        let mut added = self.added();
        if let Some(painting) = known(&added) {
            return Ok(painting);
        }
        let all: u64 = added.uploads.iter().map(|u| u.bytes).sum();
        if added.uploads.len() >= self.limits.uploads || all + size > self.limits.upload_bytes {
            return Err(Untaken::Full(format!(
                "there is no room for more paintings ({} were uploaded); close the studio and open \
                 it again, or put them into the folder of --styles",
                added.uploads.len()
            )));
        }
        let path = self.scratch.join(format!("{hash}.upload"));
        fs::write(&path, bytes)
            .map_err(|e| Untaken::Disk(format!("the painting cannot be kept ({})", plainly(&e))))?;
        let name = shown_name(name);
        let painting = Painting::new(&id, &name);
        lock(&self.thumbnails).keep(id.clone(), Arc::new(thumbnail));
        added.uploads.push(Upload {
            id,
            name,
            path,
            bytes: size,
        });
        Ok(painting)
    }

    /// Where the file of a painting is and what it is called; `None` for generated ones.
    pub(crate) fn file(&self, id: &str) -> Result<Option<(PathBuf, String)>, String> {
        let unknown = || {
            let id: String = id.chars().take(100).collect();
            format!("there is no painting \"{id}\"; choose one of those shown, or add it again")
        };
        if let Some(seed) = id.strip_prefix(RANDOM) {
            return seed
                .parse::<u64>()
                .map_or_else(|_| Err(unknown()), |_| Ok(None));
        }
        if id.starts_with(UPLOAD) {
            let added = self.added();
            let upload = added.uploads.iter().find(|u| u.id == id);
            return upload
                .map(|u| Some((u.path.clone(), u.name.clone())))
                .ok_or_else(unknown);
        }
        if let Some(file) = id.strip_prefix(SAVED) {
            let path = self.saved.path(file).ok_or_else(unknown)?;
            return Ok(Some((path, file.to_owned())));
        }
        let found = self.folder.files.iter().find(|file| file.name == id);
        found
            .map(|file| Some((file.path.clone(), file.name.clone())))
            .ok_or_else(unknown)
    }

    /// The picture of an id.
    pub(crate) fn picture(&self, id: &str) -> Result<RgbImage, String> {
        match self.file(id)? {
            None => self.generated(id, GENERATED_SIDE),
            // Pictures of the user's own folder may be as large as anywhere.
            Some((path, _)) => read_rgb(&path).map_err(|e| e.to_string()),
        }
    }

    fn generated(&self, id: &str, side: u32) -> Result<RgbImage, String> {
        let seed = id.strip_prefix(RANDOM).and_then(|seed| seed.parse().ok());
        let seed = seed.ok_or_else(|| format!("\"{id}\" is no generated painting"))?;
        Ok(impasto_paintings::random(seed, side).1)
    }

    /// A small JPEG of a painting.
    pub(crate) fn thumbnail(&self, id: &str) -> Result<Arc<Vec<u8>>, String> {
        if let Some(known) = lock(&self.thumbnails).get(id) {
            return Ok(known);
        }
        let picture = match self.file(id)? {
            None => self.generated(id, THUMBNAIL)?,
            Some(_) => self.picture(id)?,
        };
        let made = Arc::new(thumbnail(&picture)?);
        lock(&self.thumbnails).keep(id.to_owned(), made.clone());
        Ok(made)
    }

    /// The bytes of a painting's file.
    pub(crate) fn bytes(&self, path: &Path) -> Result<Vec<u8>, String> {
        // A folder's paintings may be larger than uploads, but not by much.
        let most = 4 * self.limits.upload as u64;
        read_whole(path, most).map_err(|e| format!("{}: {}", path.display(), plainly(&e)))
    }
}

fn generated_painting(seed: u64) -> Painting {
    let recipe = impasto_paintings::Recipe::random(seed);
    Painting::new(
        &format!("{RANDOM}{seed}"),
        &impasto_paintings::label(&recipe),
    )
}

fn thumbnail(picture: &RgbImage) -> Result<Vec<u8>, String> {
    let (width, height) = picture.dimensions();
    let longest = width.max(height).max(1);
    let side = |side: u32| {
        // At most the longest side, so the cast keeps the value.
        (u64::from(side) * u64::from(THUMBNAIL) / u64::from(longest)).max(1) as u32
    };
    let mut bytes = Vec::new();
    if longest <= THUMBNAIL {
        jpeg(picture, THUMBNAIL_QUALITY, &mut bytes)?;
        return Ok(bytes);
    }
    let (w, h) = (side(width), side(height));
    // Averages first: a filter alone takes long over a large picture.
    let rough = imageops::thumbnail(picture, (2 * w).min(width), (2 * h).min(height));
    let small = imageops::resize(&rough, w, h, FilterType::Triangle);
    jpeg(&small, THUMBNAIL_QUALITY, &mut bytes)?;
    Ok(bytes)
}

/// A name that somebody sent, to be shown: its last part, short and without control characters.
fn shown_name(name: &str) -> String {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let shown: String = last.chars().filter(|c| !c.is_control()).take(80).collect();
    match shown.trim() {
        "" => "painting".into(),
        shown => shown.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_shown_as_names() {
        assert_eq!(shown_name("../../etc/pass\nwd.png"), "passwd.png");
        assert_eq!(shown_name("C:\\a\\b.jpg"), "b.jpg");
        assert_eq!(shown_name("x/"), "painting");
        assert_eq!(shown_name(&"é".repeat(200)).chars().count(), 80);
    }

    #[test]
    fn ids_are_safe_in_addresses() {
        assert_eq!(escaped("a b/ü?&.png"), "a%20b%2F%C3%BC%3F%26.png");
    }
}
