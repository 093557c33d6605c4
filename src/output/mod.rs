//! Pictures, films and folders of frames, written as a whole or not at all; where several processes
//! share a folder, file by file.

mod atomic;
mod film;
mod folder;
pub mod grid;
pub mod job;
pub mod lettering;
pub mod picture;
mod shared;
mod sheet;
mod staging;

pub use atomic::put;
pub use film::Film;
pub use folder::cameras;
pub use shared::{Contents, SharedFolder};
pub use staging::{Staging, check_folder};

use std::path::{Path, PathBuf};

use image::RgbImage;
use impasto::scene::Camera;

use crate::cli::CliError;

/// A viewpoint to render.
#[derive(Debug, Clone)]
pub struct View {
    /// The camera, in scene space.
    pub camera: Camera,
    /// The photo's name, where this is a photo's viewpoint.
    pub photo: Option<String>,
}

/// One rendered view.
pub struct Frame<'a> {
    /// From where.
    pub view: &'a View,
    /// One picture per variant.
    pub pictures: Vec<RgbImage>,
    /// Depth along the camera's axis, scene units, row by row.
    pub depth: &'a [f32],
}

/// Takes frames and leaves nothing behind unless it is finished.
pub trait Sink {
    /// Takes the next frame.
    fn add(&mut self, frame: Frame<'_>) -> Result<(), CliError>;

    /// Completes the output and names the files or folders that hold it.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, CliError>;
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Folder { depth: bool },
    Sheet,
    Film,
}

/// Where frames go, by the path's ending.
#[derive(Debug)]
pub struct Target {
    path: PathBuf,
    kind: Kind,
}

impl Target {
    /// Decides what `path` stands for: `.png`, `.gif`, or a folder. `depth` asks for depth files.
    pub fn new(path: &Path, depth: bool) -> Result<Self, CliError> {
        const OTHERS: [&str; 11] = [
            "mp4", "mov", "webm", "mkv", "avi", "jpg", "jpeg", "webp", "bmp", "tif", "tiff",
        ];
        let ending = path
            .extension()
            .map(|e| e.to_string_lossy().to_ascii_lowercase());
        let kind = match ending.as_deref() {
            _ if path.is_dir() => Kind::Folder { depth },
            Some("png") => Kind::Sheet,
            Some("gif") => Kind::Film,
            Some(other) if OTHERS.contains(&other) => {
                return Err(CliError::Refused(format!(
                    "{}: .{other} is not supported yet; use .gif, .png or a folder",
                    path.display()
                )));
            }
            _ => Kind::Folder { depth },
        };
        if depth && !matches!(kind, Kind::Folder { .. }) {
            return Err(CliError::Usage(
                "--depth needs a folder as its output".into(),
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            kind,
        })
    }

    /// Whether this is a folder of frames.
    pub fn is_folder(&self) -> bool {
        matches!(self.kind, Kind::Folder { .. })
    }

    /// Fails early where nothing can be written, or where others are at work.
    pub fn check(&self) -> Result<(), CliError> {
        match self.kind {
            Kind::Folder { .. } if self.path.join(job::JOB_FILE).exists() => {
                Err(CliError::Refused(format!(
                    "{} belongs to a job that is rendered in shards (it holds {}); choose another \
                     folder or remove this one",
                    self.path.display(),
                    job::JOB_FILE
                )))
            }
            Kind::Folder { .. } => check_folder(&self.path),
            Kind::Sheet | Kind::Film => check_folder(&parent(&self.path)),
        }
    }

    /// Begins to write frames of the given variants.
    pub fn open(&self, variants: &[String], synthetic: bool) -> Result<Box<dyn Sink>, CliError> {
        Ok(match self.kind {
            Kind::Folder { depth } => {
                Box::new(folder::Folder::new(&self.path, variants, depth, synthetic)?)
            }
            Kind::Sheet => Box::new(sheet::Sheet::new(&self.path)),
            Kind::Film => Box::new(film::Films::new(&self.path, variants)),
        })
    }
}

/// The folder that a file is in.
pub fn parent(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => ".".into(),
    }
}

/// Writes one file under a temporary name and renames it when `write` is through.
pub fn write_file(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), CliError>,
) -> Result<(), CliError> {
    let mut staging = Staging::new(&parent(path))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    write(&staging.file(&name)?)?;
    staging.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_decides() {
        let kind = |path: &str| Target::new(Path::new(path), false).map(|t| t.kind).ok();
        assert_eq!(kind("a/b.PNG"), Some(Kind::Sheet));
        assert_eq!(kind("b.gif"), Some(Kind::Film));
        assert_eq!(kind("out.v2"), Some(Kind::Folder { depth: false }));
        assert_eq!(kind("clip.mp4"), None);
        let depth = Target::new(Path::new("b.gif"), true);
        assert!(matches!(depth, Err(CliError::Usage(_))));
    }
}
