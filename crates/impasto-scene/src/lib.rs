//! Posed photos of a real place: cameras, readers, normalisation, splits and camera paths.
//!
//! Knows nothing of tensors. Conventions: DESIGN §6 (camera axes x right, y down, z forward;
//! colours are sRGB values in `[0, 1]` exactly as stored).
//!
//! [`load`] reads a capture into a [`Scene`]; [`paths`] makes camera paths from a scene's cameras.

pub mod builtin;
mod camera;
mod codec;
mod colors;
mod detect;
mod error;
pub mod file;
mod format;
pub mod inspect;
mod load;
mod masks;
pub mod metrics;
mod normalise;
pub mod npy;
pub mod overview;
pub mod paths;
mod photo;
mod picture_file;
mod picture_folder;
mod pose;
mod readers;
mod scene;
mod statistics;
mod viewpoint;

pub use camera::{Camera, Distortion, Intrinsics, Ray};
pub use colors::{AffineColors, ColorPairs};
pub use detect::detect;
pub use error::SceneError;
pub use format::Format;
pub use load::{LoadOptions, load};
pub use masks::MaskUse;
pub use normalise::Normalisation;
pub use photo::downscale;
pub use picture_file::{PICTURE_ENDINGS, decode_rgb, is_picture, read_rgb};
pub use picture_folder::{PictureFile, PictureFolder};
pub use readers::colmap::photo_names as colmap_photo_names;
pub use readers::nerf_plus_plus::camera_path as nerf_plus_plus_path;
pub use scene::{Observation, Photo, Scene, SparsePoint, Split};
pub use viewpoint::Vantage;
