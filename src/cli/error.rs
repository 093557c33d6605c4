//! Everything that ends a command early.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use impasto::eval::EvalError;
use impasto::eval::study::StudyError;
use impasto::export::ExportError;
use impasto::prepare::PrepareError;
use impasto::scene::SceneError;
use impasto::scene::builtin::WriteCaptureError;
use impasto::scene::file::plainly;
use impasto::scene::paths::PathError;
use impasto::view::ViewError;
use impasto::{LayerError, ModelError, NoDevice, StyleError, TrainError};

use super::CommandOutput;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The arguments make no sense together.
    #[error("{0}")]
    Usage(String),
    /// The arguments ask for what this version cannot do, or the data does not allow.
    #[error("{0}")]
    Refused(String),
    /// Items of a batch failed. What there is to say of all is printed as if none had.
    #[error(
        "some of the batch failed, see above; mend it and run the same command again, what is done \
         is kept"
    )]
    SomeFailed(Box<CommandOutput>),
    /// Styles for a model without any.
    #[error("this model has learned no styles; train it with --stage style first")]
    Unstyled,
    /// The device that was asked for.
    #[error(transparent)]
    Device(#[from] NoDevice),
    /// The GPU gave up.
    #[error(
        "computing on {name} failed: {reason}; give it less at a time (a smaller --size, a larger \
         --downscale, fewer rays), or use --device cpu"
    )]
    Gpu {
        /// Which.
        name: String,
        /// What was heard of it first.
        reason: String,
    },
    /// The capture.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Making a capture of raw photos.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// Writing the built-in capture.
    #[error(transparent)]
    Capture(#[from] WriteCaptureError),
    /// A model file.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Training.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A style image or the networks that look at it.
    #[error(transparent)]
    Style(#[from] StyleError),
    /// An evaluation.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// Points or splats for other programs.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// A study with people.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// The studio.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A camera path fitted to the capture.
    #[error("the camera path cannot be made: {0}")]
    Path(#[from] PathError),
    /// A camera path from a file.
    #[error("{}: {source}", path.display())]
    PathFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PathError,
    },
    /// A file of coats.
    #[error("{}: not a file of coats: {problem}; docs/studio.md describes its form", path.display())]
    CoatsFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A coat cannot be put on.
    #[error(transparent)]
    StyleLayer(#[from] LayerError),
    /// A style image cannot be decoded.
    #[error(
        "{}: not a usable painting ({problem}); give a JPEG, PNG, WebP, TIFF or GIF picture",
        path.display()
    )]
    Painting {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A file cannot be read.
    #[error("{}: cannot be read ({})", path.display(), plainly(source))]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file or folder cannot be written.
    #[error("cannot write {}: {}; choose another output", path.display(), refusal(source))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Films need a program that is not there.
    #[error(
        "{}: such films are made by ffmpeg, which cannot be started as \"{}\" ({}); install it \
         (Debian: apt install ffmpeg), name its program in IMPASTO_FFMPEG, or use .gif",
        path.display(), program.display(), plainly(source)
    )]
    NoFfmpeg {
        /// The film.
        path: PathBuf,
        /// Where it was looked for.
        program: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// ffmpeg gave up on a film.
    #[error("{}: ffmpeg failed (\"{said}\"); use another --size, another format or .gif", path.display())]
    Ffmpeg {
        /// The film.
        path: PathBuf,
        /// Its last line.
        said: String,
    },
    /// Somebody asked for an end.
    #[error("stopped; nothing was written")]
    Stopped,
    /// A picture cannot be encoded.
    #[error("cannot write the picture {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
}

/// Why a path cannot be written.
fn refusal(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "a folder above it is missing".into(),
        io::ErrorKind::PermissionDenied => "permission denied".into(),
        _ => plainly(error),
    }
}

impl CliError {
    /// A failed look at `path`.
    pub fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::Read { path, source }
    }

    /// A failed write to `path`.
    pub fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::Write { path, source }
    }

    /// A failed encoding of `path`; the system's refusals are told as such.
    pub fn encode(path: &Path) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.to_owned();
        |source| match source {
            image::ImageError::IoError(source) => Self::Write { path, source },
            source => Self::Encode { path, source },
        }
    }

    /// 2 for wrong usage, else 1.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Usage(_) => ExitCode::from(2),
            _ => ExitCode::FAILURE,
        }
    }
}
