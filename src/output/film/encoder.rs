//! The installed ffmpeg and what it can write.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::FilmFormat;
use crate::cli::CliError;

/// One of ffmpeg's encoders, with the options that make it good at painted films: much detail that
/// moves, and no hurry.
#[derive(Debug, Clone, Copy)]
pub struct Encoder {
    name: &'static str,
    options: &'static [&'static str],
    container: &'static [&'static str],
}

impl Encoder {
    /// ffmpeg's words for it.
    pub fn words(&self) -> impl Iterator<Item = &'static str> {
        let name = ["-c:v", self.name];
        name.into_iter()
            .chain(self.options.iter().copied())
            .chain(self.container.iter().copied())
    }
}

/// What is at the beginning of an MP4 can be played before the rest has arrived.
const MP4: &[&str] = &["-movflags", "+faststart", "-f", "mp4"];
const WEBM: &[&str] = &["-f", "webm"];

/// Encoders of each format, the first choice first.
const ENCODERS: [(FilmFormat, Encoder); 4] = [
    (
        FilmFormat::Mp4,
        Encoder {
            name: "libx264",
            options: &["-preset", "medium", "-crf", "18"],
            container: MP4,
        },
    ),
    (
        FilmFormat::WebM,
        Encoder {
            name: "libvpx-vp9",
            options: &["-crf", "24", "-b:v", "0", "-row-mt", "1", "-cpu-used", "3"],
            container: WEBM,
        },
    ),
    (
        FilmFormat::WebM,
        Encoder {
            name: "libsvtav1",
            options: &["-crf", "26", "-preset", "7"],
            container: WEBM,
        },
    ),
    (
        FilmFormat::WebM,
        Encoder {
            name: "libaom-av1",
            options: &["-crf", "24", "-b:v", "0", "-row-mt", "1", "-cpu-used", "6"],
            container: WEBM,
        },
    ),
];

/// An ffmpeg that may be there.
#[derive(Debug, Clone)]
pub struct Ffmpeg {
    program: PathBuf,
}

impl Ffmpeg {
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
        let known = ENCODERS.iter().filter(|(of, _)| *of == format);
        let mut known = known.map(|(_, encoder)| *encoder).peekable();
        if known.peek().is_none() {
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
        match known.clone().find(|encoder| names.contains(&encoder.name)) {
            Some(encoder) => Ok(Some(encoder)),
            None => {
                let wanted: Vec<&str> = known.map(|encoder| encoder.name).collect();
                Err(CliError::Refused(format!(
                    "{}: the installed ffmpeg cannot write .{} (it has no {}); install one that can, \
                     or use .gif",
                    path.display(),
                    format.ending(),
                    wanted.join(" or ")
                )))
            }
        }
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
