//! What training a capture would take.

use impasto::scene::Scene;
use impasto::{Budget, TrainConfig};
use impasto_train::estimate::{
    Estimate, GIB, PAPER_STEPS, available_memory, estimate, measure_rates, shrink_to_fit,
};
use serde_json::{Value, json};

use super::scene::Warning;
use super::to_json;
use crate::cli::train::BudgetArgs;
use crate::cli::{CliError, console};

/// Estimates for both presets.
pub struct Training {
    /// Within the default budget.
    pub fast: Estimate,
    /// The paper's whole schedule.
    pub paper: Estimate,
    /// Bytes of memory that this machine has, where that is known.
    pub memory: Option<u64>,
}

/// Part of a machine's memory that one program can have.
const USABLE: f64 = 0.9;

impl Training {
    /// Estimates for a capture as loaded; `quick` leaves out what has to be measured.
    pub fn of(scene: &Scene, quick: bool) -> Result<Self, CliError> {
        if !quick {
            console::note("measuring how fast this machine trains (--quick leaves it out)");
        }
        let of = |config: &TrainConfig, budget| -> Result<Estimate, CliError> {
            let rates = match quick {
                true => None,
                false => Some(measure_rates(scene, config)?),
            };
            Ok(estimate(scene, config, budget, rates))
        };
        Ok(Self {
            fast: of(&TrainConfig::fast(), Budget::Time(BudgetArgs::DEFAULT))?,
            paper: of(&TrainConfig::paper(), Budget::Steps(PAPER_STEPS))?,
            memory: available_memory(),
        })
    }

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

/// What does not fit this machine, or training at all.
pub fn warnings(scene: &Scene, training: &Training, downscale: u32) -> Vec<Warning> {
    let mut all = Vec::new();
    let fast = TrainConfig::fast();
    let [rows, columns] = fast.style.patch;
    let small = scene.train().map(|(_, photo)| photo).find(|photo| {
        let (width, height) = photo.pixels.dimensions();
        (width as usize) < columns || (height as usize) < rows
    });
    if let Some(photo) = small {
        let (width, height) = photo.pixels.dimensions();
        all.push(Warning {
            problem: format!(
                "{} has {width}×{height} pixels, too few for the style stage, which needs {columns}×{rows}",
                photo.name
            ),
            advice: match downscale {
                1 => "use larger photos".into(),
                _ => "use a smaller --downscale".into(),
            },
        });
    }
    let Some(memory) = training.memory else {
        return all;
    };
    let usable = (memory as f64 * USABLE) as u64;
    let presets = [
        ("fast", &training.fast, fast),
        ("paper", &training.paper, TrainConfig::paper()),
    ];
    for (name, estimate, config) in presets {
        if estimate.memory_gib * GIB <= usable as f64 {
            continue;
        }
        all.push(Warning {
            problem: format!(
                "training with the {name} preset needs about {:.1} GiB of memory, and this machine has {:.1}",
                estimate.memory_gib,
                memory as f64 / GIB
            ),
            advice: match shrink_to_fit(scene, &config, usable) {
                Some(times) => format!("train with --downscale {}", times * downscale),
                None => "use a machine with more".into(),
            },
        });
    }
    all
}
