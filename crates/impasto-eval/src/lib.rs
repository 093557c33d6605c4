//! Evaluation: how faithful a model's styles are to their paintings, and how well the frames of a
//! walk agree.

pub mod consistency;
pub mod estimate;
mod evaluate;
mod fidelity;
pub mod flow;
pub mod methods;
mod plane;
mod sharpness;
mod walk;

pub use evaluate::{EvalError, EvalOptions, Evaluation, Legacy, MethodResult, evaluate};
pub use fidelity::{PaintingResult, StyleFidelity};
pub use sharpness::gradient_energy;
