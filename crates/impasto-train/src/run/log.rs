//! `log.jsonl`: the event stream, one line each, with the seconds since the start.

use crate::TrainError;
use crate::event::Event;
use impasto_model::Stopwatch;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Writes events to the model folder and hands them on.
pub(crate) struct Log<'a> {
    file: File,
    watch: Stopwatch,
    sink: &'a mut dyn FnMut(&Event),
    failed: bool,
}

/// Cuts off the part of a line that a killed run has left at the end.
fn with_whole_lines(mut file: File) -> std::io::Result<File> {
    // Longer than any line.
    const TAIL: u64 = 1 << 16;
    let length = file.metadata()?.len();
    let start = length.saturating_sub(TAIL);
    file.seek(SeekFrom::Start(start))?;
    let mut tail = Vec::new();
    file.read_to_end(&mut tail)?;
    let whole = tail
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |i| i + 1);
    if whole < tail.len() {
        file.set_len(start + whole as u64)?;
    }
    Ok(file)
}

impl<'a> Log<'a> {
    /// Makes the model folder and starts its log, or goes on with it.
    pub(crate) fn create(
        output: &Path,
        watch: Stopwatch,
        sink: &'a mut dyn FnMut(&Event),
    ) -> Result<Self, TrainError> {
        let failed = |path: &Path, e: std::io::Error| TrainError::write(path, &e);
        let previews = output.join("previews");
        std::fs::create_dir_all(&previews).map_err(|e| failed(&previews, e))?;
        let path = output.join("log.jsonl");
        let file = File::options()
            .create(true)
            .read(true)
            .append(true)
            .open(&path)
            .and_then(with_whole_lines)
            .map_err(|e| failed(&path, e))?;
        Ok(Self {
            file,
            watch,
            sink,
            failed: false,
        })
    }

    /// Writes and passes on one event.
    pub(crate) fn event(&mut self, event: &Event) {
        (self.sink)(event);
        let Ok(mut value) = serde_json::to_value(event) else {
            return;
        };
        value["seconds_since_start"] = self.watch.elapsed().as_secs_f64().into();
        if writeln!(self.file, "{value}").is_err() && !self.failed {
            // A log that cannot be written must not end hours of training; it is said once.
            self.failed = true;
            (self.sink)(&Event::Warning {
                message: "log.jsonl can no longer be written; training goes on without it".into(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use std::time::Duration;

    #[test]
    fn a_torn_line_goes_and_what_follows_is_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.jsonl");
        for (before, kept) in [
            ("", ""),
            ("{\"a\"", ""),
            ("1\n2\n{\"ev", "1\n2\n"),
            ("1\n", "1\n"),
        ] {
            std::fs::write(&path, before).unwrap();
            let mut sink = |_: &Event| ();
            let watch = Stopwatch::after(Duration::from_secs(50));
            let mut log = Log::create(dir.path(), watch, &mut sink).unwrap();
            log.event(&Event::Done { seconds: 1.0 });
            let text = std::fs::read_to_string(&path).unwrap();
            let added = text.strip_prefix(kept).unwrap();
            let event: serde_json::Value = serde_json::from_str(added).unwrap();
            assert!(event["seconds_since_start"].as_f64().unwrap() >= 50.0);
        }
    }
}
