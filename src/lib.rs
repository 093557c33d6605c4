//! Posed photos of a real place in; a 3-D scene out that can be rendered from new viewpoints in
//! the style of any painting.
//!
//! This is the front door of the workspace: the names that a program needs, each owned and
//! documented by the crate that it comes from. The `impasto` command is built from the same names.
//!
//! ```no_run
//! use impasto::{Budget, Model, Stages, TrainConfig, TrainOptions, scene, train};
//! use std::time::Duration;
//!
//! let options = TrainOptions {
//!     scene: "capture".into(),
//!     output: "model".into(),
//!     styles: Some("paintings".into()),
//!     encoder: None,
//!     cache: impasto::cache_folder(),
//!     stages: Stages::All,
//!     config: TrainConfig::fast(),
//!     budget: Budget::Time(Duration::from_secs(600)),
//!     load: scene::LoadOptions::default(),
//!     seed: 0,
//!     device: impasto::DeviceChoice::Auto.open()?.device,
//!     recovery: impasto::Recovery::default(),
//! };
//! let summary = train(&options, &mut |_event| ())?;
//!
//! let model = Model::load(&summary.model)?;
//! let painting = scene::read_rgb("painting.jpg".as_ref())?;
//! let appearance = model.appearance(&model.embedding(&painting)?).ok_or("no style stage yet")?;
//! let view = model.render(&model.file.scene.photos[0].camera, &[&appearance]);
//! view.image(0).save("view.png")?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]

pub use impasto_eval as eval;
pub use impasto_export as export;
pub use impasto_model::{
    Budget, ColorPreservation, Device, DeviceChoice, LOST, LayerError, LayerSettings, MaskShape,
    MaskSpec, Model, ModelError, ModelPhoto, ModelScene, NoDevice, Opened, PaintingSpec,
    RenderedView, STROKE_SIZES, SavedAppearance, Stages, Stop, StrokeSettings, StyleEmbedding,
    StyleLayer, StyleLayerSpec, StyleLayers, StyleModel, StyledAppearance, TrainConfig,
    ViewGBuffer, is_cpu,
};
pub use impasto_paintings as paintings;
pub use impasto_prepare as prepare;
pub use impasto_scene as scene;
pub use impasto_style::{Network, StyleCode, StyleError, StyleInput, StyleVae, weights};
pub use impasto_train::{
    EncoderCheck, EncoderOptions, EncoderSummary, Event, PainterOptions, PainterSummary, Recovery,
    Refinement, Stage, TrainError, TrainOptions, TrainSummary, Unfinished, cache_folder,
    check_encoder, read_encoder, read_painter, read_paintings, train, train_encoder, train_painter,
};
pub use impasto_view as view;
