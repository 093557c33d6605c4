//! How long to train, and how far along that is.

use std::time::{Duration, Instant};

/// A limit on time or on steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Wall time.
    Time(Duration),
    /// Optimiser steps.
    Steps(u64),
}

impl Budget {
    /// The given share of this budget.
    pub fn share(self, share: f64) -> Self {
        match self {
            Self::Time(time) => Self::Time(time.mul_f64(share)),
            Self::Steps(steps) => Self::Steps(((steps as f64 * share).round() as u64).max(1)),
        }
    }
}

/// When to look at what a GPU has computed: seldom, since that waits for all of it, and often enough
/// that a budget in seconds holds, since the host runs ahead.
#[derive(Debug)]
pub(crate) struct Looks {
    steps: u64,
    last: Instant,
}

impl Looks {
    /// Most steps, and the longest time, between two looks.
    const EVERY: (u64, Duration) = (16, Duration::from_millis(250));

    pub(crate) fn new() -> Self {
        Self {
            steps: 0,
            last: Instant::now(),
        }
    }

    /// Counts a step; whether it is one to look at: the first one is.
    pub(crate) fn due(&mut self) -> bool {
        let due = self.steps.is_multiple_of(Self::EVERY.0) || self.last.elapsed() > Self::EVERY.1;
        self.steps = if due { 1 } else { self.steps + 1 };
        due
    }

    /// A look is over.
    pub(crate) fn done(&mut self) {
        self.last = Instant::now();
    }
}

/// A running budget.
#[derive(Debug, Clone)]
pub struct Clock {
    budget: Budget,
    start: Instant,
    /// Steps finished.
    pub steps: u64,
}

impl Clock {
    /// Starts now.
    pub fn start(budget: Budget) -> Self {
        Self {
            budget,
            start: Instant::now(),
            steps: 0,
        }
    }

    /// Part of the budget that is used, in `[0, 1]`.
    pub fn progress(&self) -> f64 {
        let used = match self.budget {
            Budget::Time(time) => self.start.elapsed().as_secs_f64() / time.as_secs_f64().max(1e-9),
            Budget::Steps(steps) => self.steps as f64 / steps.max(1) as f64,
        };
        used.min(1.0)
    }

    /// Whether the budget is used up.
    pub fn is_over(&self) -> bool {
        self.progress() >= 1.0
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Estimated seconds until the budget is used up.
    pub fn eta(&self) -> f64 {
        let progress = self.progress();
        match self.budget {
            Budget::Time(time) => (time.as_secs_f64() - self.seconds()).max(0.0),
            Budget::Steps(_) if progress > 0.0 => self.seconds() * (1.0 - progress) / progress,
            Budget::Steps(_) => f64::INFINITY,
        }
    }
}
