//! The two training stages, schedules, budgets, model files and the event stream.
//!
//! [`train`] is a whole run; [`GeometryStage`] and [`StyleStage`] are its halves, usable alone.
//! [`Model`] is what comes out.

pub mod budget;
mod checkpoint;
mod coats;
pub mod config;
mod durable;
mod encoder;
mod error;
pub mod estimate;
pub mod event;
mod geometry_stage;
mod hash;
mod identity;
mod info;
mod log;
mod measuring;
mod model;
mod model_file;
mod objective;
mod painted;
mod palette;
mod patches;
mod progress;
mod rays;
mod recovery;
mod refine;
mod refit;
mod run;
mod style_cache;
mod style_folder;
mod style_stage;
mod styles;
mod train;
mod validation;

pub use budget::{Budget, Clock};
pub use burn::tensor::Device;
pub use checkpoint::CHECKPOINT_FILE;
pub use coats::{
    StyleLayer, LayerError, StyleLayerSpec, StyleLayers, ColorPreservation, MaskSpec, PaintingSpec, ViewGBuffer, Shape,
};
pub use config::TrainConfig;
pub use encoder::{
    EncoderCheck, EncoderOptions, EncoderSummary, check_encoder, read_encoder, train_encoder,
};
pub use error::TrainError;
pub use event::{Event, Stage};
pub use geometry_stage::{GeometryStage, StepReport};
pub use identity::Identity;
pub use impasto_field::render::LOST;
pub use impasto_kernels::device::{DeviceChoice, NoDevice, Opened, is_cpu};
pub use model::{StyleEmbedding, Look, Model, RenderedView};
pub use model_file::{Finished, MODEL_FILE, ModelFile, ModelPhoto, ModelScene, Quality};
pub use objective::StyleReport;
pub use palette::{ColorStatistics, ColorTransfer};
pub use patches::Frozen;
pub use rays::{CameraRays, PhotoRays, photo_rays};
pub use recovery::{Recovery, Stop, Unfinished};
pub use refine::Refinement;
pub use style_cache::cache_folder;
pub use style_folder::{StyleFile, StyleFolder};
pub use style_stage::{StyleModel, StyleStage};
pub use styles::{
    FIRST_GENERATED, MOST_STYLES, Paintings, STYLE_SIDE, Style, StyleSet, StyleSources,
    read_paintings, whole,
};
pub use train::{Stages, TrainOptions, TrainSummary, train};
