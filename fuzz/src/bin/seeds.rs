//! Writes small valid inputs for every target: `seeds FOLDER` fills `FOLDER/TARGET/`.

#[path = "../../../crates/impasto-style/tests/torch_files/mod.rs"]
mod torch_files;

use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageFormat};
use impasto_fuzz::{Kind, files, write_f16};
use impasto_scene::npy;
use torch_files::{Saved, stream_form, zip_form};

/// Targets whose input is a file of a capture.
const CAPTURES: [(&str, Kind, &str); 8] = [
    (
        "colmap_cameras_bin",
        Kind::ColmapBin,
        "sparse/0/cameras.bin",
    ),
    ("colmap_images_bin", Kind::ColmapBin, "sparse/0/images.bin"),
    (
        "colmap_points_bin",
        Kind::ColmapBin,
        "sparse/0/points3D.bin",
    ),
    (
        "colmap_cameras_txt",
        Kind::ColmapTxt,
        "sparse/0/cameras.txt",
    ),
    ("colmap_images_txt", Kind::ColmapTxt, "sparse/0/images.txt"),
    (
        "colmap_points_txt",
        Kind::ColmapTxt,
        "sparse/0/points3D.txt",
    ),
    ("transforms", Kind::Transforms, "transforms.json"),
    ("llff", Kind::Llff, "poses_bounds.npy"),
];

fn main() {
    let folder = std::env::args_os().nth(1).expect("usage: seeds FOLDER");
    let folder = Path::new(&folder);
    let put = |target: &str, name: &str, bytes: &[u8]| {
        let into = folder.join(target);
        fs::create_dir_all(&into).expect("the folder is writable");
        fs::write(into.join(name), bytes).expect("the folder is writable");
    };
    for (target, kind, file) in CAPTURES {
        let found = files(kind).into_iter().find(|(name, _)| name == file);
        put(target, "whole", &found.expect("a file of the capture").1);
    }
    for (which, file) in [(0, "train/pose/1.txt"), (1, "train/intrinsics/1.txt")] {
        let all = files(Kind::NerfPlusPlus);
        let (_, text) = all.iter().find(|(name, _)| name == file).expect("there");
        put(
            "nerf_plus_plus",
            file.split('/').nth(1).expect("a folder"),
            &[&[which], &text[..]].concat(),
        );
    }
    put(
        "npy",
        "f4",
        &npy::encode(&[1.0, -2.5, 3.0, 0.0, 1e9, 7.0], 3, 2),
    );
    put("npy", "f8", &files(Kind::Llff)[0].1);
    for (name, text) in camera_paths() {
        put("camera_path", name, text.as_bytes());
    }
    for (name, bytes) in pictures() {
        put("picture", name, &bytes);
    }
    let tensors = tensors();
    put("checkpoint", "zip", &zip_form(&tensors, "archive"));
    put("checkpoint", "stream", &stream_form(&tensors));
    let flat: Vec<(&str, &[f32])> = [("mean", 4), ("scale", 4), ("gain", 2)]
        .map(|(name, length)| (name, &[0.5, 1.0, 2.0, -3.0][..length]))
        .into();
    let file = write_f16(&flat).expect("a safetensors file");
    put("checkpoint", "safetensors", &file);
    put("tensor_file", "safetensors", &file);
}

fn camera_paths() -> [(&'static str, String); 3] {
    let pose = "1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1";
    let other = "1,0,0,2, 0,1,0,1, 0,0,1,0, 0,0,0,1";
    [
        (
            "frames",
            r#"{"frames":[{"camera_to_world":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],"w":8,"h":6,"fl_x":7.0,"fl_y":7.5,"cx":4.0,"cy":3.0},{"camera_to_world":[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]],"w":8,"h":6,"fl_x":9.0,"fl_y":9.5,"cx":4.0,"cy":3.0}]}"#.to_owned(),
        ),
        (
            "camera_path",
            format!(r#"{{"render_width":8,"render_height":6,"camera_path":[{{"camera_to_world":[{pose}],"fov":50}},{{"camera_to_world":[{other}]}}]}}"#),
        ),
        (
            "keyframes",
            format!(r#"{{"fps":24,"seconds":0.5,"is_cycle":true,"render_width":8,"render_height":6,"keyframes":[{{"matrix":[{pose}],"fov":50}},{{"matrix":[{other}],"fov":40}}]}}"#),
        ),
    ]
}

/// One picture in every format and kind of pixel.
fn pictures() -> Vec<(&'static str, Vec<u8>)> {
    let colour = DynamicImage::ImageRgb8(image::RgbImage::from_fn(9, 7, |x, y| {
        image::Rgb([(x * 28) as u8, (y * 36) as u8, 90])
    }));
    let encoded = |picture: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).expect("an encoder");
        bytes.into_inner()
    };
    let alpha = DynamicImage::ImageRgba8(colour.to_rgba8());
    let deep = DynamicImage::ImageRgb16(colour.to_rgb16());
    let grey = DynamicImage::ImageLuma8(colour.to_luma8());
    let mut turned = encoded(&colour, ImageFormat::Jpeg);
    let exif =
        b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    turned.splice(2..2, exif.iter().copied());
    vec![
        ("png8", encoded(&colour, ImageFormat::Png)),
        ("png16", encoded(&deep, ImageFormat::Png)),
        ("png_alpha", encoded(&alpha, ImageFormat::Png)),
        ("png_grey", encoded(&grey, ImageFormat::Png)),
        ("jpeg", encoded(&colour, ImageFormat::Jpeg)),
        ("jpeg_grey", encoded(&grey, ImageFormat::Jpeg)),
        ("jpeg_exif", turned),
        ("gif", encoded(&alpha, ImageFormat::Gif)),
        ("webp", encoded(&alpha, ImageFormat::WebP)),
        ("tiff8", encoded(&colour, ImageFormat::Tiff)),
        ("tiff16", encoded(&deep, ImageFormat::Tiff)),
    ]
}

/// A few tensors of every kind of storage.
fn tensors() -> Vec<Saved> {
    let mut tensors = vec![
        Saved::new("0.weight", &[2, 3], vec![0.5; 6]),
        Saved::new("0.bias", &[2], vec![1.0, -1.0]),
        Saved::new("scale", &[], vec![2.0]),
    ];
    tensors[0].offset = 2;
    tensors[1].kind = "HalfStorage";
    tensors[2].kind = "DoubleStorage";
    tensors
}
