//! What readers make of a capture, before any photo is decoded.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use crate::camera::Camera;
use crate::error::SceneError;
use crate::pose;
use crate::scene::Split;

/// A capture in its own coordinates, before any photo is decoded.
#[derive(Debug, Default)]
pub(crate) struct Capture {
    pub(crate) frames: Vec<RawFrame>,
    pub(crate) points: Vec<RawPoint>,
    /// Whether the files say that the photos are rendered.
    pub(crate) synthetic: bool,
}

/// One posed photo as its format describes it.
#[derive(Debug)]
pub(crate) struct RawFrame {
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

impl RawFrame {
    /// A photo whose pose and lens `path` states, checked.
    pub(super) fn checked(
        path: &Path,
        name: String,
        photo: PathBuf,
        camera: Camera,
        split: Option<Split>,
    ) -> Result<Self, SceneError> {
        let camera_to_world = pose::rigid(camera.camera_to_world)
            .map_err(|problem| SceneError::pose(path, &name, problem))?;
        let check = camera.intrinsics.check();
        check.map_err(|problem| SceneError::malformed(path, format!("frame {name}"), problem))?;
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

    /// Drops training frames, evenly spread, until `count` are left, and what points say of them;
    /// the splits of what is left.
    pub(crate) fn thinned(&mut self, splits: &[Split], count: usize) -> Vec<Split> {
        let of_training = splits.iter().filter(|s| **s == Split::Train).count();
        let mut number = 0;
        let mut kept = splits.iter().map(|split| match split {
            Split::Test => true,
            Split::Train => {
                number += 1;
                // As many of the first n as is their share, to the nearest: about the middle of each part.
                let before = |n: usize| (2 * n * count + of_training) / (2 * of_training);
                before(number) > before(number - 1)
            }
        });
        let kept: Vec<bool> = kept.by_ref().collect();
        let places: Vec<usize> = kept
            .iter()
            .scan(0, |place, kept| {
                let own = *place;
                *place += usize::from(*kept);
                Some(own)
            })
            .collect();
        for point in &mut self.points {
            point.seen_by.retain(|(frame, _)| kept[*frame]);
            for (frame, _) in &mut point.seen_by {
                *frame = places[*frame];
            }
        }
        let mut flags = kept.iter();
        self.frames
            .retain(|_| flags.next().is_some_and(|kept| *kept));
        let pairs = splits.iter().zip(&kept);
        pairs.filter(|(_, kept)| **kept).map(|(s, _)| *s).collect()
    }
}

/// The files of a folder that `wanted` accepts, in order of name.
pub(super) fn files_in(
    folder: &Path,
    wanted: impl Fn(&Path) -> bool,
) -> Result<Vec<PathBuf>, SceneError> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(SceneError::io(folder))? {
        let path = entry.map_err(SceneError::io(folder))?.path();
        if path.is_file() && wanted(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
