//! Smoothed numbers of something that runs.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Time between two events that tell how far something is.
pub(crate) const REPORT_EVERY: Duration = Duration::from_millis(500);
/// Weight of a step in smoothed numbers, once there are as many as its inverse.
const NEWEST: f64 = 0.02;

/// A running mean of the last numbers; of all while they are few.
#[derive(Debug, Default, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Smooth {
    /// Its bits: JSON has no words for what is no number.
    mean: u64,
    count: u32,
}

impl Smooth {
    pub(crate) fn add(&mut self, number: f64) {
        self.count += 1;
        let share = (1.0 / f64::from(self.count)).max(NEWEST);
        let mean = f64::from_bits(self.mean);
        self.mean = (mean + share * (number - mean)).to_bits();
    }

    pub(crate) fn value(self) -> Option<f64> {
        (self.count > 0).then_some(f64::from_bits(self.mean))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_numbers_are_averaged_and_many_forgotten() {
        let mut smooth = Smooth::default();
        assert_eq!(smooth.value(), None);
        for number in [1.0, 2.0, 6.0] {
            smooth.add(number);
        }
        assert!(
            smooth
                .value()
                .is_some_and(|mean| (mean - 3.0).abs() < 1e-12)
        );
        (0..1000).for_each(|_| smooth.add(5.0));
        assert!(smooth.value().is_some_and(|mean| (mean - 5.0).abs() < 1e-6));
    }
}
