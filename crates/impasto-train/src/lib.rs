//! What trains: the paper's two stages, pre-training and refinement, budgets, checkpoints and the event
//! stream.
//!
//! [`train`] is a whole run; [`GeometryStage`] and [`StyleStage`] are its halves, usable alone. What
//! comes out is a model of `impasto-model`.

mod error;
pub mod estimate;
pub mod event;
mod geometry;
mod hash;
mod optimizer;
mod paintings;
mod progress;
mod readback;
mod run;
mod smooth;
mod style;

pub use error::TrainError;
pub use event::{Event, Stage};
pub use geometry::{GeometryStage, PhotoRays, StepReport, TrainedGeometry, photo_rays, refit};
pub use paintings::{
    CROPS, FIRST_GENERATED, MOST_STYLES, Paintings, Style, StyleSet, StyleSources, cache_folder,
    painting_folder, read_paintings,
};
pub use run::{Recovery, TrainOptions, TrainSummary, Unfinished, train};
pub use style::{
    DistillationBudget, EncoderCheck, EncoderOptions, EncoderSummary, PainterOptions,
    PainterSummary, Refinement, StyleNetworks, StyleReport, StyleStage, check_encoder, distil,
    read_encoder, read_painter, train_encoder, train_painter,
};
