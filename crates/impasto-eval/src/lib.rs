//! Evaluation: how faithful a model's styles are to their paintings, how well the frames of a
//! trajectory agree, and what people say of both.

pub mod consistency;
mod error;
pub mod estimate;
mod evaluate;
mod evaluator;
mod fidelity;
pub mod flow;
mod grid;
mod guards;
mod html;
pub mod methods;
mod names;
mod record;
mod render;
pub mod report;
mod resize;
mod results;
mod sharpness;
pub mod strokes;
pub mod study;
#[cfg(test)]
mod tests;
pub mod training;
mod trajectory;
mod true_depth;

pub use error::EvalError;
pub use evaluate::{EvalOptions, evaluate};
pub use fidelity::{PaintingResult, StyleFidelity};
pub use guards::{FailedGuard, LEAST_SHARPNESS, LEAST_STYLE_GAIN};
pub use names::PHOTO;
pub use record::{ImageRecord, RecordPlan, SampleImages, WorstPair};
pub use render::small_orbit;
pub use results::{Evaluation, MethodResult, TrueDepth};
pub use sharpness::gradient_energy;
pub use training::Reconstruct;
