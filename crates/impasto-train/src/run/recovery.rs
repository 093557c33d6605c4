//! What a run does for the case that it is interrupted, and about one that was.

use impasto_model::Stop;
use std::time::Duration;

/// What becomes of an unfinished run whose checkpoint the output folder holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Unfinished {
    /// Nothing: a new run in its place is an error.
    #[default]
    Keep,
    /// It goes on. Where there is none a run begins, and a finished one of the same kind is not
    /// repeated.
    Resume,
    /// It is lost.
    Discard,
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
