//! Numbered frames with their cameras, in a folder or in one file.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use impasto::scene::npy;
use serde_json::{Value, json};

use super::frame::{RenderedFrame, Sink, Viewpoint};
use super::layout::FrameLayout;
use super::picture;
use super::staging::{Staging, file_name, parent};
use super::zip::ZipWriter;
use crate::cli::{CliError, to_json};

/// The file that says where the frames were seen from.
pub const CAMERAS: &str = "cameras.json";

/// Names of a frame's files.
pub fn names(frame: usize, depth: bool) -> Vec<String> {
    let mut names = vec![format!("{frame:04}.png")];
    if depth {
        names.push(format!("{frame:04}.depth.npy"));
    }
    names
}

/// The text of `cameras.json`. Where several pictures are side by side on one, `side_by_side` there
/// names them from the left; each is `w` pixels wide.
pub fn cameras<'a>(
    views: impl IntoIterator<Item = &'a Viewpoint>,
    layout: &FrameLayout,
    depth: bool,
    synthetic: bool,
) -> String {
    let entry = |(frame, view): (usize, &Viewpoint)| {
        let mut entry = to_json(&view.camera);
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
    if let FrameLayout::SideBySide(names) = layout {
        text["side_by_side"] = names.as_slice().into();
    }
    format!("{text:#}\n")
}

/// `0000.png …`, `0000.depth.npy …` and `cameras.json`; with several variants, all of that in one
/// sub-folder per variant, so that each can be read alone.
pub struct NumberedFrames {
    path: PathBuf,
    staging: Staging,
    /// The one file that holds them, if it is not a folder.
    archive: Option<ZipWriter<BufWriter<File>>>,
    layout: FrameLayout,
    depth: bool,
    synthetic: bool,
    views: Vec<Viewpoint>,
}

impl NumberedFrames {
    /// Begins to write to the folder `path`.
    pub fn in_folder(
        path: &Path,
        layout: FrameLayout,
        depth: bool,
        synthetic: bool,
    ) -> Result<Self, CliError> {
        Ok(Self {
            path: path.to_owned(),
            staging: Staging::new(path)?,
            archive: None,
            layout,
            depth,
            synthetic,
            views: Vec::new(),
        })
    }

    /// Begins a ZIP that will be at `path`; without depth.
    pub fn in_archive(path: &Path, layout: FrameLayout, synthetic: bool) -> Result<Self, CliError> {
        let mut frames = Self::in_folder(&parent(path), layout, false, synthetic)?;
        let file = File::create(frames.staging.file(&file_name(path))?);
        let file = file.map_err(CliError::write(path))?;
        frames.archive = Some(ZipWriter::new(BufWriter::new(file)));
        path.clone_into(&mut frames.path);
        Ok(frames)
    }

    /// Adds a file of the variant that has this sub-folder.
    fn put(&mut self, folder: &str, name: &str, bytes: &[u8]) -> Result<(), CliError> {
        let name = match folder {
            "" => name.to_owned(),
            folder => format!("{folder}/{name}"),
        };
        match &mut self.archive {
            Some(zip) => (zip.add(&name, bytes)).map_err(|error| archive_error(&self.path, error)),
            None => self.staging.write(&name, bytes),
        }
    }
}

fn archive_error(path: &Path, error: io::Error) -> CliError {
    match error.kind() {
        io::ErrorKind::FileTooLarge => CliError::Refused(format!(
            "{}: these frames are more than a .zip can hold (4 GiB); give a folder",
            path.display()
        )),
        _ => CliError::write(path)(error),
    }
}

impl Sink for NumberedFrames {
    fn add(&mut self, frame: RenderedFrame<'_>) -> Result<(), CliError> {
        let names = names(self.views.len(), self.depth);
        let k = &frame.view.camera.intrinsics;
        for (folder, picture) in self.layout.folders().iter().zip(&frame.pictures) {
            let png = picture::png(picture).map_err(CliError::encode(&self.path))?;
            self.put(folder, &names[0], &png)?;
            if let Some(depth) = names.get(1) {
                let array = npy::encode(frame.depth, k.width, k.height);
                self.put(folder, depth, &array)?;
            }
        }
        self.views.push(frame.view.clone());
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        let text = cameras(&self.views, &self.layout, self.depth, self.synthetic);
        let folders = self.layout.folders();
        for folder in &folders {
            self.put(folder, CAMERAS, text.as_bytes())?;
        }
        let paths = match self.archive.take() {
            Some(zip) => {
                zip.finish()
                    .map_err(|error| archive_error(&self.path, error))?;
                vec![self.path]
            }
            None => folders.iter().map(|name| self.path.join(name)).collect(),
        };
        self.staging.commit()?;
        Ok(paths)
    }
}
