//! A loaded capture, ready to train on.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::detect::{self, Format};
use crate::error::SceneError;
use crate::normalise::Normalisation;
use crate::photo;
use crate::readers::{self, Capture, Frame, RawPoint};

/// What a photo is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Learned from.
    Train,
    /// Held out, to compare with.
    Test,
}

/// Every how many photos, sorted by name, one is held out when the format has no split.
const HOLD_OUT_EVERY: usize = 8;

impl Split {
    /// The split of the photo at `index` in name order, for formats without one.
    pub fn by_index(index: usize) -> Self {
        if index.is_multiple_of(HOLD_OUT_EVERY) {
            Self::Test
        } else {
            Self::Train
        }
    }
}

/// One posed photo.
#[derive(Debug, Clone)]
pub struct Photo {
    /// Name within the capture, with its ending.
    pub name: String,
    /// The file that the pixels came from.
    pub path: PathBuf,
    /// Camera in scene space, at the size of `pixels`.
    pub camera: Camera,
    /// Train or test.
    pub split: Split,
    /// The decoded, downscaled photo: sRGB bytes as stored, EXIF orientation ignored.
    pub pixels: RgbImage,
}

/// Where a sparse point was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Index into [`Scene::photos`].
    pub photo: usize,
    /// Position in that photo's (downscaled) pixels; pixel centres are at index + ½.
    pub pixel: DVec2,
}

/// One triangulated point of the capture.
#[derive(Debug, Clone)]
pub struct SparsePoint {
    /// Position in scene space.
    pub position: DVec3,
    /// sRGB.
    pub colour: [u8; 3],
    /// The photos that it was found in.
    pub seen_by: Vec<Observation>,
    /// Mean reprojection error as the capture states it, in pixels of the original photos;
    /// negative when unknown.
    pub error: f64,
}

/// A capture in scene space (DESIGN §6): cameras inside the unit ball, the mean camera centre at
/// the origin.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name of the capture's folder.
    pub name: String,
    /// The format that it was read from.
    pub format: Format,
    /// Photos, sorted by name; at least 2.
    pub photos: Vec<Photo>,
    /// Sparse points; empty for formats without them.
    pub points: Vec<SparsePoint>,
    /// The way back to the capture's own coordinates.
    pub normalisation: Normalisation,
    /// Whether the photos are rendered, not taken (`"synthetic": true` in transforms.json). To be
    /// said wherever the scene appears.
    pub synthetic: bool,
}

impl Scene {
    /// The photos to learn from, with their indices.
    pub fn train(&self) -> impl Iterator<Item = (usize, &Photo)> {
        self.of(Split::Train)
    }

    /// The held-out photos, with their indices.
    pub fn test(&self) -> impl Iterator<Item = (usize, &Photo)> {
        self.of(Split::Test)
    }

    /// Cameras of the photos of one split, in order: the `train` and `test` camera paths.
    pub fn cameras(&self, split: Split) -> Vec<Camera> {
        self.of(split).map(|(_, photo)| photo.camera).collect()
    }

    fn of(&self, split: Split) -> impl Iterator<Item = (usize, &Photo)> {
        self.photos
            .iter()
            .enumerate()
            .filter(move |(_, photo)| photo.split == split)
    }
}

/// How to load a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoadOptions {
    /// Photos are shrunk this many times, to `round(w / downscale) × round(h / downscale)`; ≥ 1.
    pub downscale: u32,
    /// The format, when it should not be detected.
    pub format: Option<Format>,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            downscale: 1,
            format: None,
        }
    }
}

/// Loads a capture: reads poses, normalises them, decodes all photos in parallel.
///
/// The split is the format's own when it names both train and test photos (Blender's two files,
/// NeRF++'s folders, nerfstudio's lists); else every 8th photo in name order, beginning with the first, is a test
/// photo. A photo of another size than its camera's but of the same shape (within 1 %) is
/// accepted and the camera rescaled.
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
    let splits = splits(&capture.frames);
    let centres: Vec<DVec3> = capture.frames.iter().map(|f| f.camera.centre()).collect();
    let normalisation =
        Normalisation::of_cameras(&centres).ok_or_else(|| SceneError::OnePlace {
            path: path.to_owned(),
            count,
        })?;
    let stated: Vec<(u32, u32)> = capture.frames.iter().map(|f| size(&f.camera)).collect();
    let Capture {
        frames,
        points,
        synthetic,
    } = capture;
    let decoded: Vec<Result<Photo, SceneError>> = frames
        .into_par_iter()
        .zip(splits)
        .map(|(frame, split)| photo(frame, split, &normalisation, options.downscale))
        .collect();
    let photos = decoded.into_iter().collect::<Result<Vec<_>, _>>()?;
    let points = points
        .into_iter()
        .map(|point| in_scene(&point, &photos, &stated, &normalisation))
        .collect();
    Ok(Scene {
        name: folder_name(path),
        format: located.format(),
        photos,
        points,
        normalisation,
        synthetic,
    })
}

fn splits(frames: &[Frame]) -> Vec<Split> {
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

fn size(camera: &Camera) -> (u32, u32) {
    (camera.intrinsics.width, camera.intrinsics.height)
}

fn photo(
    frame: Frame,
    split: Split,
    normalisation: &Normalisation,
    downscale: u32,
) -> Result<Photo, SceneError> {
    if !frame.photo.is_file() {
        return Err(SceneError::PhotoMissing {
            frame: frame.name,
            path: frame.photo,
        });
    }
    let full = photo::read_rgb(&frame.photo)?;
    let stated = size(&frame.camera);
    let stretch = |from: u32, to: u32| f64::from(to) / f64::from(from);
    let shape = stretch(stated.0, full.width()) / stretch(stated.1, full.height());
    if (shape - 1.0).abs() > 0.01 {
        return Err(SceneError::PhotoSize {
            path: frame.photo,
            photo: full.dimensions(),
            camera: stated,
        });
    }
    let pixels = photo::downscale(&full, downscale);
    let mut camera = frame.camera.resized(pixels.width(), pixels.height());
    camera.camera_to_world = normalisation.pose_to_scene(camera.camera_to_world);
    Ok(Photo {
        name: frame.name,
        path: frame.photo,
        camera,
        split,
        pixels,
    })
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
        whole.parent().map(Path::to_owned)
    } else {
        Some(whole)
    };
    folder.as_deref().and_then(Path::file_name).map_or_else(
        || "scene".into(),
        |name| name.to_string_lossy().into_owned(),
    )
}
