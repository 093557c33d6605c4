//! Why a capture could not be prepared.

use std::io;
use std::path::{Path, PathBuf};

use impasto_scene::SceneError;

use crate::video::endings::ENDINGS;

/// Why a capture could not be prepared. Each message says what is wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The given path does not exist.
    #[error("{}: no such file or folder; give a folder of photos or a video", .0.display())]
    Missing(PathBuf),
    /// The given file is no video.
    #[error(
        "{}: neither a folder of photos nor a video that is known by its ending ({})",
        .0.display(), ENDINGS.join(", ")
    )]
    Unsupported(PathBuf),
    /// There is something else where the capture should be.
    #[error("{} holds other files already ({found}); choose another output folder", path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// One of the files.
        found: String,
    },
    /// Another process prepares the same capture.
    #[error("another process is preparing {} right now; wait for it or choose another output", .0.display())]
    Busy(PathBuf),
    /// The system refused to read.
    #[error("{}: cannot be read ({source})", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The system refused to write.
    #[error("cannot write {}: {source}; choose another output", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Not enough to work with.
    #[error(
        "{}: {usable} usable photo(s) in {given} file(s){reasons}; at least 3 photos that overlap are needed",
        path.display()
    )]
    TooFewPhotos {
        /// The folder or video.
        path: PathBuf,
        /// Photos that can be used.
        usable: usize,
        /// Files looked at.
        given: usize,
        /// Why others cannot, in parentheses, or nothing.
        reasons: String,
    },
    /// One camera cannot have taken photos of two sizes.
    #[error(
        "{first} is {}×{} pixels but {other} is {}×{}, so they cannot share one camera; leave out \
         --cameras one, or make all photos the same size",
        sizes[0].0, sizes[0].1, sizes[1].0, sizes[1].1
    )]
    TwoSizes {
        /// One photo.
        first: String,
        /// Another.
        other: String,
        /// Their widths and heights.
        sizes: [(u32, u32); 2],
    },
    /// A program is not there.
    #[error(
        "{name} is needed but cannot be started as \"{}\" ({source}); install it (Debian: apt \
         install {package}) or name the program in the variable {variable}",
        program.display()
    )]
    ProgramMissing {
        /// What people call it.
        name: &'static str,
        /// Where it was looked for.
        program: PathBuf,
        /// Debian's package.
        package: &'static str,
        /// The environment variable that names it.
        variable: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// An option that is needed has another name in this version.
    #[error(
        "the installed COLMAP ({version}) has no option {option} in its command {command}; install \
         version 3.8, or name its program in IMPASTO_COLMAP. Its output is in {}",
        log.display()
    )]
    UnknownOption {
        /// The version, as it calls itself.
        version: String,
        /// COLMAP's command.
        command: String,
        /// The option, or the options of which one would do.
        option: String,
        /// Where the output is.
        log: PathBuf,
    },
    /// The system or a person ended a program.
    #[error(
        "{command} was killed (signal {signal}), which is how a system ends a program when memory \
         runs out; use fewer or smaller photos, or a machine with more memory. Its output is in {}",
        log.display()
    )]
    Killed {
        /// The program and its command.
        command: String,
        /// The signal's number.
        signal: i32,
        /// Where the output is.
        log: PathBuf,
    },
    /// A program failed.
    #[error("{command} failed: {how}; see its whole output in {}", log.display())]
    Failed {
        /// The program and its command.
        command: String,
        /// The exit code or signal, and what it said last.
        how: String,
        /// Where the output is.
        log: PathBuf,
    },
    /// A video that ffmpeg cannot decode.
    #[error(
        "{}: no usable video ({problem}); convert it to mp4 and try again, or give a folder of \
         photos. The output of ffmpeg is in {}",
        path.display(), log.display()
    )]
    Video {
        /// The video.
        path: PathBuf,
        /// What ffmpeg says.
        problem: String,
        /// Where the output is.
        log: PathBuf,
    },
    /// COLMAP placed no cameras, or too few to use.
    #[error(
        "COLMAP could place {registered} of {photos} photos: too few of them show the same things. \
         Take photos that overlap by more than half, from different places{advice}. Its output is \
         in {}",
        log.display()
    )]
    NotRegistered {
        /// Photos in the largest model.
        registered: usize,
        /// Photos in all.
        photos: usize,
        /// More to try, with a comma before, or nothing.
        advice: &'static str,
        /// Where the output is.
        log: PathBuf,
    },
    /// COLMAP's model cannot be used.
    #[error("COLMAP's model cannot be used: {source} (its output is in {})", log.display())]
    Scene {
        /// What is wrong with it.
        source: SceneError,
        /// Where the output is.
        log: PathBuf,
    },
    /// A picture cannot be encoded.
    #[error("cannot write the picture {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
}

impl PrepareError {
    /// A failed look at `path`.
    pub(crate) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::Read { path, source }
    }

    /// A failed write to `path`.
    pub(crate) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::Write { path, source }
    }

    /// A failed encoding of `path`; the system's refusals are told as such.
    pub(crate) fn encode(path: &Path) -> impl FnOnce(image::ImageError) -> Self {
        let path = path.to_owned();
        |source| match source {
            image::ImageError::IoError(source) => Self::Write { path, source },
            source => Self::Encode { path, source },
        }
    }
}
