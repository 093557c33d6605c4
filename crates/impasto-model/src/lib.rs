//! A trained model: its file and configuration, the appearances that paintings give it, layers of
//! paint, and the rays of cameras. Knows nothing of training.
//!
//! [`Model`] is what renders; [`ModelFile`] is what is stored; [`TrainConfig`] is everything that a run
//! can be told.

mod appearance;
mod budget;
mod camera_rays;
mod color;
pub mod config;
mod embedding;
mod error;
mod exemplar;
mod file;
mod hypernetworks;
mod info;
mod layers;
mod look;
mod model;
mod painter;
mod record;
mod rendered;
mod stop;
pub mod tensors;
mod view;

pub use appearance::StyledAppearance;
pub use budget::{Budget, Clock, Stopwatch};
pub use burn::tensor::Device;
pub use camera_rays::CameraRays;
pub use color::{ColorStatistics, ColorTransfer};
pub use config::{STYLE_SIDE, TrainConfig};
pub use embedding::{StyleEmbedding, painting_statistics, square_statistics, structure_statistics};
pub use error::ModelError;
pub use exemplar::{exemplar, mixed_exemplars};
pub use file::{CHECKPOINT_FILE, Grain, MODEL_FILE, ModelFile, ModelPhoto, ModelScene, Quality};
pub use hypernetworks::{CodeNormalisation, PaintingInputs, StyleModel, hypernetworks};
pub use impasto_field::StrokeSettings;
pub use impasto_field::encoding::LOST;
pub use impasto_kernels::device::{DeviceChoice, NoDevice, Opened, is_cpu};
pub use layers::{
    ColorPreservation, LayerError, LayerSettings, MaskShape, MaskSpec, PaintingSpec, STROKE_SIZES,
    StyleLayer, StyleLayerSpec, StyleLayers,
};
pub use look::SavedAppearance;
pub use model::Model;
pub use record::{PhotoMark, RunIdentity, Stages, TrainingRecord};
pub use rendered::RenderedView;
pub use stop::Stop;
pub use view::ViewGBuffer;
