//! The NeRF++ field (Zhang et al. 2020) with a separable appearance network.
//!
//! - [`sphere`]: the unit sphere, its exit along a ray, the inverted outer space;
//! - [`encoding`]: hash-grid and frequency encodings behind one type;
//! - [`network`]: layers that share one weight vector, plain or as in the paper;
//! - [`branch`]: `base` and `geo` of one volume;
//! - [`appearance`]: `app`, whose weights are data: learned for photos, predicted for paintings;
//! - [`sampling`]: samples where density grids expect light, packed ray by ray;
//! - `surface`: a ray's samples merged to one per volume, for cheap shading;
//! - [`paintable`]: all that `app` looks at and no style changes;
//! - [`loss`]: the geometry stage's loss, in one operation;
//! - `resident` (feature `gpu`): the same on a GPU without ever coming back from there;
//! - [`render`]: the one ray renderer that training, rendering and evaluation share.
//!
//! Styles are unknown here except as "weights of `app`".

pub mod appearance;
pub mod branch;
pub mod config;
pub mod encoding;
pub mod field;
mod host;
pub mod loss;
pub mod network;
pub mod paintable;
pub mod render;
#[cfg(feature = "gpu")]
pub mod resident;
pub mod sampling;
mod seen;
pub mod sphere;
mod surface;

pub use appearance::{Appearance, AppearanceConfig, Canvas, Shading};
pub use branch::{Branch, BranchWeights};
pub use config::{
    CascadeConfig, DensityActivation, EncodingConfig, FieldConfig, SamplingConfig, VolumeConfig,
};
pub use field::{Field, FieldWeights, Grids, Visible};
pub use network::{AppNetwork, Trunk};
pub use paintable::Paintable;
pub use render::{Geometry, Prepared, RenderedRays, prepare_rays, render_rays};
pub use sampling::{RayBatch, Samples, contracted_distance};
pub use seen::{SeenRays, see_rays};
