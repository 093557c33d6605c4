//! Where frames go, and as what.

use std::path::{Path, PathBuf};

use super::film::{FfmpegProgram, FilmFormat, FilmOptions, Films};
use super::frame::Sink;
use super::job::JOB_FILE;
use super::layout::FrameLayout;
use super::numbered::NumberedFrames;
use super::sheet::Sheet;
use super::staging::{check_folder, parent};
use crate::cli::CliError;

#[derive(Debug)]
enum Kind {
    Folder { depth: bool },
    Archive,
    Sheet,
    Film(FilmOptions),
}

/// Where frames go, by the path's ending.
#[derive(Debug)]
pub struct Target {
    path: PathBuf,
    kind: Kind,
}

/// How a [`Target`] is written.
#[derive(Debug, Clone)]
pub struct TargetOptions {
    /// Depth files too.
    pub depth: bool,
    /// Frames a second that were asked for.
    pub fps: Option<f64>,
    /// Frames a second of a film if none were asked for; if `None`, the format's own.
    pub path_fps: Option<f64>,
    /// By which ffmpeg films are made.
    pub ffmpeg: FfmpegProgram,
}

impl Target {
    /// Decides what `path` stands for: `.png`, `.gif`, `.mp4`, `.webm`, `.zip`, or a
    /// folder.
    pub fn new(path: &Path, wanted: &TargetOptions) -> Result<Self, CliError> {
        const OTHERS: [&str; 9] = [
            "mov", "mkv", "avi", "jpg", "jpeg", "webp", "bmp", "tif", "tiff",
        ];
        let depth = wanted.depth;
        let ending = path
            .extension()
            .map(|e| e.to_string_lossy().to_ascii_lowercase());
        let ending = ending.as_deref().unwrap_or_default();
        let kind = match FilmFormat::of_ending(ending) {
            _ if path.is_dir() => Kind::Folder { depth },
            Some(format) => Kind::Film(wanted.film(format)),
            None if ending == "png" => Kind::Sheet,
            None if ending == "zip" => Kind::Archive,
            None if OTHERS.contains(&ending) => {
                return Err(CliError::Refused(format!(
                    "{}: .{ending} is not supported; use .mp4, .webm, .gif, .png, .zip or a \
                     folder",
                    path.display()
                )));
            }
            None => Kind::Folder { depth },
        };
        let refuse = |problem: &str| Err(CliError::Usage(problem.into()));
        if depth && !matches!(kind, Kind::Folder { .. }) {
            return refuse("--depth needs a folder as its output");
        }
        if wanted.fps.is_some() && !matches!(kind, Kind::Film(_)) {
            return refuse("--fps is for films: give -o FILE.mp4, FILE.webm or FILE.gif");
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
        match &self.kind {
            Kind::Folder { .. } if self.path.join(JOB_FILE).exists() => {
                Err(CliError::Refused(format!(
                    "{} belongs to a job that is rendered in shards (it holds {}); choose another \
                     folder or remove this one",
                    self.path.display(),
                    JOB_FILE
                )))
            }
            Kind::Folder { .. } => check_folder(&self.path),
            Kind::Archive | Kind::Sheet => check_folder(&parent(&self.path)),
            Kind::Film(options) => {
                options.check(&self.path)?;
                check_folder(&parent(&self.path))
            }
        }
    }

    /// Begins to write frames.
    pub fn open(&self, layout: &FrameLayout, synthetic: bool) -> Result<Box<dyn Sink>, CliError> {
        Ok(match &self.kind {
            Kind::Folder { depth } => Box::new(NumberedFrames::in_folder(
                &self.path,
                layout.clone(),
                *depth,
                synthetic,
            )?),
            Kind::Archive => Box::new(NumberedFrames::in_archive(
                &self.path,
                layout.clone(),
                synthetic,
            )?),
            Kind::Sheet => Box::new(Sheet::new(&self.path)),
            Kind::Film(options) => Box::new(Films::new(&self.path, layout.variants(), options)?),
        })
    }
}

impl TargetOptions {
    fn film(&self, format: FilmFormat) -> FilmOptions {
        let path_fps = self.path_fps.map(|fps| format.nearest_fps(fps));
        FilmOptions {
            format,
            fps: self.fps.or(path_fps).unwrap_or(format.usual_fps()),
            ffmpeg: self.ffmpeg.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(path: &str, change: impl FnOnce(&mut TargetOptions)) -> Result<Target, CliError> {
        let mut wanted = TargetOptions {
            depth: false,
            fps: None,
            path_fps: None,
            ffmpeg: FfmpegProgram::new(Path::new("ffmpeg")),
        };
        change(&mut wanted);
        Target::new(Path::new(path), &wanted)
    }

    #[test]
    fn the_ending_decides() {
        let kind = |path: &str| target(path, |_| ()).map(|target| target.kind);
        assert!(matches!(kind("a/b.PNG"), Ok(Kind::Sheet)));
        assert!(matches!(kind("out.v2"), Ok(Kind::Folder { depth: false })));
        assert!(matches!(kind("clip.mov"), Err(CliError::Refused(_))));
        let depth = target("b.gif", |wanted| wanted.depth = true);
        assert!(matches!(depth, Err(CliError::Usage(_))));
        let fps = target("out", |wanted| wanted.fps = Some(24.0));
        assert!(matches!(fps, Err(CliError::Usage(_))));
    }

    #[test]
    fn a_film_goes_as_fast_as_was_asked_or_as_its_path() {
        let film = |path: &str, asked, of_path| {
            let made = target(path, |wanted| {
                (wanted.fps, wanted.path_fps) = (asked, of_path);
            });
            match made.map(|target| target.kind) {
                Ok(Kind::Film(options)) => Some((options.format, options.fps)),
                _ => None,
            }
        };
        assert_eq!(film("b.gif", None, None), Some((FilmFormat::Gif, 12.5)));
        assert_eq!(film("b.MP4", None, None), Some((FilmFormat::Mp4, 24.0)));
        assert_eq!(
            film("b.webm", None, Some(30.0)),
            Some((FilmFormat::WebM, 30.0))
        );
        assert_eq!(
            film("b.gif", None, Some(60.0)),
            Some((FilmFormat::Gif, 50.0))
        );
        assert_eq!(
            film("b.gif", Some(10.0), Some(60.0)),
            Some((FilmFormat::Gif, 10.0))
        );
    }
}
