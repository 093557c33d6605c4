//! Why style data could not be used.

use crate::Network;
use std::io;
use std::path::PathBuf;

/// Why style data could not be used.
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
    #[error("{}: cannot be read ({source}); check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// There is no VGG-19 on this machine.
    #[error(
        "VGG-19 is not installed (there is no {}); run `impasto weights --fetch vgg19`, or `impasto \
         weights --add FILE` with a file that you have",
        path.display()
    )]
    NotInstalled {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// An encoder was made for another perceptual network.
    #[error(
        "the encoder reads {found}, but style.perceptual is {wanted}: make one with `impasto \
         train-encoder --perceptual {wanted}` and give it with --encoder"
    )]
    OtherNetwork {
        /// What it was made for.
        found: Network,
        /// What it is to be used with.
        wanted: Network,
    },
    /// Nowhere to keep weights.
    #[error("no folder for weights is known; set IMPASTO_WEIGHTS to one")]
    NoFolder,
    /// An image is too small to have style.
    #[error(
        "an image of {width}×{height} pixels is too small, at least {least} pixels a side are needed"
    )]
    TooSmall {
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// What is needed.
        least: usize,
    },
}

impl StyleError {
    /// A weight file, or what stands for one, with unexpected content.
    pub(crate) fn weights(file: &str, reason: impl Into<String>) -> Self {
        Self::Weights {
            file: file.to_owned(),
            reason: reason.into(),
        }
    }
}
