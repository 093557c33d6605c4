//! The thread that follows a training: what its log says, and the model when it is written.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use impasto_model::{MODEL_FILE, Stop};

use crate::message::{problem, typed};
use crate::painter::Painter;
use crate::rendering::Arriving;
use crate::run::LogTail;
use crate::shared::Shared;
use crate::sync::lock;

/// Time between two readings.
const EVERY: Duration = Duration::from_millis(500);
/// How often a sleeping thread checks whether the studio closes.
const POLL: Duration = Duration::from_millis(50);

/// Changes when a file does.
type Stamp = Option<(SystemTime, u64)>;

pub(crate) struct Follower<P> {
    model: PathBuf,
    again: Box<dyn Fn() -> Result<P, String> + Send>,
    arriving: Arc<Arriving<P>>,
    shared: Shared,
    log: LogTail,
    known: Stamp,
}

impl<P: Painter> Follower<P> {
    pub(crate) fn new(
        model: &Path,
        again: Box<dyn Fn() -> Result<P, String> + Send>,
        arriving: Arc<Arriving<P>>,
        shared: Shared,
    ) -> Self {
        let (folder, file) = if model.is_file() {
            (model.parent().unwrap_or(model), model.to_owned())
        } else {
            (model, model.join(MODEL_FILE))
        };
        let is_there = lock(&arriving).is_some();
        Self {
            log: LogTail::new(folder.to_owned()),
            known: if is_there { stamp(&file) } else { None },
            model: file,
            again,
            arriving,
            shared,
        }
    }

    /// Follows until the studio closes.
    pub(crate) fn run(mut self, stop: &Stop) {
        while !stop.is_requested() {
            self.read_log();
            self.load_model();
            let polls = EVERY.as_millis() / POLL.as_millis();
            for _ in 0..polls {
                if stop.is_requested() {
                    return;
                }
                std::thread::sleep(POLL);
            }
        }
    }

    /// Reads the log on.
    fn read_log(&mut self) {
        let mut run = lock(&self.shared.run);
        if self.log.follow(&mut run) {
            let message = typed("run", run.json());
            drop(run);
            self.shared.clients.send_all(&message, true);
        }
    }

    /// Loads a model that was written.
    fn load_model(&mut self) {
        let found = stamp(&self.model);
        if found.is_none() || found == self.known {
            return;
        }
        self.known = found;
        let message = match (self.again)() {
            Ok(painter) => {
                let facts = Arc::new(painter.facts());
                let message = typed("model", facts.json());
                *lock(&self.arriving) = Some(painter);
                *lock(&self.shared.facts) = Some(facts);
                self.shared.clients.call();
                message
            }
            Err(reason) => problem(&reason, None),
        };
        self.shared.clients.send_all(&message, false);
    }
}

fn stamp(file: &Path) -> Stamp {
    let facts = std::fs::metadata(file).ok()?;
    Some((facts.modified().ok()?, facts.len()))
}
