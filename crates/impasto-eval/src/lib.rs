//! Evaluation: how faithful a model's styles are to their paintings, how well the frames of a walk
//! agree, and what people say of both.

mod bench;
pub mod consistency;
pub mod estimate;
mod evaluate;
mod fidelity;
pub mod flow;
mod gallery;
mod guards;
pub mod methods;
mod page;
mod path;
mod plane;
#[cfg(test)]
mod proof;
mod reconstruct;
pub mod report;
mod sharpness;
pub mod study;
mod truth;
mod walk;

pub use evaluate::{
    EvalError, EvalOptions, Evaluation, Legacy, MethodResult, PHOTO, TrueDepth, evaluate,
};
pub use fidelity::{PaintingResult, StyleFidelity};
pub use gallery::{Exhibit, Gallery, GalleryPlan, WorstPair};
pub use guards::{Guard, LEAST_SHARPNESS, LEAST_STYLE_GAIN};
pub use path::small_orbit;
pub use reconstruct::Reconstruct;
pub use sharpness::gradient_energy;
