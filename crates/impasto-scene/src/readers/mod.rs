//! Readers of capture formats. Each turns its files into one [`Capture`].

pub(crate) mod capture;
pub(crate) mod colmap;
pub(crate) mod llff;
pub(crate) mod names;
pub(crate) mod nerf_plus_plus;
pub(crate) mod transforms;

use std::path::PathBuf;

use crate::detect::Located;
use crate::error::SceneError;
use capture::Capture;

pub(crate) fn read(located: &Located) -> Result<Capture, SceneError> {
    match located {
        Located::Colmap(model, binary) => colmap::read(model, *binary),
        Located::Transforms(files) => transforms::read(files),
        Located::NerfPlusPlus(root) => nerf_plus_plus::read(root),
        Located::Llff(root) => llff::read(root),
    }
}

/// The folder that all photos of a capture are in, at whatever depth.
pub(crate) fn root(located: &Located) -> PathBuf {
    let root = match located {
        Located::Colmap(model, _) => colmap::root(model),
        Located::Transforms(files) => files
            .first()
            .and_then(|(file, _)| Some(file.parent()?.into())),
        Located::NerfPlusPlus(root) | Located::Llff(root) => Some(root.clone()),
    };
    root.unwrap_or_default()
}
