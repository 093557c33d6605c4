//! What trains: looks refined for each painting, places reconstructed from stylised pictures, and
//! the decoder of AdaIN. The rest of this crate measures only.

mod adain;
mod reconstruct;
mod refine;

pub use adain::{AdaInReport, AdaInTraining, train_adain};
pub use reconstruct::Reconstruct;
pub(crate) use reconstruct::{HOW, reconstructed, training_views};
pub(crate) use refine::refined;
