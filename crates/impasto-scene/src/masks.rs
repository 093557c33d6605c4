//! Masks: which pixels of a photo show the place, and not what walked through it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use image::metadata::Orientation;
use image::{GrayImage, Luma, RgbImage};
use serde::{Deserialize, Serialize};

use crate::error::SceneError;
use crate::photo::{all_of, downscaled_size, same_shape};
use crate::picture_file::{Decoded, faded, is_picture};
use crate::readers::capture::RawFrame;
use crate::readers::names::plain_path;

/// Name of the folder beside that of the photos.
const FOLDER: &str = "masks";
/// From this value on, a pixel of a mask is white.
const WHITE: u8 = 128;

/// What becomes of pixels that a mask hides (where it is black or transparent).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskUse {
    /// They are not there: never learned from, never compared with.
    #[default]
    Ignore,
    /// They are white background, as transparent pixels of a photo are.
    Transparent,
    /// Masks are not looked for.
    Off,
}

/// The mask of one photo, of the photo's size; 255 shows, 0 hides.
pub(crate) struct PhotoMask {
    path: PathBuf,
    values: GrayImage,
}

impl PhotoMask {
    /// Reads the mask of a photo of `size`, which was turned like `turn` when it was read.
    ///
    /// Its transparency counts, where any pixel has some, else its brightness.
    pub(crate) fn read(
        path: &Path,
        turn: Orientation,
        size: (u32, u32),
    ) -> Result<Self, SceneError> {
        let refuse = |problem: String| SceneError::Mask {
            path: path.to_owned(),
            problem,
        };
        let mut decoded = Decoded::read(path).map_err(|error| match error {
            SceneError::Photo { problem, .. } => refuse(problem),
            other => other,
        })?;
        if !same_shape((decoded.pixels.width(), decoded.pixels.height()), size) {
            decoded.pixels.apply_orientation(turn);
        }
        let found = (decoded.pixels.width(), decoded.pixels.height());
        if !same_shape(found, size) {
            return Err(refuse(format!(
                "it is {}×{} pixels and the photo {}×{}, another shape",
                found.0, found.1, size.0, size.1
            )));
        }
        let has_alpha = decoded.pixels.has_alpha();
        let rgba = has_alpha.then(|| decoded.pixels.to_rgba8());
        let values = match rgba {
            Some(rgba) if rgba.pixels().any(|p| p[3] < 255) => {
                GrayImage::from_fn(found.0, found.1, |x, y| Luma([rgba.get_pixel(x, y)[3]]))
            }
            _ => decoded.pixels.into_luma8(),
        };
        let nearest = |at: u32, from: u32, to: u32| {
            // Below `from`, so the cast keeps the value.
            ((2 * u64::from(at) + 1) * u64::from(from) / (2 * u64::from(to))) as u32
        };
        let values = GrayImage::from_fn(size.0, size.1, |x, y| {
            *values.get_pixel(nearest(x, found.0, size.0), nearest(y, found.1, size.1))
        });
        if values.iter().all(|value| *value < WHITE) {
            return Err(refuse("it hides the whole photo".into()));
        }
        Ok(Self {
            path: path.to_owned(),
            values,
        })
    }

    /// Lets white show through where the mask hides.
    pub(crate) fn fade(&self, photo: &mut RgbImage) {
        for (pixel, value) in photo.pixels_mut().zip(self.values.iter()) {
            pixel.0 = pixel.0.map(|channel| faded(channel, *value));
        }
    }

    /// Which pixels of the photo, shrunk `k` times, show nothing that is hidden.
    pub(crate) fn downscaled(&self, k: u32) -> Result<Vec<bool>, SceneError> {
        let (width, height) = self.values.dimensions();
        let used: Vec<bool> = self.values.iter().map(|value| *value >= WHITE).collect();
        let small = all_of(&used, (width, height), downscaled_size(width, height, k));
        if small.contains(&true) {
            return Ok(small);
        }
        Err(SceneError::Mask {
            path: self.path.clone(),
            problem: format!("it leaves no whole pixel of the photo shrunk {k} times"),
        })
    }
}

/// Gives frames without a mask of their own the one that lies in a folder of masks, and warns of
/// masks that are nobody's.
pub(crate) fn assign(frames: &mut [RawFrame], root: &Path) -> Result<Option<String>, SceneError> {
    let root = plain_path(root);
    let mut folders: BTreeMap<PathBuf, Listing> = BTreeMap::new();
    for frame in frames.iter_mut().filter(|frame| frame.mask.is_none()) {
        let photo = plain_path(&frame.photo);
        let Ok(below) = photo.strip_prefix(&root) else {
            continue;
        };
        let parts: Vec<_> = below.components().collect();
        // For photos/a.jpg: masks/photos/a, then masks/a.
        for depth in 0..parts.len() {
            let above: PathBuf = parts[..depth.saturating_sub(1)].iter().collect();
            let folder = root.join(above).join(FOLDER);
            let listing = match folders.get_mut(&folder) {
                Some(listing) => listing,
                None => {
                    let listing = Listing::of(&folder)?;
                    folders.entry(folder).or_insert(listing)
                }
            };
            let name: PathBuf = parts[depth..].iter().collect();
            frame.mask = listing.mask_of(&name);
            if frame.mask.is_some() {
                break;
            }
        }
    }
    let used: BTreeSet<&PathBuf> = frames.iter().filter_map(|f| f.mask.as_ref()).collect();
    let all = folders.values().flat_map(|listing| &listing.files);
    let unused: Vec<&PathBuf> = all.filter(|file| !used.contains(file)).collect();
    Ok(unused.first().map(|first| {
        format!(
            "{} of the masks belong to no posed photo, for one {}; a mask has the name of its photo",
            unused.len(),
            first.display()
        )
    }))
}

/// The pictures below a folder.
#[derive(Default)]
struct Listing {
    files: Vec<PathBuf>,
    /// By their path within the folder, without its ending.
    by_name: BTreeMap<PathBuf, PathBuf>,
}

impl Listing {
    /// Nothing where there is no folder. Through links, each real folder once.
    fn of(folder: &Path) -> Result<Self, SceneError> {
        let mut listing = Self::default();
        let mut seen = BTreeSet::new();
        let mut waiting = vec![folder.to_owned()];
        while let Some(dir) = waiting.pop() {
            if !dir.is_dir() {
                continue;
            }
            if !seen.insert(dir.canonicalize().map_err(SceneError::io(&dir))?) {
                continue;
            }
            for entry in std::fs::read_dir(&dir).map_err(SceneError::io(&dir))? {
                let path = entry.map_err(SceneError::io(&dir))?.path();
                if path.is_dir() {
                    waiting.push(path);
                } else if is_picture(&path) {
                    listing.files.push(path);
                }
            }
        }
        listing.files.sort();
        for file in &listing.files {
            if let Ok(name) = file.strip_prefix(folder) {
                let entry = listing.by_name.entry(name.with_extension(""));
                entry.or_insert_with(|| file.clone());
            }
        }
        Ok(listing)
    }

    /// The mask called like the photo, with or without the photo's own ending before the mask's.
    fn mask_of(&self, photo: &Path) -> Option<PathBuf> {
        let named = self.by_name.get(photo);
        named
            .or_else(|| self.by_name.get(&photo.with_extension("")))
            .cloned()
    }
}
