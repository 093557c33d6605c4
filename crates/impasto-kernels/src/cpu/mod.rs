//! Plain-Rust kernels over `f32` slices, parallel through rayon.

pub mod adam;
pub mod composite;
pub mod hash_grid;
pub mod mlp;
pub mod occupancy;
pub mod perceptual;

mod math;
mod product;
