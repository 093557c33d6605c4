//! Which format a capture is in, by what lies in its folder.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::error::SceneError;
use crate::format::Format;
use crate::picture_file::is_picture;
use crate::readers::llff::POSES;
use crate::scene::Split;

/// What a reader needs to start.
#[derive(Debug, PartialEq)]
pub(crate) enum Located {
    /// Folder of `cameras.*`, `images.*`, `points3D.*`, and whether they are binary.
    Colmap(PathBuf, bool),
    /// The JSON files, each with the split that its name stands for.
    Transforms(Vec<(PathBuf, Option<Split>)>),
    /// Folder of `train/` and the others.
    NerfPlusPlus(PathBuf),
    /// Folder of `poses_bounds.npy`.
    Llff(PathBuf),
}

impl Located {
    pub(crate) fn format(&self) -> Format {
        match self {
            Self::Colmap(..) => Format::Colmap,
            Self::Transforms(_) => Format::Transforms,
            Self::NerfPlusPlus(_) => Format::NerfPlusPlus,
            Self::Llff(_) => Format::Llff,
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
    std::fs::metadata(path).map_err(|source| match source.kind() {
        ErrorKind::NotFound => SceneError::Missing {
            path: path.to_owned(),
        },
        _ => SceneError::io(path)(source),
    })?;
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
    if let Some(found) = found {
        return Ok(found);
    }
    Err(SceneError::Unrecognised {
        path: path.to_owned(),
        found: what_is_there(path, format)?,
    })
}

fn colmap(path: &Path) -> Option<Located> {
    let has = |model: &Path, ending: &str| {
        let mut files = ["cameras", "images"].into_iter();
        files.all(|name| model.join(format!("{name}.{ending}")).is_file())
    };
    let mut models = ["sparse/0", "sparse", ""]
        .map(|below| path.join(below))
        .into_iter();
    models.find_map(|model| {
        let binary = has(&model, "bin");
        (binary || has(&model, "txt")).then_some(Located::Colmap(model, binary))
    })
}

fn transforms(path: &Path) -> Option<Located> {
    let alone = |file: PathBuf| Located::Transforms(vec![(file, None)]);
    if path.is_file() {
        let is_json = path.extension()?.eq_ignore_ascii_case("json");
        return is_json.then(|| alone(path.to_owned()));
    }
    let file = |name: &str| Some(path.join(name)).filter(|p| p.is_file());
    if let Some(whole) = file("transforms.json") {
        return Some(alone(whole));
    }
    let train = file("transforms_train.json")?;
    let mut files = vec![(train, Some(Split::Train))];
    if let Some(test) = file("transforms_test.json").or_else(|| file("transforms_val.json")) {
        files.push((test, Some(Split::Test)));
    }
    Some(Located::Transforms(files))
}

fn nerf_plus_plus(path: &Path) -> Option<Located> {
    let (train, mut parts) = (path.join("train"), ["pose", "intrinsics", "rgb"].iter());
    let whole = parts.all(|part| train.join(part).is_dir());
    whole.then(|| Located::NerfPlusPlus(path.to_owned()))
}

fn llff(path: &Path) -> Option<Located> {
    let whole = path.join(POSES).is_file();
    whole.then(|| Located::Llff(path.to_owned()))
}

/// Describes a path in which no capture was found.
fn what_is_there(path: &Path, format: Option<Format>) -> Result<String, SceneError> {
    if let Some(format) = format {
        return Ok(format!("no capture in the format \"{format}\" here"));
    }
    if !path.is_dir() {
        return Ok("this file is not a capture".into());
    }
    let mut names = Vec::new();
    for entry in std::fs::read_dir(path).map_err(SceneError::io(path))? {
        let name = entry.map_err(SceneError::io(path))?.file_name();
        names.push(name.to_string_lossy().to_lowercase());
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
