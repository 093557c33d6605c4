//! A run: its stages one after the other, budget, log, checkpoints, resumption.

mod checkpoint;
mod identity;
mod lock;
mod log;
mod options;
mod recovery;
pub(crate) mod stages;
mod train;
mod validation;

pub use options::{TrainOptions, TrainSummary};
pub use recovery::{Recovery, Unfinished};
pub use train::train;
