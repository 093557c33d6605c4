//! The thread that follows a training: what its log says, and the model when it is written.

use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, SystemTime};

use impasto_train::{MODEL_FILE, Stop};

use crate::http::Shared;
use crate::message::{problem, told};
use crate::painter::Painter;
use crate::rendering::Arriving;
use crate::run::LogTail;

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(500);
/// How often a sleeping thread looks whether the studio closes.
const LOOK: Duration = Duration::from_millis(50);

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
        let (folder, file) = match model.is_file() {
            true => (model.parent().unwrap_or(model), model.to_owned()),
            false => (model, model.join(MODEL_FILE)),
        };
        let is_there = (arriving.lock())
            .unwrap_or_else(PoisonError::into_inner)
            .is_some();
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
            self.hear();
            self.look();
            let looks = EVERY.as_millis() / LOOK.as_millis();
            for _ in 0..looks {
                if stop.is_requested() {
                    return;
                }
                std::thread::sleep(LOOK);
            }
        }
    }

    /// Reads the log on.
    fn hear(&mut self) {
        let mut run = self
            .shared
            .run
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let before = run.1;
        let (heard, training) = self.log.follow(&mut run.0);
        run.1 = training;
        if heard || before != training {
            let said = told("run", run.0.json(training));
            drop(run);
            self.shared.clients.send_all(&said, true);
        }
    }

    /// Loads a model that was written.
    fn look(&mut self) {
        let found = stamp(&self.model);
        if found.is_none() || found == self.known {
            return;
        }
        self.known = found;
        match (self.again)() {
            Ok(painter) => {
                let facts = Arc::new(painter.facts());
                let said = told("model", facts.json());
                let mut place = self.arriving.lock().unwrap_or_else(PoisonError::into_inner);
                *place = Some(painter);
                drop(place);
                let mut known = self
                    .shared
                    .facts
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner);
                *known = Some(facts);
                drop(known);
                self.shared.clients.call();
                self.shared.clients.send_all(&said, false);
            }
            Err(reason) => {
                let said = problem(&reason, None);
                self.shared.clients.send_all(&said, false);
            }
        }
    }
}

fn stamp(file: &Path) -> Stamp {
    let facts = std::fs::metadata(file).ok()?;
    Some((facts.modified().ok()?, facts.len()))
}
