//! Plain-Rust kernels over `f32` slices, parallel through rayon.

pub mod adam;
pub mod composite;
pub mod conv_chain;
pub mod convolution;
pub mod density_grid;
pub mod exemplar;
pub mod hash_grid;
pub mod mlp;
pub mod passes;
pub mod perceptual;
pub mod radiance;

pub(crate) mod padded;

mod math;
mod product;
mod statistics;
mod winograd;
