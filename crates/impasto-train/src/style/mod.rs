//! Paintings → hypernetwork: the style stage (PAPER §6–8), the style-VAE (§5), and refinement of
//! single paintings.

mod chunks;
mod distillation;
mod encoder;
mod objective;
mod painter;
mod patches;
mod refine;
mod stage;

pub use distillation::{DistillationBudget, distil};
pub use encoder::{
    EncoderCheck, EncoderOptions, EncoderSummary, check_encoder, read_encoder, train_encoder,
};
pub use objective::StyleReport;
pub use painter::{PainterOptions, PainterSummary, read_painter, train_painter};
pub use refine::Refinement;
pub use stage::{StyleNetworks, StyleStage};

pub(crate) use stage::StyleProgress;
