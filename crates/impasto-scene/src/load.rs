//! Captures become scenes.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use image::metadata::Orientation;
use rayon::prelude::*;

use crate::detect;
use crate::error::SceneError;
use crate::format::Format;
use crate::masks::{self, MaskUse, PhotoMask};
use crate::normalise::Normalisation;
use crate::photo::{downscaled, same_shape};
use crate::picture_file::{Decoded, on_white};
use crate::readers;
use crate::readers::capture::{RawFrame, RawPoint};
use crate::scene::{Observation, Photo, Scene, SparsePoint, Split};
use crate::statistics::median;

/// Farther from the middle of the cameras than this many times the median camera is no place that
/// a photographer walked to.
const OUTLIER: f64 = 20.0;

/// How to load a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoadOptions {
    /// Photos are shrunk this many times, to `round(w / downscale) × round(h / downscale)`; ≥ 1.
    pub downscale: u32,
    /// The format, when it should not be detected.
    pub format: Option<Format>,
    /// What becomes of pixels that a mask hides.
    pub masks: MaskUse,
    /// Of the training photos, only so many are used, evenly spread in order of name; ≥ 1. Held-out
    /// ones stay: what fewer photos cost can be measured on the same views.
    pub train_photos: Option<u32>,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            downscale: 1,
            format: None,
            masks: MaskUse::default(),
            train_photos: None,
        }
    }
}

/// Loads a capture: reads poses, normalises them, decodes all photos in parallel, of which each is
/// shrunk before the next one is read.
///
/// The split is the format's own when it names both train and test photos (Blender's two files,
/// NeRF++'s folders, nerfstudio's lists); else every 8th photo in name order, beginning with the first, is a test
/// photo. A photo of another size than its camera's but of the same shape (within 1 %) is
/// accepted and the camera rescaled.
///
/// Masks are pictures in a folder `masks` beside the photos' folder, with the photo's name
/// (`a.png` or `a.jpg.png` for `a.jpg`), or what a frame of transforms.json calls `mask_path`.
///
/// # Errors
/// Anything wrong with the capture; see [`SceneError`]. When several photos are bad, the first by
/// name is reported.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene, SceneError> {
    if options.downscale == 0 {
        return Err(SceneError::Downscale(0));
    }
    let located = detect::locate(path, options.format)?;
    let mut capture = readers::read(&located)?;
    capture.sort_by_name();
    let count = capture.frames.len();
    if count < 2 {
        return Err(SceneError::TooFewPhotos {
            path: path.to_owned(),
            count,
        });
    }
    check_distinct(&capture.frames, path)?;
    let mut splits = splits(&capture.frames);
    if let Some(count) = options.train_photos {
        splits = capture.thinned(&splits, count as usize);
    }
    let centres: Vec<DVec3> = capture.frames.iter().map(|f| f.camera.centre()).collect();
    let normalisation =
        Normalisation::of_cameras(&centres).ok_or_else(|| SceneError::OnePlace {
            path: path.to_owned(),
            count,
        })?;
    let stated = capture.frames.iter().map(|f| f.camera.intrinsics.size());
    let stated: Vec<(u32, u32)> = stated.collect();
    let mut warnings: Vec<String> = far_away(&capture.frames, &centres).into_iter().collect();
    if options.masks != MaskUse::Off {
        let root = readers::root(&located);
        warnings.extend(masks::assign(&mut capture.frames, &root)?);
    }
    let decoded: Vec<Result<Photo, SceneError>> = capture
        .frames
        .into_par_iter()
        .zip(splits)
        .map(|(frame, split)| photo(frame, split, &normalisation, options))
        .collect();
    let photos = decoded.into_iter().collect::<Result<Vec<_>, _>>()?;
    let points = capture.points.iter();
    let points = points.map(|point| in_scene(point, &photos, &stated, &normalisation));
    let points = points.collect();
    Ok(Scene {
        name: folder_name(path),
        format: located.format(),
        photos,
        points,
        normalisation,
        synthetic: capture.synthetic,
        warnings,
    })
}

/// No two frames, sorted by name, have one name or one file.
fn check_distinct(frames: &[RawFrame], path: &Path) -> Result<(), SceneError> {
    let same = |a: &RawFrame, b: &RawFrame| SceneError::Duplicate {
        path: path.to_owned(),
        first: a.name.clone(),
        second: b.name.clone(),
    };
    if let Some(pair) = frames.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(same(&pair[0], &pair[1]));
    }
    let mut files: BTreeMap<PathBuf, &RawFrame> = BTreeMap::new();
    for frame in frames {
        // What is not there is reported when it is to be decoded.
        let Ok(file) = frame.photo.canonicalize() else {
            continue;
        };
        if let Some(other) = files.insert(file, frame) {
            return Err(same(other, frame));
        }
    }
    Ok(())
}

