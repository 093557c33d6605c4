//! Which format a capture is in, by what lies in its folder.

use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::SceneError;
use crate::picture_file::is_picture;
use crate::readers::llff::POSES;
use crate::scene::Split;

/// A capture format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// A COLMAP sparse model with its photos.
    Colmap,
    /// `transforms.json` of instant-ngp or nerfstudio, or Blender's `transforms_*.json`.
    Transforms,
    /// NeRF++ folders: `{train,test}/{intrinsics,pose,rgb}`.
    #[serde(rename = "nerf++")]
    NerfPlusPlus,
    /// LLFF's `poses_bounds.npy` with its photos.
    Llff,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Colmap => "colmap",
            Self::Transforms => "transforms",
            Self::NerfPlusPlus => "nerf++",
            Self::Llff => "llff",
        })
    }
}

impl FromStr for Format {
    type Err = String;

    /// Reads a format's name, as it is displayed.
    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "colmap" => Ok(Self::Colmap),
            "transforms" => Ok(Self::Transforms),
            "nerf++" => Ok(Self::NerfPlusPlus),
            "llff" => Ok(Self::Llff),
            _ => Err(format!(
                "unknown capture format \"{name}\"; use colmap, transforms, nerf++ or llff"
            )),
        }
    }
}

/// What a reader needs to start.
#[derive(Debug, PartialEq)]
pub(crate) enum Located {
    /// Folder of `cameras.*`, `images.*`, `points3D.*`, and whether they are binary.
    Colmap { model: PathBuf, binary: bool },
    /// The JSON files, each with the split that its name stands for.
    Transforms {
        files: Vec<(PathBuf, Option<Split>)>,
    },
    /// Folder of `train/` and the others.
    NerfPlusPlus { root: PathBuf },
    /// Folder of `poses_bounds.npy`.
    Llff { root: PathBuf },
}

impl Located {
    pub(crate) fn format(&self) -> Format {
        match self {
            Self::Colmap { .. } => Format::Colmap,
            Self::Transforms { .. } => Format::Transforms,
            Self::NerfPlusPlus { .. } => Format::NerfPlusPlus,
            Self::Llff { .. } => Format::Llff,
        }
    }
}

/// The format of the capture at `path` (a folder, or a transforms file).
///
/// A folder with a COLMAP model and another description is COLMAP's, because that model has
/// sparse points as well.
///
/// # Errors
/// A missing path, or a folder in which nothing known is found.
pub fn detect(path: &Path) -> Result<Format, SceneError> {
    Ok(locate(path, None)?.format())
}

/// Finds the files of a capture, of the given format or of whichever is there.
pub(crate) fn locate(path: &Path, format: Option<Format>) -> Result<Located, SceneError> {
    if let Err(source) = std::fs::metadata(path) {
        let path = path.to_owned();
        return Err(match source.kind() {
            ErrorKind::NotFound => SceneError::Missing { path },
            _ => SceneError::Io { path, source },
        });
    }
    let found = match format {
        Some(Format::Colmap) => colmap(path),
        Some(Format::Transforms) => transforms(path),
        Some(Format::NerfPlusPlus) => nerf_plus_plus(path),
        Some(Format::Llff) => llff(path),
        None => colmap(path)
            .or_else(|| transforms(path))
            .or_else(|| nerf_plus_plus(path))
            .or_else(|| llff(path)),
    };
    match found {
        Some(found) => Ok(found),
        None => Err(SceneError::Unrecognised {
            path: path.to_owned(),
            found: what_is_there(path, format)?,
        }),
    }
}

fn colmap(path: &Path) -> Option<Located> {
    ["sparse/0", "sparse", ""].iter().find_map(|below| {
        let model = path.join(below);
        [("bin", true), ("txt", false)]
            .into_iter()
            .find_map(|(extension, binary)| {
                ["cameras", "images"]
                    .iter()
                    .all(|name| model.join(format!("{name}.{extension}")).is_file())
                    .then(|| Located::Colmap {
                        model: model.clone(),
                        binary,
                    })
            })
    })
}

fn transforms(path: &Path) -> Option<Located> {
    if path.is_file() {
        return path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("json"))
            .then(|| Located::Transforms {
                files: vec![(path.to_owned(), None)],
            });
    }
    let file = |name: &str| Some(path.join(name)).filter(|p| p.is_file());
    if let Some(whole) = file("transforms.json") {
        return Some(Located::Transforms {
            files: vec![(whole, None)],
        });
    }
    let train = file("transforms_train.json")?;
    let mut files = vec![(train, Some(Split::Train))];
    if let Some(test) = file("transforms_test.json").or_else(|| file("transforms_val.json")) {
        files.push((test, Some(Split::Test)));
    }
    Some(Located::Transforms { files })
}

fn nerf_plus_plus(path: &Path) -> Option<Located> {
    ["pose", "intrinsics", "rgb"]
        .iter()
        .all(|part| path.join("train").join(part).is_dir())
        .then(|| Located::NerfPlusPlus {
            root: path.to_owned(),
        })
}

fn llff(path: &Path) -> Option<Located> {
    path.join(POSES).is_file().then(|| Located::Llff {
        root: path.to_owned(),
    })
}

/// Describes a path in which no capture was found.
fn what_is_there(path: &Path, format: Option<Format>) -> Result<String, SceneError> {
    if let Some(format) = format {
        return Ok(format!("no capture in the format \"{format}\" here"));
    }
    if !path.is_dir() {
        return Ok("this file is not a capture".into());
    }
    let io = |source| SceneError::Io {
        path: path.to_owned(),
        source,
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(path).map_err(io)? {
        names.push(
            entry
                .map_err(io)?
                .file_name()
                .to_string_lossy()
                .to_lowercase(),
        );
    }
    let photos = |name: &String| is_picture(Path::new(name));
    Ok(if names.is_empty() {
        "the folder is empty".into()
    } else if names.iter().any(photos) || names.iter().any(|n| n == "images") {
        "there are photos but no camera poses; `impasto prepare` computes them".into()
    } else {
        "no capture found in this folder".into()
    })
}
