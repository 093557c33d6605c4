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
