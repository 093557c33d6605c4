//! What a model's surfaces are for other programs: stylised point clouds and Gaussian splats.
//!
//! [`Views`] are a model's pictures and depths from its training views; [`export_points`] and
//! [`export_splats`] make a file of them. Both merge what several views show of the same surface
//! and leave out what other views contradict. Splats are then fitted to the pictures.
//!
//! Nothing here knows a model's networks: views may come from anywhere that has depth.

mod cloud;
mod error;
mod export;
mod fit;
mod ply;
mod raster;
mod splats;
mod surface;
mod views;

pub use error::ExportError;
pub use export::{Exported, export_points, export_splats};
pub use views::{RgbdView, ViewSelection, Views, Watch};
