use impasto_kernels::settings::OutOfRange;
use std::path::{Path, PathBuf};

/// Why a model cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
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
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] OutOfRange),
}

impl ModelError {
    /// A file could not be written.
    pub fn write(path: &Path, error: &impl ToString) -> Self {
        Self::Write {
            path: path.to_owned(),
            reason: error.to_string(),
        }
    }
}
