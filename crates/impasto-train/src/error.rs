use crate::event::Stage;
use impasto_model::{CHECKPOINT_FILE, ModelError};
use std::path::{Path, PathBuf};

/// Why a run could not start or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The capture cannot be used.
    #[error(transparent)]
    Scene(#[from] impasto_scene::SceneError),
    /// Weights or pictures cannot be used.
    #[error(transparent)]
    Style(#[from] impasto_style::StyleError),
    /// A model cannot be read or written, or a setting is out of range.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A checkpoint cannot be used.
    #[error("{}: {reason}; remove it to start over", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Another process writes to the model folder.
    #[error(
        "{}: another run (process {process}) is training this model; wait for its end or choose another output",
        folder.display()
    )]
    Busy {
        /// The folder.
        folder: PathBuf,
        /// The other process's number.
        process: String,
    },
    /// The output folder holds a run that is not finished.
    #[error(
        "{}: holds a run that was interrupted after {steps} steps of its {stage} stage; go on with --resume, or remove {CHECKPOINT_FILE} there to start over",
        folder.display()
    )]
    Unfinished {
        /// The folder.
        folder: PathBuf,
        /// The stage that it is in.
        stage: Stage,
        /// Steps of that stage.
        steps: u64,
    },
    /// What is to go on is another run.
    #[error("{}: cannot be resumed with these arguments: the run there {difference}", folder.display())]
    Resume {
        /// The folder.
        folder: PathBuf,
        /// What differs, as the end of a sentence about the run there.
        difference: String,
    },
    /// Somebody asked for the end of the run.
    #[error(
        "stopped after {steps} steps of the {stage} stage, which are kept in {}; go on with --resume",
        folder.display()
    )]
    Stopped {
        /// The model folder.
        folder: PathBuf,
        /// The stage that it is in.
        stage: Stage,
        /// Steps of that stage.
        steps: u64,
    },
    /// A folder of paintings cannot be used.
    #[error("style folder {}: {reason}", path.display())]
    Styles {
        /// The folder.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The style stage got another capture than the geometry stage.
    #[error(
        "this is not the capture that the model was made from ({what}); train both stages on it instead"
    )]
    OtherScene {
        /// The first difference.
        what: String,
    },
    /// Photos are smaller than a patch.
    #[error(
        "photo {photo} is {width}×{height} pixels as trained, the style stage needs at least {least_width}×{least_height}: use a smaller --downscale"
    )]
    SmallPhotos {
        /// Name of the photo.
        photo: String,
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// Width of a patch.
        least_width: usize,
        /// Height of a patch.
        least_height: usize,
    },
}

impl TrainError {
    /// A file could not be written.
    pub(crate) fn write(path: &Path, error: &impl ToString) -> Self {
        ModelError::write(path, error).into()
    }
}
