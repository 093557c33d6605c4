//! Everything about style: perceptual features, the style-VAE, the hypernetwork, losses, patches.
//!
//! Knows nothing of photos' cameras or of scenes; it predicts "weights of `app`", whatever
//! their use.

mod components;
mod descriptor;
mod error;
mod hypernetwork;
pub mod losses;
mod network;
mod patch;
pub mod perceptual;
mod picture;
mod tensors;
mod vae;
mod vae_training;
pub mod weights;

pub use descriptor::{DESCRIPTOR_LAYERS, Descriptor, GREATEST_FEATURE};
pub use error::StyleError;
pub use hypernetwork::{Hypernetwork, HypernetworkWeights};
pub use losses::StyleReduction;
pub use network::Network;
pub use patch::{Patch, PatchSampler, PatchStrides};
pub use perceptual::{Features, Perceptual, STROKE_DIRECTIONS, Statistics, stroke_directions};
pub use picture::{picture, recolour, square_crop};
pub use tensors::{TensorFile, write_f16};
pub use vae::{StyleCode, StyleInput, StyleVae};
pub use vae_training::{VaeTraining, train_vae};
