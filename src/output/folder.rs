//! Numbered frames with their cameras.

use std::fs;
use std::path::{Path, PathBuf};

use impasto::scene::npy;
use serde_json::{Value, json};

use super::{Frame, Layout, Sink, Staging, View, picture};
use crate::cli::CliError;

/// The file that says where the frames were seen from.
pub const CAMERAS: &str = "cameras.json";

/// Name of a frame's picture.
pub fn name(frame: usize) -> String {
    format!("{frame:04}.png")
}

/// Names of a frame's files.
pub fn names(frame: usize, depth: bool) -> Vec<String> {
    let mut names = vec![name(frame)];
    if depth {
        names.push(format!("{frame:04}.depth.npy"));
    }
    names
}

/// The text of `cameras.json`. Where several pictures are side by side on one, `side_by_side` there
/// names them from the left; each is `w` pixels wide.
pub fn cameras<'a>(
    views: impl IntoIterator<Item = &'a View>,
    layout: &Layout,
    depth: bool,
    synthetic: bool,
) -> String {
    let entry = |(frame, view): (usize, &View)| {
        let mut entry = crate::cli::to_json(&view.camera);
        for (key, name) in ["file", "depth_file"].iter().zip(names(frame, depth)) {
            entry[key] = name.into();
        }
        if let Some(photo) = &view.photo {
            entry["photo"] = photo.as_str().into();
        }
        entry
    };
    let frames: Vec<Value> = views.into_iter().enumerate().map(entry).collect();
    let mut text = json!({"synthetic": synthetic, "frames": frames});
    if let Layout::SideBySide(names) = layout {
        text["side_by_side"] = names.as_slice().into();
    }
    format!("{text:#}\n")
}

/// `0000.png …`, `0000.depth.npy …` and `cameras.json`; with several variants, all of that in one
/// sub-folder per variant, so that each can be read alone.
pub struct Folder {
    path: PathBuf,
    staging: Staging,
    /// Sub-folders, empty for the folder itself.
    variants: Vec<PathBuf>,
    layout: Layout,
    depth: bool,
    synthetic: bool,
    views: Vec<View>,
}

impl Folder {
    /// Begins to write to `path`.
    pub fn new(
        path: &Path,
        layout: Layout,
        depth: bool,
        synthetic: bool,
    ) -> Result<Self, CliError> {
        Ok(Self {
            path: path.to_owned(),
            staging: Staging::new(path)?,
            variants: match layout.variants() {
                [] | [_] => vec![PathBuf::new()],
                several => several.iter().map(PathBuf::from).collect(),
            },
            layout,
            depth,
            synthetic,
            views: Vec::new(),
        })
    }

    fn stage(&mut self, variant: usize, name: &str) -> Result<PathBuf, CliError> {
        let name = self.variants[variant].join(name);
        self.staging.file(&name.to_string_lossy())
    }
}

impl Sink for Folder {
    fn add(&mut self, frame: Frame<'_>) -> Result<(), CliError> {
        let names = names(self.views.len(), self.depth);
        let k = &frame.view.camera.intrinsics;
        let array = npy::encode(frame.depth, k.width, k.height);
        for (variant, picture) in frame.pictures.iter().enumerate() {
            picture::save_png(picture, &self.stage(variant, &names[0])?)?;
            if let Some(depth) = names.get(1) {
                let path = self.stage(variant, depth)?;
                fs::write(&path, &array).map_err(CliError::write(&path))?;
            }
        }
        self.views.push(frame.view.clone());
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        let text = cameras(&self.views, &self.layout, self.depth, self.synthetic);
        for variant in 0..self.variants.len() {
            let path = self.stage(variant, CAMERAS)?;
            fs::write(&path, &text).map_err(CliError::write(&path))?;
        }
        self.staging.commit()?;
        Ok(self
            .variants
            .iter()
            .map(|name| self.path.join(name))
            .collect())
    }
}
