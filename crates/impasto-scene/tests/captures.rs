//! Hand-made captures of every supported form load to what they say.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use common::*;
use glam::{DMat4, DVec3};
use impasto_scene::builtin::{self, BuiltinOptions, write_capture};
use impasto_scene::{
    Camera, Distortion, Format, LoadOptions, MaskUse, Scene, Split, detect, load,
    nerf_plus_plus_path, npy,
};
use serde_json::json;

const WHOLE: LoadOptions = LoadOptions {
    downscale: 1,
    format: None,
    masks: MaskUse::Ignore,
    train_photos: None,
};

/// Every photo's camera, taken back to the capture, is the one that was written.
fn assert_cameras(scene: &Scene, expected: &[Camera]) {
    assert_eq!(scene.photos.len(), expected.len());
    for (photo, camera) in scene.photos.iter().zip(expected) {
        let pose = scene
            .normalisation
            .pose_to_capture(photo.camera.camera_to_world);
        assert!(
            pose.abs_diff_eq(camera.camera_to_world, 1e-6),
            "{}",
            photo.name
        );
        let (a, b) = (photo.camera.intrinsics, camera.intrinsics);
        assert_eq!((a.width, a.height), (b.width, b.height));
        for (a, b) in [
            (a.fl_x, b.fl_x),
            (a.fl_y, b.fl_y),
            (a.cx, b.cx),
            (a.cy, b.cy),
        ] {
            assert!((a - b).abs() < 1e-6, "{}: {a} is not {b}", photo.name);
        }
        assert_eq!(a.distortion, b.distortion);
    }
}

fn assert_points_reproject(scene: &Scene, within: f64) {
    assert!(!scene.points.is_empty());
    for point in &scene.points {
        assert!(!point.seen_by.is_empty());
        for seen in &point.seen_by {
            let (pixel, _) = scene.photos[seen.photo]
                .camera
                .project(point.position)
                .expect("in front");
            assert!(
                pixel.distance(seen.pixel) < within,
                "{pixel} is not {}",
                seen.pixel
            );
        }
    }
}

fn bent_ring() -> Vec<Camera> {
    let mut cameras = full_ring();
    for camera in &mut cameras {
        camera.intrinsics.distortion = Distortion {
            k1: 0.1,
            k2: -0.02,
            p1: 0.003,
            p2: -0.002,
        };
    }
    cameras
}

#[test]
fn colmap_binary_with_distortion() {
    let dir = tempfile::tempdir().unwrap();
    let cameras = bent_ring();
    write_colmap(dir.path(), &colmap_bin(&cameras, &points()), 10);
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_eq!(scene.format, Format::Colmap);
    assert_cameras(&scene, &cameras);
    assert_points_reproject(&scene, 1e-6);
    assert_eq!(scene.points[0].colour, [10, 20, 30]);
    assert_eq!(scene.photos[3].pixels, picture(60, 40));
    let test: Vec<usize> = scene.test().map(|(index, _)| index).collect();
    assert_eq!(test, [0, 8]);
    assert_eq!(scene.train().count(), 8);
    assert_eq!(scene.cameras(Split::Test)[1], scene.photos[8].camera);
}

