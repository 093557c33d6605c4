//! What training a capture would take.

use impasto::scene::Scene;
use impasto::{Budget, TrainConfig};
use impasto_train::estimate::{
    Estimate, GIB, PAPER_STEPS, available_memory, estimate, measure_rates,
};
use serde_json::{Value, json};

use crate::cli::train::BudgetArgs;
use crate::cli::{CliError, console, to_json};

/// Estimates for both presets.
pub struct TrainingEstimates {
    /// Within the default budget.
    pub fast: Estimate,
    /// The paper's whole schedule.
    pub paper: Estimate,
    /// Bytes of memory that this machine has, where that is known.
    pub memory: Option<u64>,
}

impl TrainingEstimates {
    /// Estimates for a capture as loaded; `quick` leaves out what has to be measured.
    pub fn of(scene: &Scene, quick: bool) -> Result<Self, CliError> {
        if !quick {
            console::note("measuring how fast this machine trains (--quick leaves it out)");
        }
        let of = |config: &TrainConfig, budget| -> Result<Estimate, CliError> {
            let rates = (!quick).then(|| measure_rates(scene, config)).transpose()?;
            Ok(estimate(scene, config, budget, rates))
        };
        Ok(Self {
            fast: of(&TrainConfig::fast(), Budget::Time(BudgetArgs::GEOMETRY))?,
            paper: of(&TrainConfig::paper(), Budget::Steps(PAPER_STEPS))?,
            memory: available_memory(),
        })
    }

    /// As `--json` prints them.
    pub fn json(&self) -> Value {
        json!({
            "device": "CPU",
            "threads": threads(),
            "memory_available_gib": self.memory.map(|bytes| bytes as f64 / GIB),
            "fast": to_json(&self.fast),
            "paper": to_json(&self.paper),
        })
    }
}

/// Threads that train.
pub fn threads() -> usize {
    impasto_bench::Machine::this().threads
}
