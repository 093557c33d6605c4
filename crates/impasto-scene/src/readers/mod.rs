//! Readers of capture formats. Each turns its files into one [`Capture`].

pub(crate) mod colmap;
pub(crate) mod llff;
mod names;
pub(crate) mod nerf_plus_plus;
pub(crate) mod transforms;

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use crate::camera::Camera;
use crate::detect::Located;
use crate::error::SceneError;
use crate::picture_file;
use crate::pose;
use crate::scene::Split;

pub(crate) use names::plain_path;

/// A capture in its own coordinates, before any photo is decoded.
#[derive(Debug, Default)]
pub(crate) struct Capture {
    pub(crate) frames: Vec<Frame>,
    pub(crate) points: Vec<RawPoint>,
    /// Whether the files say that the photos are rendered.
    pub(crate) synthetic: bool,
}

/// One posed photo as its format describes it.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) name: String,
    pub(crate) photo: PathBuf,
    /// Camera at the size that the format states.
    pub(crate) camera: Camera,
    /// The split, when the format has one.
    pub(crate) split: Option<Split>,
    /// The picture that says which pixels show the place.
    pub(crate) mask: Option<PathBuf>,
    /// Whether the camera's size is the photo's own, because the format states none.
    pub(crate) measured: bool,
}

impl Frame {
    /// A photo whose pose and lens `path` states, checked.
    fn checked(
        path: &Path,
        (name, photo): (String, PathBuf),
        camera: Camera,
        split: Option<Split>,
    ) -> Result<Self, SceneError> {
        let camera_to_world =
            pose::rigid(camera.camera_to_world).map_err(|problem| SceneError::Pose {
                path: path.to_owned(),
                frame: name.clone(),
                problem,
            })?;
        let place = || format!("frame {name}");
        let check = camera.intrinsics.check();
        check.map_err(|problem| SceneError::malformed(path, place(), problem))?;
        Ok(Self {
            name,
            photo,
            camera: Camera {
                camera_to_world,
                ..camera
            },
            split,
            mask: None,
            measured: false,
        })
    }
}

/// One sparse point, with `(index of the frame, pixel at the camera's stated size)`.
#[derive(Debug)]
pub(crate) struct RawPoint {
    pub(crate) position: DVec3,
    pub(crate) colour: [u8; 3],
    pub(crate) seen_by: Vec<(usize, DVec2)>,
    pub(crate) error: f64,
}

pub(crate) fn read(located: &Located) -> Result<Capture, SceneError> {
    match located {
        Located::Colmap { model, binary } => colmap::read(model, *binary),
        Located::Transforms { files } => transforms::read(files),
        Located::NerfPlusPlus { root } => nerf_plus_plus::read(root),
        Located::Llff { root } => llff::read(root),
    }
}

/// The folder that all photos of a capture are in, at whatever depth.
pub(crate) fn root(located: &Located) -> PathBuf {
    let root = match located {
        Located::Colmap { model, .. } => colmap::root(model),
        Located::Transforms { files } => files
            .first()
            .and_then(|(file, _)| file.parent())
            .map(Path::to_owned),
        Located::NerfPlusPlus { root } | Located::Llff { root } => Some(root.clone()),
    };
    root.unwrap_or_default()
}

/// The files of a folder that `wanted` accepts, in order of name.
fn files_in(folder: &Path, wanted: impl Fn(&Path) -> bool) -> Result<Vec<PathBuf>, SceneError> {
    let io = |source| SceneError::Io {
        path: folder.to_owned(),
        source,
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_file() && wanted(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a file's ending is that of a photo.
fn is_photo(path: &Path) -> bool {
    picture_file::is_picture(path)
}

/// Width and height of a photo, from its header.
fn photo_size(photo: &Path) -> Result<(u32, u32), SceneError> {
    picture_file::stored_size(photo)
}

impl Capture {
    /// Orders the frames by name, and the points' references to them with it.
    pub(crate) fn sort_by_name(&mut self) {
        let mut order: Vec<usize> = (0..self.frames.len()).collect();
        order.sort_by(|&a, &b| self.frames[a].name.cmp(&self.frames[b].name));
        let mut place = vec![0; order.len()];
        for (to, &from) in order.iter().enumerate() {
            place[from] = to;
        }
        for point in &mut self.points {
            for (frame, _) in &mut point.seen_by {
                *frame = place[*frame];
            }
        }
        self.frames.sort_by(|a, b| a.name.cmp(&b.name));
    }
}
