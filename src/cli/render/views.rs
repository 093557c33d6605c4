//! Where to render from.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use impasto::scene::file::read_text;
use impasto::scene::paths::{KeyframeOptions, frame_rate, keyframes, orbit, spiral};
use impasto::scene::{Camera, Intrinsics, Split, nerf_plus_plus_path};
use impasto::{Model, ModelScene};

use crate::cli::CliError;
use crate::output::Viewpoint;

/// Frames of an orbit or a spiral when none are asked for.
pub const FRAMES: usize = 60;

/// Where viewpoints come from.
#[derive(Debug, Clone, PartialEq)]
pub enum ViewSource {
    /// The photos of a split.
    Photos(Split),
    /// A loop around the scene.
    Orbit,
    /// A sway in front of the scene.
    Spiral,
    /// A camera path's file.
    File(PathBuf),
    /// A NeRF++ folder of poses.
    Folder(PathBuf),
}

impl FromStr for ViewSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "train" => Ok(Self::Photos(Split::Train)),
            "test" => Ok(Self::Photos(Split::Test)),
            "orbit" => Ok(Self::Orbit),
            "spiral" => Ok(Self::Spiral),
            file if file.to_ascii_lowercase().ends_with(".json") => Ok(Self::File(file.into())),
            folder if Path::new(folder).join("pose").is_dir() => Ok(Self::Folder(folder.into())),
            _ => Err(
                "use train, test, orbit, spiral, a .json file or a NeRF++ camera_path folder"
                    .into(),
            ),
        }
    }
}

impl ViewSource {
    /// Frames a second, where a camera path's file states them.
    pub fn fps(&self) -> Result<Option<f64>, CliError> {
        match self {
            Self::File(path) => {
                let text = read_text(path).map_err(CliError::read(path))?;
                Ok(frame_rate(&text))
            }
            _ => Ok(None),
        }
    }
}

/// The views of `source`; see the command's help for `size` and `frames`.
pub fn views(
    model: &Model,
    source: &ViewSource,
    size: Option<(u32, u32)>,
    frames: Option<usize>,
) -> Result<Vec<Viewpoint>, CliError> {
    if frames == Some(0) {
        return Err(CliError::Usage("--frames must be at least 1".into()));
    }
    let scene = &model.file.scene;
    let train = scene.cameras(Split::Train);
    let path_size = || size.or_else(|| train.first().map(pixels)).unwrap_or((1, 1));
    let count = frames.unwrap_or(FRAMES);
    let cameras = match source {
        ViewSource::Photos(split) => return Ok(photos(scene, *split, size, frames)),
        ViewSource::Orbit => orbit(&train, count, path_size())?,
        ViewSource::Spiral => spiral(&train, count, path_size())?,
        ViewSource::Folder(path) => {
            let path = nerf_plus_plus_path(path)?;
            let place = |i: usize| {
                let camera = &path[i];
                Camera {
                    intrinsics: sized(&camera.intrinsics, size),
                    camera_to_world: scene.normalisation.pose_to_scene(camera.camera_to_world),
                }
            };
            spread(path.len(), frames).map(place).collect()
        }
        ViewSource::File(path) => {
            let text = read_text(path).map_err(CliError::read(path))?;
            let options = KeyframeOptions {
                cameras: &train,
                normalisation: &scene.normalisation,
                frames,
                size,
            };
            keyframes(&text, &options).map_err(|source| CliError::PathFile {
                path: path.clone(),
                source,
            })?
        }
    };
    let view = |camera| Viewpoint {
        camera,
        photo: None,
    };
    Ok(cameras.into_iter().map(view).collect())
}

fn pixels(camera: &Camera) -> (u32, u32) {
    (camera.intrinsics.width, camera.intrinsics.height)
}

/// Indices of `count` views, or of `frames` evenly spaced ones when there are more.
fn spread(count: usize, frames: Option<usize>) -> impl Iterator<Item = usize> {
    let frames = frames.unwrap_or(count).min(count);
    (0..frames).map(move |i| i * count / frames)
}

/// Views of a split's photos; `frames` of them, evenly spaced, when there are more.
fn photos(
    scene: &ModelScene,
    split: Split,
    size: Option<(u32, u32)>,
    frames: Option<usize>,
) -> Vec<Viewpoint> {
    let photos = scene.photos.iter().filter(|photo| photo.split == split);
    let photos: Vec<_> = photos.collect();
    let view = |i: usize| Viewpoint {
        camera: Camera {
            intrinsics: sized(&photos[i].camera.intrinsics, size),
            ..photos[i].camera
        },
        photo: Some(photos[i].name.clone()),
    };
    spread(photos.len(), frames).map(view).collect()
}

/// A lens on its own pixel grid, or on one that was asked for.
fn sized(k: &Intrinsics, size: Option<(u32, u32)>) -> Intrinsics {
    size.map_or(*k, |size| cropped(k, size))
}

/// The same lens on another pixel grid. Another shape shows the middle of the photo: nothing is
/// stretched, and nothing is shown that was not photographed.
fn cropped(k: &Intrinsics, size: (u32, u32)) -> Intrinsics {
    let (width, height) = size;
    let (w, h) = (f64::from(width), f64::from(height));
    let (old_w, old_h) = (f64::from(k.width), f64::from(k.height));
    let scale = (w / old_w).max(h / old_h);
    Intrinsics {
        width,
        height,
        fl_x: k.fl_x * scale,
        fl_y: k.fl_y * scale,
        cx: (k.cx - 0.5 * old_w) * scale + 0.5 * w,
        cy: (k.cy - 0.5 * old_h) * scale + 0.5 * h,
        distortion: k.distortion,
    }
}

#[cfg(test)]
mod tests {
    use impasto::scene::Distortion;

    use super::*;

    const LENS: Intrinsics = Intrinsics {
        width: 400,
        height: 300,
        fl_x: 350.0,
        fl_y: 350.0,
        cx: 210.0,
        cy: 140.0,
        distortion: Distortion {
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
        },
    };

    #[test]
    fn the_same_shape_is_the_same_view() {
        assert_eq!(cropped(&LENS, (200, 150)), LENS.resized(200, 150));
    }

    #[test]
    fn another_shape_is_cut_from_the_middle() {
        let wide = cropped(&LENS, (400, 200));
        assert_eq!(
            (wide.fl_x, wide.fl_y, wide.cx, wide.cy),
            (350.0, 350.0, 210.0, 90.0)
        );
        let square = cropped(&LENS, (600, 600));
        assert_eq!(
            (square.fl_x, square.fl_y, square.cx, square.cy),
            (700.0, 700.0, 320.0, 280.0)
        );
    }

    #[test]
    fn a_source_is_a_word_or_a_json_file() {
        assert_eq!("test".parse(), Ok(ViewSource::Photos(Split::Test)));
        assert_eq!("a/b.JSON".parse(), Ok(ViewSource::File("a/b.JSON".into())));
        assert!("around".parse::<ViewSource>().is_err());
    }
}
