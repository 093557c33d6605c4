//! `--ffmpeg`, for the commands that read or write films.

use std::path::PathBuf;

use clap::Args;

/// Which ffmpeg is used.
#[derive(Debug, Clone, Args)]
pub struct FfmpegArgs {
    /// ffmpeg's program, for videos
    #[arg(
        id = "ffmpeg",
        long = "ffmpeg",
        value_name = "PROGRAM",
        env = "IMPASTO_FFMPEG",
        default_value = "ffmpeg"
    )]
    pub program: PathBuf,
}
