//! What training a capture will take on this machine, before it is tried.

mod memory;
mod rates;

use crate::run::stages::{distillation_time, end_of_geometry_alone, end_of_stages};
use impasto_model::{Budget, TrainConfig};
use impasto_scene::Scene;
use serde::Serialize;
use std::time::Duration;

pub use memory::{available_memory, bytes_needed, shrink_to_fit};
pub use rates::{Rates, measure_rates};

/// Steps of the paper's schedule: 250,000 of the geometry stage and 100,000 of the style stage.
pub const PAPER_STEPS: u64 = 350_000;

/// What a run will take.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// From start to end, seconds. `None` for a number of steps whose rate was not measured.
    pub seconds: Option<f64>,
    /// Steps of the geometry stage, of the style stage.
    pub steps: Option<[u64; 2]>,
    /// Steps a second of either stage, as measured.
    pub steps_per_second: Option<[f64; 2]>,
    /// Most memory that the process will hold, GiB.
    pub memory_gib: f64,
}

/// Bytes of a GiB.
pub const GIB: f64 = (1u64 << 30) as f64;

/// Estimates a run without paintings of its own on photos as loaded: of both stages, or of the geometry
/// stage alone where the shipped painter is made for the configuration.
pub fn estimate(
    scene: &Scene,
    config: &TrainConfig,
    budget: Budget,
    rates: Option<Rates>,
) -> Estimate {
    let alone = config.fits_shipped_painter();
    let share = if alone { 1.0 } else { config.geometry_share };
    let steps = match (budget, rates) {
        (Budget::Steps(_), _) => {
            let of = |share| match budget.share(share) {
                Budget::Steps(steps) => steps,
                Budget::Time(_) => 0,
            };
            Some([of(share), of(1.0 - share)])
        }
        (Budget::Time(total), Some(rates)) => {
            let [geometry, end] = end_of_stages(total, share);
            let done = |time: Duration, rate: f64| (time.as_secs_f64() * rate) as u64;
            let (geometry, end) = match alone {
                true => (end_of_geometry_alone(total), Duration::ZERO),
                false => (geometry, end),
            };
            let stepping = geometry.saturating_sub(distillation_time(config, total));
            Some([
                done(stepping, rates.geometry),
                done(end.saturating_sub(geometry), rates.style),
            ])
        }
        (Budget::Time(_), None) => None,
    };
    let seconds = match (budget, rates, steps) {
        (Budget::Time(total), ..) => Some(total.as_secs_f64()),
        (_, Some(rates), Some([geometry, style])) => {
            Some(geometry as f64 / rates.geometry + style as f64 / rates.style)
        }
        _ => None,
    };
    Estimate {
        seconds,
        steps,
        steps_per_second: rates.map(|rates| [rates.geometry, rates.style]),
        memory_gib: bytes_needed(scene, config) as f64 / GIB,
    }
}
