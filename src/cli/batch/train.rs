//! Models of a batch that are trained first.

use std::fs;
use std::path::Path;

use impasto::scene::LoadOptions;
use impasto::{Device, Recovery, Stages, TrainOptions, TrainSummary, Unfinished};
use impasto_model::MODEL_FILE;

use super::file::{BatchStages, TrainTable};
use crate::cli::train::{BudgetArgs, usual_options, watched};
use crate::cli::{CliError, settings, to_json};
use crate::output::{job, put};

/// The file beside a model that comes when its training is done.
const SUMMARY: &str = "summary.json";

/// Whether a model is there as the table wants it.
///
/// # Errors
/// When the folder holds something else.
pub fn is_done(table: &TrainTable) -> Result<bool, CliError> {
    let model = &table.model;
    if !model.join(SUMMARY).exists() || !model.join(job::JOB_FILE).exists() {
        return Ok(false);
    }
    job::claim(model, &table.written, None)?;
    Ok(true)
}

/// Trains a model that is not done.
pub fn train(table: &TrainTable, device: Device) -> Result<TrainSummary, CliError> {
    let model = &table.model;
    let options = options(table, device)?;
    let others = model.join(MODEL_FILE);
    let others = others.exists().then_some(MODEL_FILE);
    fs::create_dir_all(model).map_err(CliError::write(model))?;
    job::claim(model, &table.written, others)?;
    let summary = watched(&options).inspect_err(|_| release(model))?;
    let text = format!("{:#}\n", to_json(&summary));
    put(&model.join(SUMMARY), text.as_bytes())?;
    Ok(summary)
}

/// Lets a mended table have the folder, if training did not get as far as a model.
fn release(model: &Path) {
    if !model.join(MODEL_FILE).exists() {
        // Best effort: what stopped the training is what matters.
        let _ = fs::remove_file(model.join(job::JOB_FILE));
        let _ = fs::remove_dir(model);
    }
}

fn options(table: &TrainTable, device: Device) -> Result<TrainOptions, CliError> {
    let budget = BudgetArgs {
        budget: table.budget,
        steps: table.steps,
    };
    let preset = table.preset.config();
    Ok(TrainOptions {
        styles: table.styles.clone(),
        encoder: table.encoder.clone(),
        stages: match table.stage {
            BatchStages::All => Stages::All,
            BatchStages::Geometry => Stages::Geometry,
        },
        config: settings::configure(&preset, table.config.as_deref(), &table.set)?,
        budget: budget.get_or(BudgetArgs::usual(table.preset, table.styles.is_some())),
        load: LoadOptions {
            downscale: table.downscale,
            format: table.format,
            ..LoadOptions::default()
        },
        seed: table.seed,
        recovery: Recovery {
            // A task that was killed and comes again goes on.
            unfinished: Unfinished::Resume,
            ..Recovery::default()
        },
        ..usual_options(&table.scene, &table.model, device)
    })
}
