//! Numbered frames with their cameras.

use std::fs;
use std::path::{Path, PathBuf};

use impasto::scene::npy;
use serde_json::{Value, json};

use super::{Frame, Sink, Staging, picture};
use crate::cli::CliError;

/// `0000.png …`, `0000.depth.npy …` and `cameras.json`; with several variants, all of that in one
/// sub-folder per variant, so that each can be read alone.
pub struct Folder {
    path: PathBuf,
    staging: Staging,
    /// Sub-folders, empty for the folder itself.
    variants: Vec<PathBuf>,
    depth: bool,
    synthetic: bool,
    frames: Vec<Value>,
}

impl Folder {
    /// Begins to write to `path`.
    pub fn new(
        path: &Path,
        variants: &[String],
        depth: bool,
        synthetic: bool,
    ) -> Result<Self, CliError> {
        Ok(Self {
            path: path.to_owned(),
            staging: Staging::new(path)?,
            variants: match variants {
                [] | [_] => vec![PathBuf::new()],
                several => several.iter().map(PathBuf::from).collect(),
            },
            depth,
            synthetic,
            frames: Vec::new(),
        })
    }

    fn stage(&mut self, variant: usize, name: &str) -> Result<PathBuf, CliError> {
        let name = self.variants[variant].join(name);
        self.staging.file(&name.to_string_lossy())
    }
}

impl Sink for Folder {
    fn add(&mut self, frame: Frame<'_>) -> Result<(), CliError> {
        let number = self.frames.len();
        let (file, depth) = (format!("{number:04}.png"), format!("{number:04}.depth.npy"));
        let k = &frame.view.camera.intrinsics;
        let array = npy::encode(frame.depth, k.width, k.height);
        for (variant, picture) in frame.pictures.iter().enumerate() {
            picture::save_png(picture, &self.stage(variant, &file)?)?;
            if self.depth {
                let path = self.stage(variant, &depth)?;
                fs::write(&path, &array).map_err(CliError::write(&path))?;
            }
        }
        let mut entry = crate::cli::to_json(&frame.view.camera);
        entry["file"] = file.into();
        if self.depth {
            entry["depth_file"] = depth.into();
        }
        if let Some(photo) = &frame.view.photo {
            entry["photo"] = photo.as_str().into();
        }
        self.frames.push(entry);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        let cameras = json!({"synthetic": self.synthetic, "frames": self.frames});
        let text = format!("{cameras:#}\n");
        for variant in 0..self.variants.len() {
            let path = self.stage(variant, "cameras.json")?;
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
