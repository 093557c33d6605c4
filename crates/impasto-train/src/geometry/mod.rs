//! Photos → field: the geometry stage (PAPER §4).

pub(crate) mod calibration;
mod photos;
mod refit;
mod stage;
mod surfaces;

pub use photos::{PhotoRays, photo_rays};
pub use refit::refit;
pub use stage::{GeometryStage, StepReport, TrainedGeometry};

pub(crate) use stage::GeometryProgress;

#[cfg(test)]
pub(crate) use photos::tests;