#[test]
fn colmap_text_of_every_supported_lens() {
    let plain = full_ring();
    let with = |k1: f64, k2: f64, same_focal: bool| -> Vec<Camera> {
        let mut cameras = plain.clone();
        for camera in &mut cameras {
            camera.intrinsics.distortion.k1 = k1;
            camera.intrinsics.distortion.k2 = k2;
            if same_focal {
                camera.intrinsics.fl_y = camera.intrinsics.fl_x;
            }
        }
        cameras
    };
    for (line, cameras) in [
        ("7 SIMPLE_PINHOLE 60 40 50 31 18", with(0.0, 0.0, true)),
        ("7 PINHOLE 60 40 50 51 31 18", plain.clone()),
        ("7 SIMPLE_RADIAL 60 40 50 31 18 0.1", with(0.1, 0.0, true)),
        ("7 RADIAL 60 40 50 31 18 0.1 -0.03", with(0.1, -0.03, true)),
        (
            "7 OPENCV 60 40 50 51 31 18 0.1 -0.02 0.003 -0.002",
            bent_ring(),
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let files =
            colmap_txt(line, &cameras, &points()).map(|(name, text)| (name, text.into_bytes()));
        write_colmap(dir.path(), &files, 10);
        let scene = load(dir.path(), &WHOLE).unwrap();
        assert_cameras(&scene, &cameras);
        assert_points_reproject(&scene, 1e-6);
    }
}

#[test]
fn colmap_without_points_or_features_and_files_at_the_top() {
    let dir = tempfile::tempdir().unwrap();
    let cameras = full_ring();
    let [lens, images, _] = colmap_txt("7 PINHOLE 60 40 50 51 31 18", &cameras, &[]);
    fs::create_dir(dir.path().join("images")).unwrap();
    for (name, text) in [lens, images] {
        fs::write(dir.path().join(name), text).unwrap();
    }
    for index in 0..10 {
        picture(60, 40)
            .save(dir.path().join("images").join(photo_name(index)))
            .unwrap();
    }
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_cameras(&scene, &cameras);
    assert!(scene.points.is_empty());
}

#[test]
fn a_thinned_colmap_model_keeps_the_points_of_the_images_left() {
    let dir = tempfile::tempdir().unwrap();
    let cameras = full_ring();
    let [lens, images, points3d] = colmap_txt("7 PINHOLE 60 40 50 51 31 18", &cameras, &points());
    let thinned: Vec<&str> = images.1.lines().take(1 + 2 * 6).collect();
    let files =
        [lens, ("images.txt", thinned.join("\n")), points3d].map(|(n, t)| (n, t.into_bytes()));
    write_colmap(dir.path(), &files, 6);
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_eq!(scene.photos.len(), 6);
    assert_points_reproject(&scene, 1e-6);
}

#[test]
fn downscaling_scales_cameras_points_and_pixels() {
    let dir = tempfile::tempdir().unwrap();
    write_colmap(dir.path(), &colmap_bin(&bent_ring(), &points()), 10);
    let options = LoadOptions {
        downscale: 7,
        format: None,
        masks: MaskUse::Ignore,
        train_photos: None,
    };
    let scene = load(dir.path(), &options).unwrap();
    let photo = &scene.photos[0];
    assert_eq!(photo.pixels.dimensions(), (9, 6));
    assert_eq!(
        (
            photo.camera.intrinsics.width,
            photo.camera.intrinsics.height
        ),
        (9, 6)
    );
    assert!((photo.camera.intrinsics.fl_x - 50.0 * 9.0 / 60.0).abs() < 1e-9);
    assert_points_reproject(&scene, 1e-6);
}

#[test]
fn fewer_training_photos_leave_the_held_out_ones_and_their_points() {
    let dir = tempfile::tempdir().unwrap();
    write_colmap(dir.path(), &colmap_bin(&bent_ring(), &points()), 10);
    let names = |scene: &Scene, split| -> Vec<String> {
        let photos = scene.photos.iter().filter(|p| p.split == split);
        photos.map(|photo| photo.name.clone()).collect()
    };
    let whole = load(dir.path(), &WHOLE).unwrap();
    let (all, held_out) = (names(&whole, Split::Train), names(&whole, Split::Test));
    assert_eq!((all.len(), held_out.len()), (8, 2));
    for (count, kept) in [
        (4, vec![0, 2, 4, 6]),
        (1, vec![3]),
        (8, (0..8).collect()),
        (99, (0..8).collect()),
    ] {
        let options = LoadOptions {
            train_photos: Some(count),
            ..WHOLE
        };
        let scene = load(dir.path(), &options).unwrap();
        let kept: Vec<String> = kept.iter().map(|i: &usize| all[*i].clone()).collect();
        assert_eq!(names(&scene, Split::Train), kept, "{count}");
        assert_eq!(names(&scene, Split::Test), held_out, "{count}");
        assert_points_reproject(&scene, 1e-6);
    }
}

fn global_lens() -> serde_json::Value {
    json!({ "fl_x": 50.0, "fl_y": 51.0, "cx": 31.0, "cy": 18.0, "w": 60.0, "h": 40 })
}

fn names(folder: &str, count: usize) -> Vec<String> {
    (0..count).map(|i| format!("{folder}/{i:02}.png")).collect()
}

fn as_strs(names: &[String]) -> Vec<&str> {
    names.iter().map(String::as_str).collect()
}

#[test]
fn instant_ngp_with_distortion_and_photos_of_half_the_size() {
    let dir = tempfile::tempdir().unwrap();
    let cameras = bent_ring();
    let names = names("images", 10);
    let mut json = json!({ "fl_x": 100.0, "fl_y": 102.0, "cx": 62.0, "cy": 36.0, "w": 120, "h": 80,
        "camera_angle_x": 1.0, "aabb_scale": 16, "k1": 0.1, "k2": -0.02, "p1": 0.003, "p2": -0.002 });
    // Out of order, as colmap2nerf leaves them.
    let frames = names
        .iter()
        .zip(&cameras)
        .rev()
        .map(|(n, c)| transforms_frame(&format!("./{n}"), c));
    json["frames"] = frames.collect();
    write_transforms(dir.path(), "transforms.json", &json, &as_strs(&names));
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_eq!(scene.format, Format::Transforms);
    assert_cameras(&scene, &cameras);
    assert_eq!(scene.photos[0].name, "images/00.png");
    assert!(!scene.synthetic);
    // The file itself may be named instead of its folder.
    assert_cameras(
        &load(&dir.path().join("transforms.json"), &WHOLE).unwrap(),
        &cameras,
    );
}

#[test]
fn nerfstudio_with_lenses_of_frames_and_named_splits() {
    let dir = tempfile::tempdir().unwrap();
    let mut cameras = full_ring();
    cameras[4].intrinsics.fl_x = 70.0;
    cameras[4].intrinsics.fl_y = 70.0;
    let names = names("images", 10);
    let mut json = global_lens();
    json["camera_model"] = json!("OPENCV");
    json["k3"] = json!(0.0);
    json["synthetic"] = json!(true);
    let mut frames: Vec<_> = names
        .iter()
        .zip(&cameras)
        .map(|(n, c)| transforms_frame(n, c))
        .collect();
    frames[4]["fl_x"] = json!(70.0);
    json["frames"] = json!(frames);
    json["train_filenames"] = json!(names[..7]);
    json["val_filenames"] = json!(names[7..9]);
    json["test_filenames"] = json!([]);
    write_transforms(dir.path(), "transforms.json", &json, &as_strs(&names));
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_cameras(&scene, &cameras[..9]);
    assert!(scene.synthetic);
    let test: Vec<&str> = scene.test().map(|(_, photo)| photo.name.as_str()).collect();
    assert_eq!(test, ["images/07.png", "images/08.png"]);
}

#[test]
fn blender_with_two_files_an_angle_and_no_endings() {
    let dir = tempfile::tempdir().unwrap();
    let mut cameras = full_ring();
    let focal = 30.0 / (0.5f64 * 0.69).tan();
    for camera in &mut cameras {
        let k = &mut camera.intrinsics;
        (k.fl_x, k.fl_y, k.cx, k.cy) = (focal, focal, 30.0, 20.0);
    }
    for (split, range) in [("test", 0..3), ("train", 3..10)] {
        let names = names(split, 10);
        let frames = range
            .clone()
            .map(|i| transforms_frame(&format!("./{split}/{i:02}"), &cameras[i]));
        let json = json!({ "camera_angle_x": 0.69, "frames": frames.collect::<Vec<_>>() });
        write_transforms(
            dir.path(),
            &format!("transforms_{split}.json"),
            &json,
            &as_strs(&names[range]),
        );
    }
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_cameras(&scene, &cameras);
    assert_eq!(scene.test().count(), 3);
    assert_eq!(scene.train().count(), 7);
}

/// A matrix as NeRF++ writes it: row by row.
fn text_matrix(matrix: DMat4) -> String {
    let rows = matrix.transpose().to_cols_array();
    rows.map(|x| x.to_string()).join(" ")
}

/// Writes views as NeRF++ folders.
fn write_nerf_plus_plus(folder: &Path, cameras: &[Camera]) {
    for part in ["pose", "intrinsics", "rgb"] {
        fs::create_dir_all(folder.join(part)).unwrap();
    }
    for (i, camera) in cameras.iter().enumerate() {
        let k = camera.intrinsics;
        let lens = DMat4::from_cols_array(&[
            k.fl_x, 0.0, 0.0, 0.0, 0.0, k.fl_y, 0.0, 0.0, k.cx, k.cy, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        ]);
        let text = format!("{i:05}.txt");
        fs::write(
            folder.join("pose").join(&text),
            text_matrix(camera.camera_to_world),
        )
        .unwrap();
        fs::write(folder.join("intrinsics").join(&text), text_matrix(lens)).unwrap();
        let photo = folder.join("rgb").join(format!("{i:05}.png"));
        picture(k.width, k.height).save(photo).unwrap();
    }
}

#[test]
fn nerf_plus_plus_folders_with_a_camera_path() {
    let dir = tempfile::tempdir().unwrap();
    let cameras = full_ring();
    write_nerf_plus_plus(&dir.path().join("test"), &cameras[..3]);
    write_nerf_plus_plus(&dir.path().join("train"), &cameras[3..]);
    write_nerf_plus_plus(&dir.path().join("validation"), &cameras[..2]);
    // Without photos.
    write_nerf_plus_plus(&dir.path().join("camera_path"), &cameras);
    fs::remove_dir_all(dir.path().join("camera_path/rgb")).unwrap();
    let path = nerf_plus_plus_path(&dir.path().join("camera_path")).unwrap();
    assert_eq!(path.len(), 10);
    assert!(
        path[4]
            .camera_to_world
            .abs_diff_eq(cameras[4].camera_to_world, 1e-9)
    );
    // The axis meets the hand-made photos at 31, 18.
    assert_eq!(
        (path[4].intrinsics.width, path[4].intrinsics.height),
        (62, 36)
    );
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_eq!(scene.format, Format::NerfPlusPlus);
    assert_cameras(&scene, &cameras);
    assert_eq!(scene.test().count(), 3);
    assert_eq!(scene.photos[3].name, "train/rgb/00000.png");
    // Without a test folder, `validation` is held out.
    fs::remove_dir_all(dir.path().join("test")).unwrap();
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_eq!((scene.test().count(), scene.train().count()), (2, 7));
}

/// `poses_bounds.npy` of cameras whose photos are of `size`.
fn poses_bounds(cameras: &[Camera], size: (u32, u32)) -> Vec<u8> {
    let mut numbers = Vec::new();
    for camera in cameras {
        let m = camera.camera_to_world;
        let lens = [f64::from(size.1), f64::from(size.0), camera.intrinsics.fl_x];
        for (row, lens) in lens.iter().enumerate() {
            let columns = [
                m.y_axis[row],
                m.x_axis[row],
                -m.z_axis[row],
                m.w_axis[row],
                *lens,
            ];
            numbers.extend(columns.map(|x| x as f32));
        }
        numbers.extend([0.1, 9.0]);
    }
    npy::encode(&numbers, 17, cameras.len() as u32)
}

#[test]
fn llff_with_photos_of_half_the_size() {
    let dir = tempfile::tempdir().unwrap();
    let mut cameras = full_ring();
    for camera in &mut cameras {
        let k = &mut camera.intrinsics;
        (k.fl_y, k.cx, k.cy) = (k.fl_x, 30.0, 20.0);
    }
    let mut stated = cameras.clone();
    stated.iter_mut().for_each(|c| c.intrinsics.fl_x *= 2.0);
    fs::write(
        dir.path().join("poses_bounds.npy"),
        poses_bounds(&stated, (120, 80)),
    )
    .unwrap();
    let photos = dir.path().join("images_2");
    fs::create_dir(&photos).unwrap();
    for i in 0..10 {
        picture(60, 40)
            .save(photos.join(format!("{i:03}.JPG.png")))
            .unwrap();
    }
    fs::write(photos.join("Thumbs.db"), "no photo").unwrap();
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_eq!(scene.format, Format::Llff);
    assert_cameras(&scene, &cameras);
    assert_eq!(scene.test().count(), 2);
}

#[test]
fn the_format_can_be_forced_where_both_are_present() {
    let dir = tempfile::tempdir().unwrap();
    write_colmap(dir.path(), &colmap_bin(&full_ring(), &points()), 10);
    let mut json = global_lens();
    let two = ring(2, 0.5 * TAU, DVec3::ZERO);
    json["frames"] = json!([
        transforms_frame("a.png", &two[0]),
        transforms_frame("b.png", &two[1])
    ]);
    write_transforms(dir.path(), "transforms.json", &json, &["a.png", "b.png"]);
    assert_eq!(detect(dir.path()).unwrap(), Format::Colmap);
    let options = LoadOptions {
        downscale: 1,
        format: Some(Format::Transforms),
        masks: MaskUse::Ignore,
        train_photos: None,
    };
    assert_eq!(load(dir.path(), &options).unwrap().photos.len(), 2);
}

#[test]
fn the_built_in_scene_is_a_capture_like_any_other() {
    let dir = tempfile::tempdir().unwrap();
    let options = BuiltinOptions {
        photos: 9,
        width: 24,
        height: 16,
        ..BuiltinOptions::default()
    };
    write_capture(dir.path(), &options).unwrap();
    let scene = load(dir.path(), &WHOLE).unwrap();
    assert_cameras(&scene, &builtin::cameras(&options));
    assert_eq!(scene.test().count(), 2);
}
