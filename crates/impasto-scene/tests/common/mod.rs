//! Captures written by hand, for the readers' tests.
#![allow(dead_code, reason = "each test file uses its own part")]
#![allow(clippy::print_stdout, reason = "a skipped test says so")]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use std::f64::consts::TAU;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use image::{Rgb, RgbImage};
use impasto_scene::{Camera, Distortion, Intrinsics};

/// The data beside the repository, or `None` (with a printed reason) where it is absent.
pub fn shared(below: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared")
        .join(below);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}

/// A photo whose pixels tell their place.
pub fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb([(x * 5) as u8, (y * 5) as u8, ((x + y) * 3) as u8])
    })
}

/// A camera at `centre` that looks at `target`; y of the world is down.
pub fn camera(centre: DVec3, target: DVec3, size: (u32, u32)) -> Camera {
    let z = (target - centre).normalize_or_zero();
    let x = z.cross(-DVec3::Y).normalize_or_zero();
    let rotation = DMat3::from_cols(x, z.cross(x), z);
    Camera {
        intrinsics: Intrinsics {
            width: size.0,
            height: size.1,
            fl_x: 50.0,
            fl_y: 51.0,
            cx: 0.5 * f64::from(size.0) + 1.0,
            cy: 0.5 * f64::from(size.1) - 2.0,
            distortion: Distortion::default(),
        },
        camera_to_world: DMat4::from_mat3(rotation).with_translation(centre),
    }
}

trait WithTranslation {
    fn with_translation(self, to: DVec3) -> Self;
}

impl WithTranslation for DMat4 {
    fn with_translation(mut self, to: DVec3) -> Self {
        self.w_axis = to.extend(1.0);
        self
    }
}

/// `count` cameras on an arc of `arc` radians of a circle of radius 3 around `target`, one unit
/// above it.
pub fn ring(count: usize, arc: f64, target: DVec3) -> Vec<Camera> {
    (0..count)
        .map(|i| {
            let angle = arc * i as f64 / count as f64;
            let arm = DVec3::new(3.0 * angle.cos(), -1.0, 3.0 * angle.sin());
            camera(target + arm, target, (60, 40))
        })
        .collect()
}

/// Ten cameras all around.
pub fn full_ring() -> Vec<Camera> {
    ring(10, TAU, DVec3::new(5.0, 6.0, 7.0))
}

/// Points that all cameras of [`full_ring`] see.
pub fn points() -> Vec<DVec3> {
    (0..7)
        .map(|i| {
            DVec3::new(
                5.0 + 0.1 * f64::from(i),
                6.0 - 0.05 * f64::from(i),
                7.0 + 0.03 * f64::from(i * i),
            )
        })
        .collect()
}

/// World-to-camera quaternion (w, x, y, z) and translation.
fn inverse(camera: &Camera) -> ([f64; 4], [f64; 3]) {
    let world_to_camera = camera.camera_to_world.inverse();
    let q = DQuat::from_mat4(&world_to_camera);
    (
        [q.w, q.x, q.y, q.z],
        world_to_camera.w_axis.truncate().to_array(),
    )
}

/// Where `camera` sees the points.
fn features(camera: &Camera, points: &[DVec3]) -> Vec<DVec2> {
    points
        .iter()
        .map(|&p| camera.project(p).expect("in front").0)
        .collect()
}

