//! What captures may claim about their photos, and what is done with it.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::fs;
use std::path::Path;

use common::*;
use glam::DVec3;
use image::{GrayImage, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use impasto_scene::{LoadOptions, MaskUse, Scene, load};
use serde_json::{Value, json};

const NAMES: [&str; 4] = [
    "images/a.png",
    "images/b.png",
    "images/c.png",
    "images/d.png",
];

/// A transforms.json of four photos of 60×40 pixels, after `change`.
fn capture(dir: &Path, change: impl Fn(&mut Value)) {
    let cameras = full_ring();
    let frames: Vec<Value> = NAMES
        .iter()
        .zip(&cameras)
        .map(|(n, c)| transforms_frame(n, c))
        .collect();
    let mut json = json!({ "fl_x": 50.0, "w": 60, "h": 40, "frames": frames });
    change(&mut json);
    write_transforms(dir, "transforms.json", &json, &NAMES);
}

fn loaded(dir: &Path, masks: MaskUse, downscale: u32) -> Result<Scene, String> {
    let options = LoadOptions {
        masks,
        downscale,
        ..LoadOptions::default()
    };
    load(dir, &options).map_err(|e| e.to_string())
}

#[track_caller]
fn refused(dir: &Path, parts: &[&str]) {
    let said = loaded(dir, MaskUse::Ignore, 1).expect_err("must be refused");
    for part in parts {
        assert!(said.contains(part), "\"{part}\" is not in: {said}");
    }
    assert!(!said.contains('\n'), "{said}");
}

#[test]
fn names_that_leave_the_capture_are_refused() {
    for name in [
        "../../etc/x.png",
        "/etc/x.png",
        "..\\x.png",
        "images/../../x.png",
        "a\0.png",
        "C:\\x.png",
    ] {
        let dir = tempfile::tempdir().unwrap();
        let capture_dir = dir.path().join("capture");
        fs::create_dir(&capture_dir).unwrap();
        picture(60, 40).save(dir.path().join("x.png")).unwrap();
        capture(&capture_dir, |json| {
            json["frames"][1]["file_path"] = json!(name);
        });
        refused(&capture_dir, &["transforms.json"]);
        capture(&capture_dir, |json| {
            json["frames"][1]["mask_path"] = json!(name);
        });
        refused(&capture_dir, &["transforms.json"]);
        // One folder deeper: relative names are below `images`.
        let name = match name.contains("..") {
            true => format!("../{name}"),
            false => name.to_owned(),
        };
        let files = colmap_txt(
            "7 PINHOLE 60 40 50 51 31 18",
            &full_ring()[..3],
            &points()[..2],
        );
        let files = files.map(|(f, text)| (f, text.replace("view 01.png", &name).into_bytes()));
        let other = dir.path().join("colmap");
        write_colmap(&other, &files, 3);
        refused(&other, &["images.txt"]);
    }
}

#[test]
fn names_inside_the_capture_may_be_written_in_any_way() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), |json| {
        json["frames"][0]["file_path"] = json!("./images/a.png");
        json["frames"][1]["file_path"] = json!("images/../images/b");
        json["frames"][2]["file_path"] = json!("images\\c.png");
        json["frames"][3]["file_path"] = json!(dir.path().join("images/d.png"));
    });
    assert_eq!(
        loaded(dir.path(), MaskUse::Ignore, 1).unwrap().photos.len(),
        4
    );
}

#[cfg(unix)]
#[test]
fn a_linked_folder_of_photos_is_followed() {
    let dir = tempfile::tempdir().unwrap();
    let (here, there) = (dir.path().join("here"), dir.path().join("there"));
    fs::create_dir(&here).unwrap();
    capture(&here, |_| {});
    fs::rename(here.join("images"), &there).unwrap();
    std::os::unix::fs::symlink(&there, here.join("images")).unwrap();
    assert_eq!(loaded(&here, MaskUse::Ignore, 1).unwrap().photos.len(), 4);
}

#[test]
fn one_photo_twice_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["images/a.png", "./images/a", "images/../images/a.png"] {
        capture(dir.path(), |json| {
            json["frames"][2]["file_path"] = json!(name);
        });
        refused(dir.path(), &["images/a.png", "same photo", "keep one"]);
    }
}

#[test]
fn lenses_that_no_camera_has_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for (key, value, parts) in [
        ("fl_x", 0.5, ["focal length of 0.5", "60×40"]),
        ("fl_x", 1e9, ["focal length", "60×40"]),
        ("cx", 3000.0, ["principal point (3000, 20)", "far outside"]),
        ("cy", -90.0, ["principal point (30, -90)", "far outside"]),
    ] {
        capture(dir.path(), |json| json[key] = json!(value));
        refused(dir.path(), &parts);
    }
}

