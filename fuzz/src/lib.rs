//! What the fuzz targets share.

pub mod scene;
#[cfg(feature = "tensors")]
pub mod tensors;
#[allow(
    dead_code,
    reason = "the sources are another crate's, which uses all of them"
)]
mod weights;

pub use scene::check_message;
pub use weights::file::WeightsFile;
pub use weights::tensors::{TensorFile, write_f16};

use std::io;
use std::path::PathBuf;

/// A folder of this process, in memory where `fuzz/run` says so, which empties it.
pub fn scratch() -> PathBuf {
    let base = std::env::var_os("IMPASTO_FUZZ_SCRATCH");
    let base = base.map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = base.join(format!("impasto-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("the scratch folder is writable");
    folder
}

/// What [`weights`] says of `crate::StyleError`: the part of impasto-style's that it uses.
#[derive(Debug, thiserror::Error)]
pub enum StyleError {
    /// A weight file does not have the expected content.
    #[error("weight file {file}: {reason}")]
    Weights {
        /// Which file.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A weight file cannot be read.
    #[error("{}: cannot be read ({source})", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

impl StyleError {
    fn weights(file: &str, reason: impl Into<String>) -> Self {
        Self::Weights {
            file: file.to_owned(),
            reason: reason.into(),
        }
    }
}
