//! Evaluation: how faithful a model's styles are to their paintings, and how well the frames of a
//! walk agree.

pub mod consistency;
mod fidelity;
pub mod flow;

pub use fidelity::{EvalError, PaintingResult, StyleFidelity, style_fidelity};
