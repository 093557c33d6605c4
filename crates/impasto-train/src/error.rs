use std::path::PathBuf;

/// Why a run could not start or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The capture cannot be used.
    #[error(transparent)]
    Scene(#[from] impasto_scene::SceneError),
    /// Weights or pictures cannot be used.
    #[error(transparent)]
    Style(#[from] impasto_style::StyleError),
    /// A file of the model folder cannot be written.
    #[error("cannot write {}: {reason}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A model file cannot be used.
    #[error("{}: {reason}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
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
    /// A setting is out of range.
    #[error("setting {key}: {reason}")]
    Setting {
        /// Its dotted path.
        key: String,
        /// What is allowed.
        reason: String,
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
