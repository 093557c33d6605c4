//! What a run does for the case that it is interrupted, and about one that was.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// What becomes of an unfinished run whose checkpoint the output folder holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Unfinished {
    /// Nothing: a new run in its place is an error.
    #[default]
    ColorPreservation,
    /// It goes on. Where there is none a run begins, and a finished one of the same kind is not
    /// repeated.
    Resume,
    /// It is lost.
    Discard,
}

/// A request to end a run after the step that it is at, to be made from any thread.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Asks for the end.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether somebody asked.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// How a run can be interrupted and go on.
#[derive(Debug, Clone)]
pub struct Recovery {
    /// About an unfinished run in the output folder.
    pub unfinished: Unfinished,
    /// Time between two checkpoints; zero for one after each step.
    pub every: Duration,
    /// Ends the run with [`crate::TrainError::Stopped`] after a checkpoint.
    pub stop: Stop,
}

impl Recovery {
    /// Time between two checkpoints where nothing else is asked for.
    pub const EVERY: Duration = Duration::from_secs(120);
}

impl Default for Recovery {
    fn default() -> Self {
        Self {
            unfinished: Unfinished::default(),
            every: Self::EVERY,
            stop: Stop::default(),
        }
    }
}
