//! Folders of frames that several processes fill together, each at its own pace and as often as it
//! takes.

use std::fs;
use std::path::{Path, PathBuf};

use impasto::scene::npy;
use serde_json::Value;

use super::atomic::{listed, put, sweep};
use super::frame::RenderedFrame;
use super::job;
use super::layout::FrameLayout;
use super::numbered::{CAMERAS, names};
use super::picture;
use crate::cli::CliError;

/// What [`super::numbered::NumberedFrames`] leaves, and `job.json`. Every file appears whole on its own, and a
/// frame that is there is not made again; `cameras.json` comes when all frames are there.
#[derive(Debug)]
pub struct SharedFolder {
    path: PathBuf,
    /// Where the frames of the variants are.
    pub folders: Vec<PathBuf>,
    frames: usize,
    depth: bool,
    cameras: String,
}

/// What a [`SharedFolder`] will hold.
pub struct SharedFrames<'a> {
    /// What each frame shows; where several variants have outputs of their own, each has a sub-folder.
    pub layout: &'a FrameLayout,
    /// Number of frames.
    pub frames: usize,
    /// Whether there are depth files.
    pub depth: bool,
    /// Text of `cameras.json`.
    pub cameras: &'a str,
    /// What distinguishes this job from others.
    pub job: &'a Value,
}

impl SharedFolder {
    /// Makes the folder or joins those who write to it.
    ///
    /// # Errors
    /// When it cannot be made or written to, or belongs to another job.
    pub fn open(path: &Path, contents: &SharedFrames<'_>) -> Result<Self, CliError> {
        let names = contents.layout.folders().into_iter();
        let folder = |name: String| match name.as_str() {
            "" => path.to_owned(),
            name => path.join(name),
        };
        let shared = Self {
            path: path.to_owned(),
            folders: names.map(folder).collect(),
            frames: contents.frames,
            depth: contents.depth,
            cameras: contents.cameras.to_owned(),
        };
        // Looked at before the job is: whoever writes frames has taken the folder before.
        let others = shared.first_file()?;
        for folder in &shared.folders {
            fs::create_dir_all(folder).map_err(CliError::write(folder))?;
        }
        job::claim(path, contents.job, others.as_deref())?;
        shared.withdraw()?;
        Ok(shared)
    }

    /// Names of all frames' files in a folder.
    fn names(&self) -> impl Iterator<Item = String> {
        (0..self.frames).flat_map(|frame| names(frame, self.depth))
    }

    /// The first file that could be a job's.
    fn first_file(&self) -> Result<Option<String>, CliError> {
        for folder in &self.folders {
            let present = listed(folder)?;
            let mut names = self.names().chain([CAMERAS.into()]);
            if let Some(name) = names.find(|name| present.contains(name)) {
                return Ok(Some(folder.join(name).display().to_string()));
            }
        }
        Ok(None)
    }

    /// Removes `cameras.json` where frames have gone since: whoever finds it finds all.
    fn withdraw(&self) -> Result<(), CliError> {
        for folder in &self.folders {
            let cameras = folder.join(CAMERAS);
            // In this order: while others finish, frames only become more.
            if cameras.exists() && !self.is_complete()? {
                fs::remove_file(&cameras).map_err(CliError::write(&cameras))?;
            }
        }
        Ok(())
    }

    fn is_complete(&self) -> Result<bool, CliError> {
        for folder in &self.folders {
            let present = listed(folder)?;
            if !self.names().all(|name| present.contains(&name)) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether a file of this frame is still to be made.
    pub fn lacks(&self, frame: usize) -> bool {
        let names = names(frame, self.depth);
        let mut files = self
            .folders
            .iter()
            .flat_map(|folder| names.iter().map(move |name| folder.join(name)));
        files.any(|file| !file.exists())
    }

    /// Writes those files of a frame that are missing.
    pub fn add(&self, number: usize, frame: &RenderedFrame<'_>) -> Result<(), CliError> {
        let k = &frame.view.camera.intrinsics;
        for (folder, picture) in self.folders.iter().zip(&frame.pictures) {
            for name in names(number, self.depth) {
                let path = folder.join(&name);
                if path.exists() {
                    continue;
                }
                let bytes = if name.ends_with(".png") {
                    picture::png(picture).map_err(CliError::encode(&path))?
                } else {
                    npy::encode(frame.depth, k.width, k.height)
                };
                put(&path, &bytes)?;
            }
        }
        Ok(())
    }

    /// Cleans up, and writes `cameras.json` if all frames are there; tells whether they are.
    pub fn finish(&self) -> Result<bool, CliError> {
        let complete = self.is_complete()?;
        for folder in &self.folders {
            let cameras = folder.join(CAMERAS);
            let present = fs::read(&cameras).ok();
            if complete && present.as_deref() != Some(self.cameras.as_bytes()) {
                put(&cameras, self.cameras.as_bytes())?;
            }
            sweep(folder, &listed(folder)?);
        }
        sweep(&self.path, &listed(&self.path)?);
        Ok(complete)
    }
}
