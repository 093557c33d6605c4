//! What keeps surfaces from being exported.

use std::io;
use std::path::PathBuf;

use impasto_scene::file::plainly;

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A model without training views.
    #[error(
        "the model has no training views, so nobody knows where to look at its surfaces from; train \
         it again on its capture"
    )]
    NoViews,
    /// Views that show nothing.
    #[error(
        "none of the {views} views shows a surface; train the model longer, or export a model of \
         another scene"
    )]
    NoSurfaces {
        /// How many there are.
        views: usize,
    },
    /// Somebody asked for the end.
    #[error("the export was stopped before its file was written")]
    Stopped,
    /// The file cannot be written.
    #[error("cannot write {}: {}; choose another output", path.display(), plainly(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}
