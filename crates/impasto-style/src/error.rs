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
