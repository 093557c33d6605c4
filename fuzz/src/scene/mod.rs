//! What the targets of impasto-scene do with an input. `impasto-scene/tests/fuzz_seeds.rs` compiles
//! this folder too, to do the same in every run of the tests.

mod capture;
mod checks;
mod seeds;

pub use checks::check_message;
pub use seeds::seeds;

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use capture::{Capture, Kind};
use checks::check_camera;
use glam::{DMat4, DVec3};
use image::ImageReader;
use impasto_scene::paths::{KeyframeOptions, keyframes};
use impasto_scene::{Camera, Distortion, Intrinsics, Normalisation, npy, read_rgb};

/// Most pixels of a picture that is decoded here: the bound on memory is to be one of the decoder,
/// not of the picture.
const MOST_PIXELS: u64 = 1 << 20;

/// Something that reads bytes, and demands what must hold of the result.
pub enum Target {
    /// A file of a capture that is otherwise whole.
    Capture(Box<Capture>),
    /// The same for two files; the first byte decides which.
    Either(Box<[Capture; 2]>),
    CameraPath,
    Npy,
    /// A picture at this path.
    Picture(PathBuf),
}

impl Target {
    /// All names.
    pub const NAMES: [&str; 12] = [
        "colmap_cameras_bin",
        "colmap_images_bin",
        "colmap_points_bin",
        "colmap_cameras_txt",
        "colmap_images_txt",
        "colmap_points_txt",
        "transforms",
        "nerf_plus_plus",
        "llff",
        "camera_path",
        "npy",
        "picture",
    ];

    /// The target of that name, with its files in `scratch`.
    pub fn named(name: &str, scratch: &Path) -> Self {
        let one = |kind, file| Self::Capture(Box::new(Capture::new(scratch, kind, file)));
        match name {
            "colmap_cameras_bin" => one(Kind::ColmapBin, "sparse/0/cameras.bin"),
            "colmap_images_bin" => one(Kind::ColmapBin, "sparse/0/images.bin"),
            "colmap_points_bin" => one(Kind::ColmapBin, "sparse/0/points3D.bin"),
            "colmap_cameras_txt" => one(Kind::ColmapTxt, "sparse/0/cameras.txt"),
            "colmap_images_txt" => one(Kind::ColmapTxt, "sparse/0/images.txt"),
            "colmap_points_txt" => one(Kind::ColmapTxt, "sparse/0/points3D.txt"),
            "transforms" => one(Kind::Transforms, "transforms.json"),
            "nerf_plus_plus" => Self::Either(Box::new(
                ["train/pose/1.txt", "train/intrinsics/1.txt"]
                    .map(|file| Capture::new(scratch, Kind::NerfPlusPlus, file)),
            )),
            "llff" => one(Kind::Llff, "poses_bounds.npy"),
            "camera_path" => Self::CameraPath,
            "npy" => Self::Npy,
            "picture" => Self::Picture(scratch.join("picture")),
            other => panic!("there is no target {other}"),
        }
    }

    /// Reads `bytes`; whether they were accepted.
    pub fn run(&self, bytes: &[u8]) -> bool {
        match self {
            Self::Capture(capture) => capture.load_with(bytes),
            Self::Either(captures) => match bytes.split_first() {
                Some((which, text)) => captures[usize::from(which % 2)].load_with(text),
                None => false,
            },
            Self::CameraPath => camera_path(bytes),
            Self::Npy => array(bytes),
            Self::Picture(path) => picture(bytes, path),
        }
    }
}

/// A camera path with the file's own number of frames, and with another.
fn camera_path(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return false;
    };
    let mut accepted = true;
    let camera = Camera {
        intrinsics: Intrinsics {
            width: 8,
            height: 6,
            fl_x: 7.0,
            fl_y: 7.0,
            cx: 4.0,
            cy: 3.0,
            distortion: Distortion::default(),
        },
        camera_to_world: DMat4::IDENTITY,
    };
    let normalisation = Normalisation::of_cameras(&[DVec3::ZERO, DVec3::X, DVec3::Y]);
    for (frames, size) in [(None, None), (Some(7), Some((16, 12)))] {
        let options = KeyframeOptions {
            cameras: &[camera],
            normalisation: &normalisation.expect("three places"),
            frames,
            size,
        };
        match keyframes(text, &options) {
            Ok(cameras) => cameras.iter().for_each(check_camera),
            Err(error) => {
                check_message(&error);
                accepted = false;
            }
        }
    }
    accepted
}

/// What is read of an array has the size that it says, is no larger than the file, and comes back
/// when it is written and read again.
fn array(bytes: &[u8]) -> bool {
    let (shape, numbers) = match npy::decode(bytes) {
        Ok(read) => read,
        Err(problem) => {
            check_message(&problem);
            return false;
        }
    };
    assert_eq!(shape.iter().product::<usize>(), numbers.len());
    assert!(4 * numbers.len() <= bytes.len());
    let [height, width] = shape[..] else {
        return true;
    };
    let (Ok(height), Ok(width)) = (u32::try_from(height), u32::try_from(width)) else {
        return true;
    };
    let floats: Vec<f32> = numbers.iter().map(|x| *x as f32).collect();
    let (again, same) = npy::decode(&npy::encode(&floats, width, height)).expect("ours");
    assert_eq!(again, shape);
    let bits = |x: f64| (x as f32).to_bits();
    let equal = |(a, b): (&f64, &f64)| bits(*a) == bits(*b) || (a.is_nan() && b.is_nan());
    assert!(numbers.iter().zip(&same).all(equal));
    true
}

fn picture(bytes: &[u8], path: &Path) -> bool {
    let header = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let size = header.ok().and_then(|r| r.into_dimensions().ok());
    if size.is_some_and(|(w, h)| u64::from(w) * u64::from(h) > MOST_PIXELS) {
        return false;
    }
    fs::write(path, bytes).expect("the scratch folder is writable");
    match read_rgb(path) {
        Ok(pixels) => {
            assert!(pixels.width() > 0 && pixels.height() > 0);
            true
        }
        Err(error) => {
            check_message(&error);
            false
        }
    }
}