/// A warning of cameras that stand so far out that the rest of the scene becomes a dot.
fn far_away(frames: &[RawFrame], centres: &[DVec3]) -> Option<String> {
    let along = |axis: usize| median(centres.iter().map(|c| c[axis]));
    let middle = DVec3::new(along(0)?, along(1)?, along(2)?);
    let distances: Vec<f64> = centres.iter().map(|c| c.distance(middle)).collect();
    let typical = median(distances.iter().copied())?;
    let far = frames.iter().zip(&distances);
    let far: Vec<_> = far.filter(|(_, d)| **d > OUTLIER * typical).collect();
    let (frame, distance) = far.first()?;
    // Most cameras at one place have no typical distance to compare with.
    if typical <= 0.0 {
        return None;
    }
    let others = match far.len() {
        1 => String::new(),
        n => format!(" (and {} more)", n - 1),
    };
    Some(format!(
        "the camera of {}{others} stands {:.0} times farther out than the others, which shrinks the \
         rest of the scene to a dot; if its pose is wrong, remove the frame",
        frame.name,
        *distance / typical
    ))
}

fn splits(frames: &[RawFrame]) -> Vec<Split> {
    let named = |split| frames.iter().any(|f| f.split == Some(split));
    let complete = named(Split::Train) && named(Split::Test);
    frames
        .iter()
        .enumerate()
        .map(|(index, frame)| match frame.split {
            Some(split) if complete => split,
            _ => Split::by_index(index),
        })
        .collect()
}

fn photo(
    frame: RawFrame,
    split: Split,
    normalisation: &Normalisation,
    options: &LoadOptions,
) -> Result<Photo, SceneError> {
    let mut decoded = Decoded::read(&frame.photo).map_err(|error| match error {
        SceneError::Io { path, source } if source.kind() == ErrorKind::NotFound => {
            SceneError::PhotoMissing {
                frame: frame.name.clone(),
                path,
            }
        }
        other => other,
    })?;
    let turn = turn_to_fit(&mut decoded, &frame)?;
    let mut full = on_white(decoded.pixels);
    // A mask may be as large as its photo, and waits for its turn like any other picture.
    let alone = decoded.alone.filter(|_| frame.mask.is_none());
    let mut mask = None;
    if let Some(path) = &frame.mask {
        let read = PhotoMask::read(path, turn, full.dimensions())?;
        match options.masks {
            MaskUse::Transparent => read.fade(&mut full),
            MaskUse::Ignore | MaskUse::Off => mask = Some(read.downscaled(options.downscale)?),
        }
    }
    let pixels = downscaled(full, options.downscale);
    drop(alone);
    let mut camera = frame.camera.resized(pixels.width(), pixels.height());
    camera.camera_to_world = normalisation.pose_to_scene(camera.camera_to_world);
    Ok(Photo {
        name: frame.name,
        path: frame.photo,
        camera,
        split,
        pixels,
        mask,
    })
}

/// Turns a photo that does not fit its camera otherwise; tells how.
fn turn_to_fit(decoded: &mut Decoded, frame: &RawFrame) -> Result<Orientation, SceneError> {
    let stored = (decoded.pixels.width(), decoded.pixels.height());
    let stated = frame.camera.intrinsics.size();
    if frame.measured && stored != stated {
        return Err(SceneError::Changed {
            path: frame.photo.clone(),
        });
    }
    if same_shape(stated, stored) {
        return Ok(Orientation::NoTransforms);
    }
    if !swaps_sides(decoded.turn) || !same_shape(stated, (stored.1, stored.0)) {
        return Err(SceneError::PhotoSize {
            path: frame.photo.clone(),
            photo: stored,
            camera: stated,
        });
    }
    decoded.pixels.apply_orientation(decoded.turn);
    Ok(decoded.turn)
}

fn swaps_sides(turn: Orientation) -> bool {
    matches!(
        turn,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    )
}

fn in_scene(
    point: &RawPoint,
    photos: &[Photo],
    stated: &[(u32, u32)],
    normalisation: &Normalisation,
) -> SparsePoint {
    let seen_by = point.seen_by.iter().map(|&(photo, pixel)| {
        let (from, to) = (stated[photo], &photos[photo].pixels);
        let scale = DVec2::new(
            f64::from(to.width()) / f64::from(from.0),
            f64::from(to.height()) / f64::from(from.1),
        );
        Observation {
            photo,
            pixel: pixel * scale,
        }
    });
    SparsePoint {
        position: normalisation.to_scene(point.position),
        colour: point.colour,
        seen_by: seen_by.collect(),
        error: point.error,
    }
}

/// The folder's own name, also when it was given as `.` or as a file inside it.
fn folder_name(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let folder = if whole.is_file() {
        whole.parent()
    } else {
        Some(&*whole)
    };
    let name = folder.and_then(Path::file_name);
    name.map_or("scene".into(), |name| name.to_string_lossy().into_owned())
}
