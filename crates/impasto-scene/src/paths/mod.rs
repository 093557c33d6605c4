//! Camera paths: lists of cameras to render a film or a set of views from.
//!
//! Paths are made from the cameras of a capture's train photos, in scene space, so that they work
//! from a saved model as well. The paths of the photos themselves are
//! [`Scene::cameras`](crate::Scene::cameras).

mod between;
pub(crate) mod camera_geometry;
mod camera_path;
mod keyframes;
mod orbit;
pub(crate) mod pinhole;
mod request;
mod spiral;
mod spline;

pub use between::{Between, between};
pub use camera_path::{CameraPath, Keyframe};
pub use keyframes::{KeyframeOptions, frame_rate, keyframes};
pub use orbit::orbit;
pub use request::PathError;
pub use spiral::spiral;
