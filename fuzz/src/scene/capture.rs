//! Captures of which one file is replaced again and again.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec3};
use impasto_scene::{LoadOptions, load};

use super::checks::{check_message, check_scene};

/// Photos of a capture.
const PHOTOS: usize = 3;
/// Width and height of each.
const SIZE: (u32, u32) = (8, 6);

/// The formats of captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    ColmapBin,
    ColmapTxt,
    Transforms,
    NerfPlusPlus,
    Llff,
}

/// A whole capture on disk, one file of which can be replaced.
pub struct Capture {
    root: PathBuf,
    file: PathBuf,
}

impl Capture {
    /// A capture of that kind below `scratch` of which `file` is the fuzzer's.
    pub fn new(scratch: &Path, kind: Kind, file: &str) -> Self {
        let root = scratch.join(file.replace('/', "-"));
        for (name, bytes) in files(kind) {
            let path = root.join(name);
            fs::create_dir_all(path.parent().expect("inside the root")).expect("writable");
            fs::write(path, bytes).expect("writable");
        }
        let file = root.join(file);
        assert!(file.is_file(), "{}", file.display());
        Self { root, file }
    }

    /// Loads the capture with `bytes` as the fuzzer's file; whether that was accepted.
    pub fn load_with(&self, bytes: &[u8]) -> bool {
        fs::write(&self.file, bytes).expect("the scratch folder is writable");
        match load(&self.root, &LoadOptions::default()) {
            Ok(scene) => {
                check_scene(&scene);
                true
            }
            Err(error) => {
                check_message(&error);
                false
            }
        }
    }
}

/// Every file of a capture of that kind by name.
pub fn files(kind: Kind) -> Vec<(String, Vec<u8>)> {
    let mut files = match kind {
        Kind::ColmapBin => colmap_bin(),
        Kind::ColmapTxt => colmap_txt(),
        Kind::Transforms => transforms(),
        Kind::NerfPlusPlus => nerf_plus_plus(),
        Kind::Llff => llff(),
    };
    let folder = match kind {
        Kind::NerfPlusPlus => "train/rgb",
        _ => "images",
    };
    let photo = image::RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        image::Rgb([(x * 30) as u8, (y * 40) as u8, 128])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    photo
        .write_to(&mut png, image::ImageFormat::Png)
        .expect("a PNG");
    for i in 0..PHOTOS {
        files.push((format!("{folder}/{i}.png"), png.get_ref().clone()));
    }
    files
}

/// Camera-to-world poses around a place.
fn poses() -> Vec<DMat4> {
    let pose = |i: usize| {
        let angle = i as f64;
        let centre = DVec3::new(3.0 * angle.cos(), -1.0, 3.0 * angle.sin());
        let z = -centre.normalize_or_zero();
        let x = z.cross(-DVec3::Y).normalize_or_zero();
        let mut pose = DMat4::from_mat3(DMat3::from_cols(x, z.cross(x), z));
        pose.w_axis = centre.extend(1.0);
        pose
    };
    (0..PHOTOS).map(pose).collect()
}

/// World-to-camera quaternion (w, x, y, z) and translation.
fn inverse(pose: &DMat4) -> [f64; 7] {
    let inverse = pose.inverse();
    let q = DQuat::from_mat4(&inverse);
    let t = inverse.w_axis.truncate();
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
}

const LENS: [f64; 8] = [7.0, 7.5, 4.0, 3.0, 0.01, -0.02, 0.001, 0.002];

