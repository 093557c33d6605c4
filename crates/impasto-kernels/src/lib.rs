//! Differentiable operations that a general tensor library cannot do fast.
//!
//! Two layers:
//! - [`cpu`] holds plain functions over `f32` slices, `gpu` (with that feature) their namesakes for
//!   GPUs. Each has a slow, obvious twin in its tests.
//! - [`ops`] registers them with burn, forward and backward, so that they take part in autodiff
//!   like any built-in operation and run on whatever [`burn::tensor::Device`] is chosen.
//!
//! Everything is deterministic: work is cut into pieces whose number depends on the data only,
//! and partial sums are added in a fixed order.

pub mod cpu;
pub mod device;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod ops;
pub mod sampling;
pub mod settings;

pub use cpu::adam::{AdamStep, Sparse};
pub use cpu::composite::{CompositeLayout, RaySpan};
pub use cpu::conv_chain::{ChainTape, ConvChain, FilterGradient, Resample};
pub use cpu::convolution::ConvLayer;
pub use cpu::density_grid::DensityGrid;
pub use cpu::hash_grid::HashGridSpec;
pub use cpu::mlp::{Activation, LayerSpec, MlpSpec};
pub use cpu::padded::{Border, FeatureMap, OddEnd};
pub use cpu::perceptual::PerceptualStack;
pub use cpu::radiance::{Density, RadianceSpec, Volume, VolumeSpec};
pub use sampling::OccupancySpec;