/// The three binary files of a COLMAP model, by name: one OPENCV camera (number 7), images `1..`
/// in *reverse* order of name, points seen by every image.
pub fn colmap_bin(cameras: &[Camera], points: &[DVec3]) -> [(&'static str, Vec<u8>); 3] {
    let mut lens = Vec::new();
    let k = cameras[0].intrinsics;
    lens.extend(1u64.to_le_bytes());
    lens.extend(7u32.to_le_bytes());
    lens.extend(4u32.to_le_bytes());
    lens.extend(u64::from(k.width).to_le_bytes());
    lens.extend(u64::from(k.height).to_le_bytes());
    let d = k.distortion;
    for x in [k.fl_x, k.fl_y, k.cx, k.cy, d.k1, d.k2, d.p1, d.p2] {
        lens.extend(x.to_le_bytes());
    }
    let mut images = (cameras.len() as u64).to_le_bytes().to_vec();
    for (index, camera) in cameras.iter().enumerate().rev() {
        let (q, t) = inverse(camera);
        images.extend((index as u32 + 1).to_le_bytes());
        images.extend(q.iter().chain(&t).flat_map(|x| x.to_le_bytes()));
        images.extend(7u32.to_le_bytes());
        images.extend(photo_name(index).as_bytes());
        images.push(0);
        images.extend((points.len() as u64).to_le_bytes());
        for (point, pixel) in features(camera, points).iter().enumerate() {
            images.extend(pixel.x.to_le_bytes());
            images.extend(pixel.y.to_le_bytes());
            images.extend((point as u64).to_le_bytes());
        }
    }
    let mut cloud = (points.len() as u64).to_le_bytes().to_vec();
    for (index, point) in points.iter().enumerate() {
        cloud.extend((index as u64).to_le_bytes());
        cloud.extend(point.to_array().iter().flat_map(|x| x.to_le_bytes()));
        cloud.extend([10, 20, 30]);
        cloud.extend(0.25f64.to_le_bytes());
        cloud.extend((cameras.len() as u64).to_le_bytes());
        for image in 1..=cameras.len() as u32 {
            cloud.extend(image.to_le_bytes());
            cloud.extend((index as u32).to_le_bytes());
        }
    }
    [
        ("cameras.bin", lens),
        ("images.bin", images),
        ("points3D.bin", cloud),
    ]
}

/// The same model as text, with the camera line given.
pub fn colmap_txt(
    camera_line: &str,
    cameras: &[Camera],
    points: &[DVec3],
) -> [(&'static str, String); 3] {
    let lens = format!("# Camera list\n{camera_line}\n");
    let mut images = String::from("# Image list\n");
    let mut cloud = String::from("# Points\n");
    for (index, camera) in cameras.iter().enumerate() {
        let (q, t) = inverse(camera);
        let numbers: Vec<String> = q.iter().chain(&t).map(f64::to_string).collect();
        writeln!(
            images,
            "{} {} 7 {}",
            index + 1,
            numbers.join(" "),
            photo_name(index)
        )
        .unwrap();
        for (point, pixel) in features(camera, points).iter().enumerate() {
            write!(images, "{} {} {point} ", pixel.x, pixel.y).unwrap();
        }
        images.push('\n');
    }
    for (index, p) in points.iter().enumerate() {
        write!(cloud, "{index} {} {} {} 10 20 30 0.25", p.x, p.y, p.z).unwrap();
        for image in 1..=cameras.len() {
            write!(cloud, " {image} {index}").unwrap();
        }
        cloud.push('\n');
    }
    [
        ("cameras.txt", lens),
        ("images.txt", images),
        ("points3D.txt", cloud),
    ]
}

/// Name of the hand-made photo `index`; it has a space, which COLMAP allows.
pub fn photo_name(index: usize) -> String {
    format!("view {index:02}.png")
}

/// Writes a COLMAP capture with photos of 60×40 pixels to `dir`.
pub fn write_colmap(dir: &Path, files: &[(&str, Vec<u8>)], photos: usize) {
    let model = dir.join("sparse/0");
    fs::create_dir_all(&model).unwrap();
    fs::create_dir_all(dir.join("images")).unwrap();
    for (name, bytes) in files {
        fs::write(model.join(name), bytes).unwrap();
    }
    for index in 0..photos {
        picture(60, 40)
            .save(dir.join("images").join(photo_name(index)))
            .unwrap();
    }
}

/// A frame of transforms.json for a camera in our axes.
pub fn transforms_frame(file_path: &str, camera: &Camera) -> serde_json::Value {
    let opengl = camera.camera_to_world * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
    serde_json::json!({
        "file_path": file_path,
        "transform_matrix": opengl.transpose().to_cols_array_2d(),
    })
}

/// Writes a JSON file and a 60×40 PNG for each name.
pub fn write_transforms(dir: &Path, file: &str, json: &serde_json::Value, photos: &[&str]) {
    fs::write(dir.join(file), json.to_string()).unwrap();
    for name in photos {
        let path = dir.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        picture(60, 40).save(path).unwrap();
    }
}
