//! Sound inputs of every kind, to be spoiled.

use std::fs;
use std::path::Path;
use std::process::Command;

use image::{Rgb, RgbImage};
use impasto::scene::builtin::{BuiltinOptions, write_capture};
use impasto::scene::npy;
use serde_json::Value;

/// World-to-camera poses of three cameras side by side, as quaternion (w, x, y, z) and translation.
const COLMAP_IMAGES: &str =
    "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n3 1 0 0 0 0 1 0 1 c.png\n\n";
/// Camera-to-world, down, right, backward, centre, and height, width, focal length; then depths.
const LLFF_ROW: [f32; 17] = [
    0.0, 1.0, 0.0, 0.0, 40.0, 1.0, 0.0, 0.0, 0.0, 60.0, 0.0, 0.0, -1.0, 0.0, 50.0, 0.1, 9.0,
];

/// Writes `scene` (transforms.json), `colmap`, `nerf` (NeRF++), `llff`, `styles` and `views.json`.
pub fn make(folder: &Path) {
    let options = BuiltinOptions {
        photos: 8,
        width: 60,
        height: 40,
        ..BuiltinOptions::default()
    };
    write_capture(&folder.join("scene"), &options).unwrap();
    let colmap = folder.join("colmap");
    fs::create_dir_all(colmap.join("sparse/0")).unwrap();
    photos(&colmap.join("images"));
    write(
        &colmap,
        "sparse/0/cameras.txt",
        "1 PINHOLE 60 40 50 50 30 20\n",
    );
    write(&colmap, "sparse/0/images.txt", COLMAP_IMAGES);
    write(&colmap, "sparse/0/points3D.txt", "1 0 0 5 9 9 9 0.5\n");
    let nerf = folder.join("nerf/train");
    photos(&nerf.join("rgb"));
    for (i, name) in ["a", "b", "c"].into_iter().enumerate() {
        let pose = format!("1 0 0 {i} 0 1 0 0 0 0 1 0 0 0 0 1");
        write(&nerf, &format!("pose/{name}.txt"), &pose);
        let lens = "50 0 30 0 0 50 20 0 0 0 1 0 0 0 0 1";
        write(&nerf, &format!("intrinsics/{name}.txt"), lens);
    }
    let llff = folder.join("llff");
    photos(&llff.join("images"));
    let mut rows = [LLFF_ROW; 3].concat();
    (rows[3], rows[17 + 8]) = (1.0, 1.0);
    fs::write(llff.join("poses_bounds.npy"), npy::encode(&rows, 17, 3)).unwrap();
    fs::create_dir(folder.join("styles")).unwrap();
    photo().save(folder.join("styles/red.png")).unwrap();
    write(folder, "views.json", "{\"frames\": []}");
}

/// 60×40 pixels.
pub fn photo() -> RgbImage {
    RgbImage::from_fn(60, 40, |x, y| Rgb([200, (x * 3) as u8, (y * 4) as u8]))
}

fn photos(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    for name in ["a.png", "b.png", "c.png"] {
        photo().save(folder.join(name)).unwrap();
    }
}

/// Writes a file and the folders above it.
pub fn write(folder: &Path, name: &str, text: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// Replaces the first `from` in a text file, which must be there.
pub fn replace(folder: &Path, name: &str, from: &str, to: &str) {
    let path = folder.join(name);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{name} has no {from}");
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

/// Cuts a file in the middle.
pub fn cut(folder: &Path, name: &str) {
    let path = folder.join(name);
    let bytes = fs::read(&path).unwrap();
    fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

/// Changes the built-in capture's transforms.json.
pub fn transforms(folder: &Path, change: impl FnOnce(&mut Value)) {
    let path = folder.join("scene/transforms.json");
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut json);
    fs::write(path, json.to_string()).unwrap();
}

/// A pipe that nobody writes to, in the place of whatever is there.
pub fn pipe(folder: &Path, name: &str) {
    let path = folder.join(name);
    let _ = fs::remove_file(&path);
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// A link in the place of whatever is there.
pub fn link(folder: &Path, name: &str, to: &str) {
    let path = folder.join(name);
    let _ = fs::remove_file(&path);
    std::os::unix::fs::symlink(to, path).unwrap();
}

/// Copies a folder's contents.
pub fn copy(from: &Path, to: &Path) {
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            fs::create_dir(&target).unwrap();
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}
