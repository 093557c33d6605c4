//! How long to train, and how far along that is.

use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// A limit on time or on steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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

/// Time that something takes, in several parts.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    earlier: Duration,
    since: Instant,
}

impl Stopwatch {
    /// Goes on now, after parts that took this long.
    pub fn after(earlier: Duration) -> Self {
        Self {
            earlier,
            since: Instant::now(),
        }
    }

    /// Time so far, all parts together.
    pub fn elapsed(&self) -> Duration {
        self.earlier + self.since.elapsed()
    }
}

/// A running budget.
#[derive(Debug, Clone)]
pub struct Clock {
    budget: Budget,
    watch: Stopwatch,
    /// Steps finished.
    pub steps: u64,
}

impl Clock {
    /// Starts now.
    pub fn start(budget: Budget) -> Self {
        Self::resumed(budget, Duration::ZERO, 0)
    }

    /// Goes on now, after steps that took this long.
    pub fn resumed(budget: Budget, earlier: Duration, steps: u64) -> Self {
        Self {
            budget,
            watch: Stopwatch::after(earlier),
            steps,
        }
    }

    /// Time since the start, without interruptions.
    pub fn elapsed(&self) -> Duration {
        self.watch.elapsed()
    }

    /// Part of the budget that is used, in `[0, 1]`.
    pub fn progress(&self) -> f64 {
        let used = match self.budget {
            Budget::Time(time) => self.seconds() / time.as_secs_f64().max(1e-9),
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
        self.elapsed().as_secs_f64()
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
