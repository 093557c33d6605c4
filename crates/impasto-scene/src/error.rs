//! What can be wrong with a capture.

use std::path::{Path, PathBuf};

use crate::file::{LARGEST_FILE, plainly, read_whole};

/// Why a capture could not be loaded. Each message says what is wrong, where, and, where that is
/// not obvious, what to do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The given path does not exist.
    #[error("{}: no such file or folder; give the folder of a capture", path.display())]
    Missing {
        /// The path given.
        path: PathBuf,
    },
    /// Nothing that any reader understands is there.
    #[error(
        "{}: {found}. Supported captures: a COLMAP model (sparse/0/*.bin or *.txt, with images/), \
         transforms.json (instant-ngp, nerfstudio) or transforms_train.json (Blender), NeRF++ \
         folders (train/pose, train/intrinsics, train/rgb) and LLFF's poses_bounds.npy",
        path.display()
    )]
    Unrecognised {
        /// The path given.
        path: PathBuf,
        /// What was found instead.
        found: String,
    },
    /// The operating system refused to read a file.
    #[error("{}: cannot be read ({})", path.display(), plainly(source))]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file breaks the rules of its format.
    #[error("{}, {place}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it: a byte, a line or a frame.
        place: String,
        /// What is wrong there.
        problem: String,
    },
    /// A lens that this program cannot model.
    #[error(
        "{}, {place}: the lens model {model} is not supported (supported: SIMPLE_PINHOLE, PINHOLE, \
         SIMPLE_RADIAL, RADIAL, OPENCV); undistort the photos first, for example with `colmap \
         image_undistorter`",
        path.display()
    )]
    LensModel {
        /// The file.
        path: PathBuf,
        /// Which camera or frame.
        place: String,
        /// The model's name.
        model: String,
    },
    /// A pose that is not a rigid transform.
    #[error("{}: pose of frame {frame} {problem}", path.display())]
    Pose {
        /// The file that holds the pose.
        path: PathBuf,
        /// The frame's name.
        frame: String,
        /// What is wrong, as the end of a sentence.
        problem: String,
    },
    /// A frame's photo is not there.
    #[error(
        "the photo of frame {frame} is missing: there is no {}; put it there or remove the frame",
        path.display()
    )]
    PhotoMissing {
        /// The frame's name.
        frame: String,
        /// Where the photo should be.
        path: PathBuf,
    },
    /// A photo cannot be decoded.
    #[error("{}: not a usable photo ({problem}); replace it or remove its frame", path.display())]
    Photo {
        /// The photo's file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A mask cannot be used.
    #[error(
        "{}: not a usable mask ({problem}); make it a picture of its photo's shape, white where the \
         photo is used, or train with --masks off",
        path.display()
    )]
    Mask {
        /// The mask's file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A photo's size is not what it was a moment ago.
    #[error(
        "{}: the photo changed while the capture was read; wait until it is complete and try again",
        path.display()
    )]
    Changed {
        /// The photo's file.
        path: PathBuf,
    },
    /// A photo's name leads out of the capture.
    #[error(
        "{}: the photo name {name:?} leads out of the capture's folder {}; put the photo into that \
         folder and name it relative to it",
        path.display(), shown(root)
    )]
    Outside {
        /// The file that states the name.
        path: PathBuf,
        /// The name.
        name: String,
        /// The folder.
        root: PathBuf,
    },
    /// Two frames have one name or one photo.
    #[error(
        "{}: the frames {first} and {second} are of the same photo; keep one of them", path.display()
    )]
    Duplicate {
        /// The capture.
        path: PathBuf,
        /// A frame's name.
        first: String,
        /// The other's.
        second: String,
    },
    /// A photo does not fit its camera.
    #[error(
        "{}: the photo is {}×{} pixels but its camera was calibrated for {}×{}, another shape; use \
         the photos that the poses were computed from",
        path.display(), photo.0, photo.1, camera.0, camera.1
    )]
    PhotoSize {
        /// The photo's file.
        path: PathBuf,
        /// Width and height of the photo.
        photo: (u32, u32),
        /// Width and height that the camera is for.
        camera: (u32, u32),
    },
    /// Too few photos to learn from and check against.
    #[error("{}: the capture has {count} posed photo(s); at least 2 are needed, add \
         photos or compute the poses of more", path.display())]
    TooFewPhotos {
        /// The capture.
        path: PathBuf,
        /// How many there are.
        count: usize,
    },
    /// All cameras stand at one place.
    #[error(
        "{}: all {count} cameras stand at one place, so no depth can be learned; photos must be \
         taken from different places",
        path.display()
    )]
    OnePlace {
        /// The capture.
        path: PathBuf,
        /// How many cameras.
        count: usize,
    },
    /// A load option is out of range.
    #[error("downscale must be at least 1, not {0}")]
    Downscale(u32),
}

/// A folder in a sentence, also the current one.
fn shown(folder: &Path) -> String {
    if folder.as_os_str().is_empty() {
        return ".".into();
    }
    folder.display().to_string()
}

impl SceneError {
    /// A file or folder that the system does not let be read.
    pub(crate) fn io(path: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        |source| Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn malformed(
        path: &Path,
        place: impl Into<String>,
        problem: impl Into<String>,
    ) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            place: place.into(),
            problem: problem.into(),
        }
    }

    /// A pose, stated in `path`, with what is wrong with it as the end of a sentence.
    pub(crate) fn pose(path: &Path, frame: &str, problem: impl Into<String>) -> Self {
        Self::Pose {
            path: path.to_owned(),
            frame: frame.to_owned(),
            problem: problem.into(),
        }
    }

    pub(crate) fn lens_model(path: &Path, place: &str, model: impl Into<String>) -> Self {
        Self::LensModel {
            path: path.to_owned(),
            place: place.to_owned(),
            model: model.into(),
        }
    }
}

/// Reads a whole file; a failure names it.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_whole(path, LARGEST_FILE).map_err(SceneError::io(path))
}

/// Reads a whole text file; a failure names it.
pub(crate) fn read_text(path: &Path) -> Result<String, SceneError> {
    String::from_utf8(read_bytes(path)?).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        SceneError::malformed(
            path,
            format!("byte {at}"),
            "this is not text (not UTF-8); export it again",
        )
    })
}
