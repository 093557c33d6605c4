//! `log.jsonl`: the event stream, one line each, with the seconds since the start.

use crate::TrainError;
use crate::event::Event;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Writes events to the model folder and hands them on.
pub(crate) struct Log<'a> {
    file: File,
    start: Instant,
    sink: &'a mut dyn FnMut(&Event),
    failed: bool,
}

impl<'a> Log<'a> {
    /// Makes the model folder and starts its log.
    pub(crate) fn create(
        output: &Path,
        sink: &'a mut dyn FnMut(&Event),
    ) -> Result<Self, TrainError> {
        let failed = |path: &Path, e: std::io::Error| TrainError::Write {
            path: path.to_owned(),
            reason: e.to_string(),
        };
        let previews = output.join("previews");
        std::fs::create_dir_all(&previews).map_err(|e| failed(&previews, e))?;
        let path = output.join("log.jsonl");
        let file = File::options()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(|e| failed(&path, e))?;
        Ok(Self {
            file,
            start: Instant::now(),
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
        value["seconds_since_start"] = self.start.elapsed().as_secs_f64().into();
        if writeln!(self.file, "{value}").is_err() && !self.failed {
            // A log that cannot be written must not end hours of training; it is said once.
            self.failed = true;
            (self.sink)(&Event::Warning {
                message: "log.jsonl can no longer be written; training goes on without it".into(),
            });
        }
    }
}
