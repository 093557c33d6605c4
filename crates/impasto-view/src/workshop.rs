//! Long work: films and exports, which the program behind the studio does.

use std::path::PathBuf;

use image::RgbImage;
use impasto_model::{Stop, StyleLayers};
use impasto_scene::Camera;
use impasto_scene::paths::CameraPath;
use serde::Deserialize;
use serde_json::Value;

/// What can be made on this machine.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Formats {
    /// Of films: `gif`, `png`, `mp4` …
    pub films: Vec<String>,
    /// Of exports: `points`, `splats`.
    pub exports: Vec<String>,
}

/// Does long work, one piece at a time, on a thread that waits for it.
pub trait Workshop: Send + 'static {
    /// What can be made.
    fn formats(&self) -> Formats;

    /// Makes a film; the file that it made in [`FilmOrder::folder`].
    ///
    /// # Errors
    /// Why it could not be made, as a sentence. What it returns after `stop` is not looked at.
    fn film(&mut self, order: &FilmOrder, progress: Progress<'_>, stop: &Stop) -> Made;

    /// Makes an export; the file that it made in [`ExportOrder::folder`].
    ///
    /// # Errors
    /// As [`Self::film`].
    fn export(&mut self, order: &ExportOrder, progress: Progress<'_>, stop: &Stop) -> Made;
}

/// Told the part that is done, from 0 to 1, after every frame or so. It may wait: whoever looks at
/// the scene goes first.
pub type Progress<'a> = &'a mut dyn FnMut(f64);

/// The file that was made, or why not.
pub type Made = Result<PathBuf, String>;

/// Coats with the paintings that they name.
#[derive(Debug, Clone)]
pub struct PaintOrder {
    /// The coats.
    pub coats: StyleLayers,
    /// Every painting of theirs, by its id.
    pub paintings: Vec<(String, RgbImage)>,
}

/// A film to be made.
#[derive(Debug, Clone)]
pub struct FilmOrder {
    /// One camera a frame, in scene space, all of the film's size.
    pub cameras: Vec<Camera>,
    /// The same path in nerfstudio's form, for those who want it beside the film.
    pub path: Value,
    /// Frames a second.
    pub fps: f64,
    /// How it is painted.
    pub paint: PaintOrder,
    /// One of [`Formats::films`].
    pub format: String,
    /// Whether the scene as photographed stands beside it.
    pub side_by_side: bool,
    /// An empty folder to make it in.
    pub folder: PathBuf,
}

/// An export to be made.
#[derive(Debug, Clone)]
pub struct ExportOrder {
    /// How it is painted.
    pub paint: PaintOrder,
    /// One of [`Formats::exports`].
    pub kind: String,
    /// An empty folder to make it in.
    pub folder: PathBuf,
}

/// Body of `POST /api/films`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FilmRequest {
    pub(crate) path: CameraPath,
    #[serde(default)]
    pub(crate) coats: Vec<impasto_model::StyleLayerSpec>,
    pub(crate) size: (u32, u32),
    pub(crate) format: String,
    #[serde(default)]
    pub(crate) side_by_side: bool,
}

/// Body of `POST /api/exports`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ExportRequest {
    #[serde(default)]
    pub(crate) coats: Vec<impasto_model::StyleLayerSpec>,
    pub(crate) kind: String,
}
