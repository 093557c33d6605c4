//! When numbers come back from a GPU.

use std::time::{Duration, Instant};

/// When to read back what a GPU has computed: seldom, since that waits for all of it, and often enough
/// that a budget in seconds holds, since the host runs ahead.
#[derive(Debug)]
pub(crate) struct ReadbackSchedule {
    steps: u64,
    last: Instant,
}

impl ReadbackSchedule {
    /// Most steps, and the longest time, between two reads.
    const EVERY: (u64, Duration) = (16, Duration::from_millis(250));

    pub(crate) fn new() -> Self {
        Self {
            steps: 0,
            last: Instant::now(),
        }
    }

    /// Counts a step; whether it is one to read back after: the first one is.
    pub(crate) fn due(&mut self) -> bool {
        let due = self.steps.is_multiple_of(Self::EVERY.0) || self.last.elapsed() > Self::EVERY.1;
        self.steps = if due { 1 } else { self.steps + 1 };
        due
    }

    /// What was due has been read.
    pub(crate) fn done(&mut self) {
        self.last = Instant::now();
    }
}
