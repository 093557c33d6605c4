//! The installed ffmpeg and what it can write.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::format::FilmFormat::{self, Gif, Mp4, WebM};
use crate::cli::CliError;

/// One of ffmpeg's encoders: the format that it writes, its name, and the options that make it good
/// at painted films: much detail that moves, and no hurry.
#[derive(Debug, Clone, Copy)]
pub struct Encoder(FilmFormat, &'static str, &'static str);

impl Encoder {
    /// ffmpeg's words for it.
    pub fn words(&self) -> impl Iterator<Item = &'static str> {
        let Self(format, name, options) = *self;
        let container = match format {
            WebM => "-f webm",
            // What is at the beginning of an MP4 can be played before the rest has arrived.
            Gif | Mp4 => "-movflags +faststart -f mp4",
        };
        ["-c:v", name]
            .into_iter()
            .chain(options.split(' '))
            .chain(container.split(' '))
    }
}

/// Encoders of each format, the first choice first.
const ENCODERS: [Encoder; 4] = [
    Encoder(Mp4, "libx264", "-preset medium -crf 18"),
    Encoder(WebM, "libvpx-vp9", "-crf 24 -b:v 0 -row-mt 1 -cpu-used 3"),
    Encoder(WebM, "libsvtav1", "-crf 26 -preset 7"),
    Encoder(WebM, "libaom-av1", "-crf 24 -b:v 0 -row-mt 1 -cpu-used 6"),
];

/// An ffmpeg that may be there.
#[derive(Debug, Clone)]
pub struct FfmpegProgram {
    program: PathBuf,
}

impl FfmpegProgram {
    /// A program, or a name to look for.
    pub fn new(program: &Path) -> Self {
        Self {
            program: program.to_owned(),
        }
    }

    /// A call of it.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command.args(["-hide_banner", "-loglevel", "error"]);
        command
    }

    /// The first encoder for a format that it has; none if the format needs none. `path` is what is
    /// to be made, for messages.
    ///
    /// # Errors
    /// When there is no ffmpeg, or none that can write this.
    pub fn encoder(&self, format: FilmFormat, path: &Path) -> Result<Option<Encoder>, CliError> {
        let known = ENCODERS.into_iter().filter(|encoder| encoder.0 == format);
        if known.clone().next().is_none() {
            return Ok(None);
        }
        let listed = self
            .command()
            .arg("-encoders")
            .stdin(Stdio::null())
            .output();
        let listed = listed.map_err(|source| self.missing(path, source))?;
        let text = String::from_utf8_lossy(&listed.stdout);
        // "V....D libx264   a description"
        let names: Vec<&str> = text
            .lines()
            .filter_map(|line| line.split_whitespace().nth(1))
            .collect();
        if let Some(encoder) = known.clone().find(|encoder| names.contains(&encoder.1)) {
            return Ok(Some(encoder));
        }
        let wanted: Vec<&str> = known.map(|encoder| encoder.1).collect();
        Err(CliError::Refused(format!(
            "{}: the installed ffmpeg cannot write .{} (it has no {}); install one that can, or use \
             .gif",
            path.display(),
            format.ending(),
            wanted.join(" or ")
        )))
    }

    /// The program cannot be started.
    pub fn missing(&self, path: &Path, source: std::io::Error) -> CliError {
        CliError::NoFfmpeg {
            path: path.to_owned(),
            program: self.program.clone(),
            source,
        }
    }
}
