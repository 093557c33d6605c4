//! A running stage's progress, reported now and then.

use crate::event::{Event, Stage};
use crate::smooth::{REPORT_EVERY, Smooth};
use impasto_model::Clock;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// What progress is reported from.
#[derive(Debug, Default, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Reported {
    /// Total, content and style loss.
    losses: [Smooth; 3],
    rays: u64,
}

/// A stage's progress.
pub(crate) struct Progress {
    stage: Stage,
    pub(crate) reported: Reported,
    last: Instant,
}

impl Progress {
    pub(crate) fn new(stage: Stage, reported: Reported) -> Self {
        Self {
            stage,
            reported,
            last: Instant::now(),
        }
    }

    /// The smoothed losses so far: total, content and style.
    pub(crate) fn losses(&self) -> [Option<f64>; 3] {
        self.reported.losses.map(Smooth::value)
    }

    /// Takes note of a step: total, content and style loss, as far as there are. What is to be said of it,
    /// now and then.
    pub(crate) fn step(
        &mut self,
        clock: &Clock,
        losses: [Option<f64>; 3],
        rays: usize,
    ) -> Option<Event> {
        for (smooth, loss) in self.reported.losses.iter_mut().zip(losses) {
            if let Some(loss) = loss {
                smooth.add(loss);
            }
        }
        self.reported.rays += rays as u64;
        if self.last.elapsed() < REPORT_EVERY && !clock.is_over() {
            return None;
        }
        self.last = Instant::now();
        let seconds = clock.seconds().max(1e-9);
        let [loss, content, style] = self.losses();
        Some(Event::Step {
            stage: self.stage,
            step: clock.steps,
            progress: clock.progress(),
            loss: loss.unwrap_or_default(),
            content,
            style,
            rate: clock.steps as f64 / seconds,
            rays_per_second: self.reported.rays as f64 / seconds,
            eta: clock.eta(),
        })
    }
}
