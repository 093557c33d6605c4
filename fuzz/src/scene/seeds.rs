//! Small valid inputs.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat};
use impasto_scene::npy;

use super::capture::{Kind, files};

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

/// Target, name and bytes of every input.
pub fn seeds() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (target, kind, file) in CAPTURES {
        let found = files(kind).into_iter().find(|(name, _)| name == file);
        seeds.push((target, "whole", found.expect("a file of the capture").1));
    }
    for (which, name) in [(0, "pose"), (1, "intrinsics")] {
        let file = format!("train/{name}/1.txt");
        let found = files(Kind::NerfPlusPlus);
        let found = found.iter().find(|(name, _)| *name == file);
        let text = &found.expect("a file of the capture").1;
        seeds.push(("nerf_plus_plus", name, [&[which], &text[..]].concat()));
    }
    let floats = npy::encode(&[1.0, -2.5, 3.0, 0.0, 1e9, 7.0], 3, 2);
    seeds.push(("npy", "f4", floats));
    seeds.push(("npy", "f8", files(Kind::Llff).swap_remove(0).1));
    for (name, text) in camera_paths() {
        seeds.push(("camera_path", name, text.into_bytes()));
    }
    for (name, bytes) in pictures() {
        seeds.push(("picture", name, bytes));
    }
    seeds
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