fn floats(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn colmap_bin() -> Vec<(String, Vec<u8>)> {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend([7u32, 4].iter().flat_map(|n| n.to_le_bytes()));
    cameras.extend([8u64, 6].iter().flat_map(|n| n.to_le_bytes()));
    cameras.extend(floats(&LENS));
    let mut images = (PHOTOS as u64).to_le_bytes().to_vec();
    for (i, pose) in poses().iter().enumerate() {
        images.extend((i as u32).to_le_bytes());
        images.extend(floats(&inverse(pose)));
        images.extend(7u32.to_le_bytes());
        images.extend(format!("{i}.png\0").as_bytes());
        images.extend(1u64.to_le_bytes());
        images.extend(floats(&[3.5, 2.5]));
        images.extend(0u64.to_le_bytes());
    }
    let mut points = 1u64.to_le_bytes().to_vec();
    points.extend(0u64.to_le_bytes());
    points.extend(floats(&[0.1, 0.2, 0.3]));
    points.extend([10, 20, 30]);
    points.extend(floats(&[0.25]));
    points.extend((PHOTOS as u64).to_le_bytes());
    for i in 0..PHOTOS as u32 {
        points.extend([i, 0].iter().flat_map(|n| n.to_le_bytes()));
    }
    [
        ("cameras", cameras),
        ("images", images),
        ("points3D", points),
    ]
    .map(|(name, bytes)| (format!("sparse/0/{name}.bin"), bytes))
    .into()
}

fn words(numbers: &[f64]) -> String {
    let words: Vec<String> = numbers.iter().map(f64::to_string).collect();
    words.join(" ")
}

fn colmap_txt() -> Vec<(String, Vec<u8>)> {
    let cameras = format!("# Cameras\n7 OPENCV 8 6 {}\n", words(&LENS));
    let mut images = String::from("# Images\n");
    for (i, pose) in poses().iter().enumerate() {
        images += &format!("{i} {} 7 {i}.png\n3.5 2.5 0\n", words(&inverse(pose)));
    }
    let points = "# Points\n0 0.1 0.2 0.3 10 20 30 0.25 0 0 1 0 2 0\n".to_owned();
    [
        ("cameras", cameras),
        ("images", images),
        ("points3D", points),
    ]
    .map(|(name, text)| (format!("sparse/0/{name}.txt"), text.into_bytes()))
    .into()
}

fn transforms() -> Vec<(String, Vec<u8>)> {
    let frames: Vec<_> = poses()
        .iter()
        .enumerate()
        .map(|(i, pose)| {
            let opengl = *pose * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
            serde_json::json!({
                "file_path": format!("images/{i}.png"),
                "transform_matrix": opengl.transpose().to_cols_array_2d(),
            })
        })
        .collect();
    let json = serde_json::json!({
        "camera_model": "OPENCV", "w": 8, "h": 6, "fl_x": 7.0, "fl_y": 7.5, "cx": 4.0, "cy": 3.0,
        "k1": 0.01, "k2": 0.0, "p1": 0.0, "p2": 0.0, "frames": frames,
    });
    vec![("transforms.json".into(), json.to_string().into_bytes())]
}

fn nerf_plus_plus() -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for (i, pose) in poses().iter().enumerate() {
        let lens = "7 0 4 0 0 7.5 3 0 0 0 1 0 0 0 0 1".to_owned();
        let pose = words(&pose.transpose().to_cols_array());
        files.push((format!("train/intrinsics/{i}.txt"), lens.into_bytes()));
        files.push((format!("train/pose/{i}.txt"), pose.into_bytes()));
    }
    files
}

fn llff() -> Vec<(String, Vec<u8>)> {
    let mut numbers = Vec::new();
    for pose in poses() {
        let [x, y, z, w] = [pose.x_axis, pose.y_axis, pose.z_axis, pose.w_axis];
        let size = DVec3::new(6.0, 8.0, 7.0);
        for row in 0..3 {
            numbers.extend([y[row], x[row], -z[row], w[row], size[row]]);
        }
        numbers.extend([0.5, 9.0]);
    }
    let header = format!(
        "{{'descr': '<f8', 'fortran_order': False, 'shape': ({PHOTOS}, 17), }}{}\n",
        " ".repeat(50)
    );
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(floats(&numbers));
    vec![("poses_bounds.npy".into(), bytes)]
}