#[test]
fn a_camera_far_out_is_warned_of() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), |_| {});
    assert_eq!(
        loaded(dir.path(), MaskUse::Ignore, 1).unwrap().warnings,
        [""; 0]
    );
    capture(dir.path(), |json| {
        json["frames"][2]["transform_matrix"][0][3] = json!(900.0);
    });
    let warnings = loaded(dir.path(), MaskUse::Ignore, 1).unwrap().warnings;
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].contains("images/c.png") && warnings[0].contains("remove the frame"));
}

/// A fixture that is stored as 16×32 pixels and turned by its EXIF data to be 32×16.
fn turned_capture(dir: &Path, size: (u32, u32)) {
    capture(dir, |json| {
        json["w"] = json!(size.0);
        json["h"] = json!(size.1);
    });
    for name in NAMES {
        let turned = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/orientation_6.jpg");
        fs::copy(turned, dir.join(name)).unwrap();
    }
}

#[test]
fn photos_are_turned_only_where_they_would_not_fit_otherwise() {
    let dir = tempfile::tempdir().unwrap();
    let upper_left = |size| {
        turned_capture(dir.path(), size);
        let scene = loaded(dir.path(), MaskUse::Ignore, 1).unwrap();
        let pixels = &scene.photos[0].pixels;
        (pixels.dimensions(), pixels.get_pixel(2, 2).0)
    };
    let near = |found: [u8; 3], colour: [i32; 3]| {
        found
            .iter()
            .zip(colour)
            .all(|(a, b)| (i32::from(*a) - b).abs() <= 4)
    };
    let (size, colour) = upper_left((32, 16));
    assert!(
        size == (32, 16) && near(colour, [220, 30, 40]),
        "{colour:?}"
    );
    // Stored: turned by a quarter to the left, so that its upper right corner is upper left.
    let (size, colour) = upper_left((16, 32));
    assert!(
        size == (16, 32) && near(colour, [40, 180, 60]),
        "{colour:?}"
    );
    turned_capture(dir.path(), (50, 20));
    refused(dir.path(), &["16×32", "50×20"]);
}

/// White but for the left third.
fn mask(width: u32, height: u32) -> GrayImage {
    GrayImage::from_fn(width, height, |x, _| {
        Luma([if x < width / 3 { 0 } else { 255 }])
    })
}

fn masked(dir: &Path, name: &str) {
    capture(dir, |_| {});
    fs::create_dir_all(dir.join("masks")).unwrap();
    mask(60, 40).save(dir.join(name)).unwrap();
}

fn hidden(scene: &Scene, photo: usize) -> usize {
    let photo = &scene.photos[photo];
    let pixels = (photo.pixels.width() * photo.pixels.height()) as usize;
    assert!(photo.mask.as_ref().is_none_or(|mask| mask.len() == pixels));
    (0..pixels).filter(|pixel| !photo.is_used(*pixel)).count()
}

#[test]
fn masks_are_found_by_name() {
    for name in [
        "masks/b.png",
        "masks/b.png.png",
        "masks/b.tiff",
        "masks/b.WEBP",
    ] {
        let dir = tempfile::tempdir().unwrap();
        capture(dir.path(), |_| {});
        fs::create_dir(dir.path().join("masks")).unwrap();
        let file = fs::File::create(dir.path().join(name)).unwrap();
        let format = image::ImageFormat::from_path(name).unwrap();
        mask(60, 40)
            .write_to(&mut std::io::BufWriter::new(file), format)
            .unwrap();
        let scene = loaded(dir.path(), MaskUse::Ignore, 1).unwrap();
        assert_eq!(
            [0, 1, 2, 3].map(|i| hidden(&scene, i)),
            [0, 800, 0, 0],
            "{name}"
        );
        assert!(scene.photos[0].mask.is_none());
        assert_eq!(scene.warnings, [""; 0]);
        assert!(
            loaded(dir.path(), MaskUse::Off, 1).unwrap().photos[1]
                .mask
                .is_none()
        );
    }
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), |json| {
        json["frames"][2]["mask_path"] = json!("other/hide.png");
    });
    refused(
        dir.path(),
        &["images/c.png", "no mask", "hide.png", "mask_path"],
    );
    fs::create_dir(dir.path().join("other")).unwrap();
    mask(60, 40)
        .save(dir.path().join("other/hide.png"))
        .unwrap();
    let scene = loaded(dir.path(), MaskUse::Ignore, 1).unwrap();
    assert_eq!([0, 1, 2, 3].map(|i| hidden(&scene, i)), [0, 0, 800, 0]);
}

