//! The kernels for GPUs, in CubeCL: one source for Vulkan, Metal and DX12. Tensors in, tensors out,
//! nothing is read back.
//!
//! Each says the same as its namesake in [`crate::cpu`]. Sums over rows and rays have one order;
//! only the hash grid's gradient is added up by whoever comes first.

pub(crate) mod adam;
pub(crate) mod composite;
pub(crate) mod density_grid;
pub(crate) mod exemplar;
mod field;
pub(crate) mod hash_grid;
pub(crate) mod launch;
mod march;
pub(crate) mod merge;
pub(crate) mod mlp;
pub(crate) mod perceptual;
pub(crate) mod plain_mlp;
pub(crate) mod radiance;

pub use field::{
    DensityGrids, Descent, FieldSamples, FieldSpec, MergedSamples, RaySamples, Rays, SamplesRead,
    Targets, descend, evaluate, surface_layout,
};
