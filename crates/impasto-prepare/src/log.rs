//! The log: every command line and its whole output.

use std::ffi::OsString;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use impasto_scene::SceneError;

use crate::error::PrepareError;

/// A log in the making.
pub(crate) struct CommandLog {
    file: File,
    path: PathBuf,
    /// Where the log will be when the work is over, or has failed.
    destination: PathBuf,
}

impl CommandLog {
    /// Begins the file `path`, which will be found at `destination`.
    pub(crate) fn new(path: PathBuf, destination: PathBuf) -> Result<Self, PrepareError> {
        Ok(Self {
            file: File::create(&path).map_err(PrepareError::write(&path))?,
            path,
            destination,
        })
    }

    /// Where a reader of messages will find the log.
    pub(crate) fn destination(&self) -> PathBuf {
        self.destination.clone()
    }

    /// A model that cannot be used.
    pub(crate) fn unusable(&self, source: SceneError) -> PrepareError {
        let log = self.destination();
        PrepareError::Scene { source, log }
    }

    /// Notes a command line, as a shell would take it.
    pub(crate) fn command(
        &mut self,
        program: &Path,
        arguments: &[OsString],
    ) -> Result<(), PrepareError> {
        let program = [program.as_os_str()].into_iter();
        let words = program.chain(arguments.iter().map(OsString::as_os_str));
        let words: Vec<String> = words.map(|word| quoted(&word.to_string_lossy())).collect();
        self.output(format!("\n$ {}\n", words.join(" ")).as_bytes())
    }

    /// Adds output as it is.
    pub(crate) fn output(&mut self, bytes: &[u8]) -> Result<(), PrepareError> {
        self.file
            .write_all(bytes)
            .map_err(PrepareError::write(&self.path))
    }
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_lines_can_be_pasted_into_a_shell() {
        assert_eq!(quoted("--a.b=1"), "--a.b=1");
        assert_eq!(quoted("my photos/it's"), r"'my photos/it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