#[test]
fn a_mask_of_nobody_is_warned_of() {
    let dir = tempfile::tempdir().unwrap();
    masked(dir.path(), "masks/lost.png");
    let warnings = loaded(dir.path(), MaskUse::Ignore, 1).unwrap().warnings;
    assert!(
        warnings.len() == 1 && warnings[0].contains("lost.png"),
        "{warnings:?}"
    );
    assert_eq!(
        loaded(dir.path(), MaskUse::Off, 1).unwrap().warnings,
        [""; 0]
    );
}

#[test]
fn masks_of_another_size_are_stretched_and_of_another_shape_refused() {
    let dir = tempfile::tempdir().unwrap();
    masked(dir.path(), "masks/a.png");
    for (width, height) in [(30, 20), (120, 80)] {
        mask(width, height)
            .save(dir.path().join("masks/a.png"))
            .unwrap();
        assert_eq!(
            hidden(&loaded(dir.path(), MaskUse::Ignore, 1).unwrap(), 0),
            800
        );
    }
    mask(40, 40).save(dir.path().join("masks/a.png")).unwrap();
    refused(dir.path(), &["masks/a.png", "40×40", "60×40", "shape"]);
    GrayImage::new(60, 40)
        .save(dir.path().join("masks/a.png"))
        .unwrap();
    refused(dir.path(), &["masks/a.png", "hides the whole photo"]);
    fs::write(dir.path().join("masks/a.png"), "none").unwrap();
    refused(dir.path(), &["masks/a.png", "not a usable mask"]);
}

#[test]
fn a_shrunk_pixel_is_used_where_all_of_it_is() {
    let dir = tempfile::tempdir().unwrap();
    masked(dir.path(), "masks/a.png");
    // 20 of 60 columns are hidden: of 20 columns of 3 the first 7, of which the last in part.
    let scene = loaded(dir.path(), MaskUse::Ignore, 3).unwrap();
    assert_eq!(hidden(&scene, 0), 7 * 13);
}

#[test]
fn transparency_counts_where_a_mask_has_any() {
    let dir = tempfile::tempdir().unwrap();
    masked(dir.path(), "masks/a.png");
    let path = dir.path().join("masks/a.png");
    let rgba = |alpha: fn(u32) -> u8, grey: fn(u32) -> u8| {
        let image = RgbaImage::from_fn(60, 40, |x, _| Rgba([grey(x), grey(x), grey(x), alpha(x)]));
        image.save(&path).unwrap();
        hidden(&loaded(dir.path(), MaskUse::Ignore, 1).unwrap(), 0)
    };
    let half = |x: u32| if x < 30 { 0 } else { 255 };
    assert_eq!(rgba(half, |_| 0), 1200);
    assert_eq!(rgba(|_| 255, half), 1200);
}

#[test]
fn transparent_masks_put_white_behind_the_photo() {
    let dir = tempfile::tempdir().unwrap();
    masked(dir.path(), "masks/a.png");
    let black = RgbImage::new(60, 40);
    black.save(dir.path().join("images/a.png")).unwrap();
    let photo = &loaded(dir.path(), MaskUse::Transparent, 1).unwrap().photos[0];
    assert!(photo.mask.is_none());
    let at = |x| *photo.pixels.get_pixel(x, 9);
    assert_eq!((at(19), at(20)), (Rgb([255; 3]), Rgb([0; 3])));
}

#[test]
fn a_photo_that_cannot_be_opened_is_not_missing() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), |_| {});
    let photo = dir.path().join(NAMES[1]);
    fs::remove_file(&photo).unwrap();
    refused(dir.path(), &["images/b.png", "missing", "remove the frame"]);
    fs::create_dir(&photo).unwrap();
    refused(dir.path(), &["images/b.png"]);
}

#[test]
fn cameras_at_one_spot_but_one_are_loaded() {
    let dir = tempfile::tempdir().unwrap();
    let mut cameras = full_ring();
    for camera in &mut cameras[1..4] {
        camera.camera_to_world.w_axis = DVec3::ONE.extend(1.0);
    }
    capture(dir.path(), |json| {
        for (i, camera) in cameras[..4].iter().enumerate() {
            json["frames"][i] = transforms_frame(NAMES[i], camera);
        }
    });
    assert_eq!(
        loaded(dir.path(), MaskUse::Ignore, 1).unwrap().warnings,
        [""; 0]
    );
}
