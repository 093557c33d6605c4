//! The NeRF++ field (Zhang et al. 2020) with a separable appearance network.
//!
//! - [`sphere`]: the unit sphere, its exit along a ray, the inverted outer space;
//! - [`encoding`]: hash-grid and frequency encodings behind one type;
//! - [`network`]: layers that share one weight vector, plain or as in the paper;
//! - [`branch`]: `base` and `geo` of one volume;
//! - [`appearance`]: `app`, whose weights are data: learned for photos, predicted for paintings;
//! - [`parameters`]: names and order of all that is learned, said once;
//! - [`grids`] and [`sampling`]: where samples go, packed ray by ray;
//! - `volrend`: weights, accumulation, the [`GBuffer`] and its shading;
//! - `backend`: three ways to do the same steps: reference, CPU, GPU;
//! - [`renderer`]: the one [`Renderer`], which picks one of them when it is opened;
//! - [`training`]: a field in training, its loss and gradients.
//!
//! Styles are unknown here except as "weights of `app`".

pub mod appearance;
mod backend;
pub mod branch;
pub mod config;
pub mod distilled;
pub mod encoding;
pub mod field;
pub mod grids;
pub mod network;
pub mod parameters;
pub mod rays;
pub mod renderer;
pub mod sampling;
pub mod sphere;
pub mod training;
mod volrend;

pub use appearance::{Appearance, Brushwork, Ground, Palette, StrokeSettings};
pub use backend::reference::FieldValues;
pub use branch::{Branch, BranchWeights};
pub use config::{
    AppConfig, AppearanceConfig, EncodingConfig, FieldConfig, HierarchicalConfig, PaintSpec,
    SamplingConfig, Shading, VolumeConfig,
};
pub use distilled::{DistilledFeatures, Surroundings};
pub use encoding::host;
pub use field::{Field, FieldWeights, RadianceField};
pub use grids::{OccupancyGrids, VisibleCells};
pub use network::{AppNetwork, Trunk};
pub use parameters::Parameters;
pub use rays::{RayBatch, contracted_distance, jitter};
pub use renderer::{GBufferOptions, RayBuffers, RenderedRays, Renderer};
pub use sampling::Samples;
pub use volrend::gbuffer::{GBuffer, SurfacePoints};
