//! A loaded capture, ready to train on.

use std::path::PathBuf;

use glam::{DVec2, DVec3};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::format::Format;
use crate::normalise::Normalisation;

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
    /// The decoded, downscaled photo: sRGB bytes as stored. Poses belong to the stored pixels, so
    /// it is turned as its EXIF data says only where it would not fit its camera otherwise.
    pub pixels: RgbImage,
    /// Which pixels show the place, row by row, as many as `pixels` has; `None` where all do. At
    /// least one does.
    pub mask: Option<Vec<bool>>,
}

impl Photo {
    /// Whether a pixel (row-major index) shows the place.
    pub fn is_used(&self, pixel: usize) -> bool {
        match &self.mask {
            None => true,
            Some(mask) => mask.get(pixel).is_some_and(|used| *used),
        }
    }
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
    /// What is odd about the capture, each a sentence; nothing that keeps it from being used.
    pub warnings: Vec<String>,
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
