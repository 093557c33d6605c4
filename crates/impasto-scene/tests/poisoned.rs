//! Damaged captures are refused with a sentence that names the place.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::fs;
use std::path::Path;

use common::*;
use impasto_scene::{Format, LoadOptions, MaskUse, load, npy};
use serde_json::{Value, json};

/// The message that loading `path` fails with: one or two sentences on one line.
fn refusal(path: &Path) -> String {
    let message = load(path, &LoadOptions::default())
        .expect_err("must be refused")
        .to_string();
    assert!(!message.contains('\n'), "{message}");
    message
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "\"{part}\" is not in: {message}");
    }
}

#[test]
fn nothing_there() {
    let dir = tempfile::tempdir().unwrap();
    assert_says(
        &refusal(&dir.path().join("nowhere")),
        &["nowhere", "no such file or folder"],
    );
    assert_says(
        &refusal(dir.path()),
        &["folder is empty", "COLMAP", "transforms.json"],
    );
    picture(4, 4).save(dir.path().join("a.png")).unwrap();
    assert_says(
        &refusal(dir.path()),
        &["photos but no camera poses", "impasto prepare"],
    );
    assert_says(
        &refusal(&dir.path().join("a.png")),
        &["a.png", "not a capture"],
    );
    let forced = LoadOptions {
        downscale: 1,
        format: Some(Format::Colmap),
        masks: MaskUse::Ignore,
        train_photos: None,
    };
    assert_says(
        &load(dir.path(), &forced).unwrap_err().to_string(),
        &["\"colmap\"", "Supported"],
    );
    let none = LoadOptions {
        downscale: 0,
        format: None,
        masks: MaskUse::Ignore,
        train_photos: None,
    };
    assert_says(
        &load(dir.path(), &none).unwrap_err().to_string(),
        &["downscale", "at least 1"],
    );
}

#[test]
fn colmap_files_cut_at_every_byte() {
    let dir = tempfile::tempdir().unwrap();
    let files = colmap_bin(&full_ring()[..3], &points()[..2]);
    write_colmap(dir.path(), &files, 3);
    load(dir.path(), &LoadOptions::default()).unwrap();
    for (name, bytes) in &files {
        let path = dir.path().join("sparse/0").join(name);
        for length in 0..bytes.len() {
            fs::write(&path, &bytes[..length]).unwrap();
            assert_says(&refusal(dir.path()), &[name, "byte "]);
        }
        fs::write(&path, [bytes.as_slice(), &[0]].concat()).unwrap();
        assert_says(&refusal(dir.path()), &[name, "1 bytes follow"]);
        fs::write(&path, bytes).unwrap();
    }
}

#[test]
fn colmap_counts_beyond_the_file_allocate_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let files = colmap_bin(&full_ring()[..3], &points()[..2]);
    write_colmap(dir.path(), &files, 3);
    for (name, bytes) in &files {
        let path = dir.path().join("sparse/0").join(name);
        for count in [u64::MAX, 1 << 40, 1 << 20] {
            fs::write(&path, [&count.to_le_bytes(), &bytes[8..]].concat()).unwrap();
            assert_says(
                &refusal(dir.path()),
                &[name, "byte 0", &count.to_string(), "cut off or damaged"],
            );
        }
        fs::write(&path, bytes).unwrap();
    }
}

/// A COLMAP text capture of three photos with one substitution in one of its files.
fn colmap_with(file: &str, change: impl Fn(&str) -> String) -> String {
    let dir = tempfile::tempdir().unwrap();
    let files = colmap_txt(
        "7 PINHOLE 60 40 50 51 31 18",
        &full_ring()[..3],
        &points()[..2],
    );
    let files = files.map(|(name, text)| {
        let text = if name == file { change(&text) } else { text };
        (name, text.into_bytes())
    });
    write_colmap(dir.path(), &files, 3);
    refusal(dir.path())
}

/// Replaces word `index` of the line that begins with `1 `.
fn first_record(text: &str, index: usize, word: &str) -> String {
    let line = |line: &str| {
        if !line.starts_with("1 ") {
            return line.to_owned();
        }
        let mut words: Vec<&str> = line.split(' ').collect();
        words[index] = word;
        words.join(" ")
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

#[test]
fn colmap_text_with_wrong_contents() {
    let lens = |line: &'static str| colmap_with("cameras.txt", |_| line.to_owned());
    let fisheye = lens("7 OPENCV_FISHEYE 60 40 50 51 31 18 0 0 0 0");
    assert_says(
        &fisheye,
        &[
            "cameras.txt",
            "camera 7",
            "OPENCV_FISHEYE",
            "RADIAL",
            "image_undistorter",
        ],
    );
    assert_says(
        &lens("7 PINHOLE 60 40 50 51 31"),
        &["camera 7", "3 parameters", "PINHOLE"],
    );
    assert_says(
        &lens("7 PINHOLE 60 40 -50 51 31 18"),
        &["camera 7", "focal length must be positive, not -50"],
    );
    assert_says(&lens("7 PINHOLE 60 40 50 51 nan 18"), &["camera 7", "NaN"]);
    assert_says(
        &lens("7 PINHOLE 0 40 50 51 31 18"),
        &["camera 7", "image size"],
    );
    assert_says(
        &lens("# none\n8 PINHOLE 60 40 50 51 31 18"),
        &["view 00.png", "camera 7"],
    );
    assert_says(
        &lens("7 PINHOLE 60 forty 50 51 31 18"),
        &["line 1", "\"forty\"", "height"],
    );
    assert_says(&lens("7"), &["line 1", "lens model is missing"]);

    let image =
        |index, word: &'static str| colmap_with("images.txt", |t| first_record(t, index, word));
    assert_says(&image(1, "NaN"), &["images.txt", "view 00.png", "NaN"]);
    assert_says(&image(5, "inf"), &["view 00.png", "infinite"]);
    assert_says(
        &image(1, "9"),
        &["pose of frame view 00.png", "not a rotation"],
    );
    assert_says(&image(3, "x"), &["line 2", "\"x\"", "quaternion"]);
    assert_says(
        &colmap_with("images.txt", |_| String::new()),
        &["0 posed photo"],
    );
    let missing = colmap_with("images.txt", |t| t.replace("view 01.png", "lost.png"));
    assert_says(&missing, &["lost.png", "missing"]);

    let point =
        |index, word: &'static str| colmap_with("points3D.txt", |t| first_record(t, index, word));
    assert_says(&point(1, "nan"), &["points3D.txt", "point 2", "NaN"]);
    assert_says(&point(9, "77"), &["points3D.txt", "point 2", "feature 77"]);
    assert_says(&point(4, "300"), &["line 3", "\"300\"", "colour"]);
}

#[test]
fn colmap_lens_with_an_unknown_number() {
    let dir = tempfile::tempdir().unwrap();
    let mut files = colmap_bin(&full_ring()[..3], &[]);
    files[0].1[12..16].copy_from_slice(&99u32.to_le_bytes());
    write_colmap(dir.path(), &files, 3);
    assert_says(
        &refusal(dir.path()),
        &["cameras.bin", "camera 7", "number 99", "OPENCV"],
    );
}

/// A transforms.json of three photos after `change`, and its refusal.
fn transforms_with(change: impl Fn(&mut Value)) -> String {
    let dir = tempfile::tempdir().unwrap();
    let names = ["a.png", "b.png", "c.png"];
    let cameras = full_ring();
    let frames: Vec<Value> = names
        .iter()
        .zip(&cameras)
        .map(|(n, c)| transforms_frame(n, c))
        .collect();
    let mut json = json!({ "fl_x": 50.0, "w": 60, "h": 40, "frames": frames });
    write_transforms(dir.path(), "transforms.json", &json, &names);
    load(dir.path(), &LoadOptions::default()).unwrap();
    change(&mut json);
    fs::write(dir.path().join("transforms.json"), json.to_string()).unwrap();
    refusal(dir.path())
}

#[test]
#[allow(clippy::too_many_lines, reason = "one table")]
fn transforms_with_wrong_contents() {
    let set = |pointer: &'static str, value: Value| {
        transforms_with(move |json| match json.pointer_mut(pointer) {
            Some(place) => *place = value.clone(),
            None => json[&pointer[1..]] = value.clone(),
        })
    };
    let scaled = set("/frames/1/transform_matrix/0", json!([2.0, 0.0, 0.0, 1.0]));
    assert_says(
        &scaled,
        &[
            "transforms.json",
            "pose of frame b.png",
            "not a rotation",
            "determinant",
        ],
    );
    assert_says(
        &set("/frames/1/transform_matrix", json!([[1.0]])),
        &["b.png", "4×4"],
    );
    assert_says(
        &set("/frames/1/transform_matrix/3", json!([0, 0, 1, 1])),
        &["b.png", "last row"],
    );
    assert_says(
        &set("/frames/1/transform_matrix/0/0", Value::Null),
        &["line 1", "null"],
    );
    assert_says(
        &set("/frames/2/file_path", json!("photos/gone")),
        &["frame photos/gone", "missing"],
    );
    assert_says(&set("/frames", json!([])), &["list of frames is empty"]);
    assert_says(
        &set("/frames", json!(null)),
        &["line 1", "not a transforms file"],
    );
    assert_says(
        &set("/camera_model", json!("OPENCV_FISHEYE")),
        &["a.png", "OPENCV_FISHEYE", "undistort"],
    );
    assert_says(&set("/is_fisheye", json!(true)), &["a.png", "fisheye"]);
    assert_says(&set("/k3", json!(0.1)), &["a.png", "k3"]);
    assert_says(
        &set("/fl_x", json!(null)),
        &["a.png", "focal length must be positive, not 0"],
    );
    assert_says(&set("/fl_x", json!(-3.0)), &["a.png", "focal length"]);
    assert_says(&set("/w", json!(50)), &["a.png", "60×40", "50×40"]);
    let nowhere = transforms_with(|json| {
        json["train_filenames"] = json!(["a.png"]);
        json["test_filenames"] = json!(["z.png"]);
    });
    assert_says(&nowhere, &["z.png", "split"]);
    let one = transforms_with(|json| json["frames"].as_array_mut().unwrap().truncate(1));
    assert_says(&one, &["1 posed photo", "at least 2"]);
    let same = transforms_with(|json| {
        for i in 1..3 {
            json["frames"][i]["transform_matrix"] = json["frames"][0]["transform_matrix"].clone();
        }
    });
    assert_says(&same, &["all 3 cameras", "one place"]);
}

#[test]
fn transforms_that_are_not_json() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("transforms.json");
    let nan = "{\"fl_x\": 5,\n\"frames\": [{\"file_path\": \"a\", \"transform_matrix\": [[NaN]]}]}";
    for (text, place) in [
        ("", "line 1"),
        ("{\"frames\": [", "line 1"),
        (nan, "line 2"),
        ("{\n\"w\": 1e999,", "line 2"),
    ] {
        fs::write(&path, text).unwrap();
        assert_says(&refusal(dir.path()), &["transforms.json", place]);
    }
    fs::write(&path, [0xFF, 0xFE, 0x00]).unwrap();
    assert_says(
        &refusal(dir.path()),
        &["transforms.json", "byte 0", "not text"],
    );
}

#[test]
fn damaged_photos() {
    let dir = tempfile::tempdir().unwrap();
    write_colmap(dir.path(), &colmap_bin(&full_ring(), &points()), 10);
    let photo = dir.path().join("images").join(photo_name(4));
    let mut jpeg = Vec::new();
    picture(60, 40)
        .write_to(
            &mut std::io::Cursor::new(&mut jpeg),
            image::ImageFormat::Jpeg,
        )
        .unwrap();
    // The content decides, not the name.
    fs::write(&photo, &jpeg).unwrap();
    load(dir.path(), &LoadOptions::default()).unwrap();
    fs::write(&photo, &jpeg[..jpeg.len() / 2]).unwrap();
    assert_says(&refusal(dir.path()), &["view 04.png", "cut off"]);
    fs::write(&photo, []).unwrap();
    assert_says(&refusal(dir.path()), &["view 04.png", "empty"]);
    fs::write(&photo, "not a photo at all").unwrap();
    assert_says(&refusal(dir.path()), &["view 04.png", "not a usable photo"]);
    picture(40, 60).save(&photo).unwrap();
    assert_says(&refusal(dir.path()), &["view 04.png", "40×60", "60×40"]);
    fs::remove_file(&photo).unwrap();
    assert_says(&refusal(dir.path()), &["view 04.png", "missing"]);
}

#[test]
fn nerf_plus_plus_views_that_do_not_match() {
    let dir = tempfile::tempdir().unwrap();
    let train = dir.path().join("train");
    for part in ["pose", "intrinsics", "rgb"] {
        fs::create_dir_all(train.join(part)).unwrap();
    }
    let unit = "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1";
    let lens = "50 0 30 0  0 51 20 0  0 0 1 0  0 0 0 1";
    picture(60, 40).save(train.join("rgb/a.png")).unwrap();
    let (pose, intrinsics) = (train.join("pose/a.txt"), train.join("intrinsics/a.txt"));
    fs::write(&pose, unit).unwrap();
    assert_says(
        &refusal(dir.path()),
        &["train", "1 poses, 0 intrinsics and 1 photos", "one of each"],
    );
    fs::write(&intrinsics, lens).unwrap();
    assert_says(&refusal(dir.path()), &["1 posed photo", "at least 2"]);
    for (file, good, bad, parts) in [
        (&pose, unit, "1 0 0", ["a.txt", "3 numbers"]),
        (
            &pose,
            unit,
            &unit.replacen('1', "x", 1),
            ["number 1", "\"x\" is no number"],
        ),
        (
            &pose,
            unit,
            &unit.replacen('1', "2", 1),
            ["train/rgb/a.png", "not a rotation"],
        ),
        (
            &pose,
            unit,
            &unit.replacen('1', "NaN", 1),
            ["train/rgb/a.png", "NaN"],
        ),
        (
            &intrinsics,
            lens,
            &lens.replacen("50 0", "50 9", 1),
            ["a.txt", "skewed"],
        ),
        (
            &intrinsics,
            lens,
            &lens.replacen("50", "0", 1),
            ["a.txt", "intrinsics"],
        ),
    ] {
        fs::write(file, bad).unwrap();
        assert_says(&refusal(dir.path()), &parts);
        fs::write(file, good).unwrap();
    }
}

#[test]
fn llff_poses_that_do_not_match() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("images")).unwrap();
    picture(60, 40)
        .save(dir.path().join("images/a.png"))
        .unwrap();
    let path = dir.path().join("poses_bounds.npy");
    let row = [
        0.0, 1.0, 0.0, 0.0, 40.0, 1.0, 0.0, 0.0, 0.0, 60.0, 0.0, 0.0, -1.0, 0.0, 50.0, 0.1, 9.0,
    ];
    for (bytes, parts) in [
        (b"PK".to_vec(), ["poses_bounds.npy", "no NumPy file"]),
        (npy::encode(&row[..16], 16, 1), ["[1, 16]", "views × 17"]),
        (
            npy::encode(&[row, row].concat(), 17, 2),
            ["2 poses but 1 photos", "images/"],
        ),
        (
            npy::encode(&[0.0; 17], 17, 1),
            ["images/a.png", "not a rotation"],
        ),
        (npy::encode(&row, 17, 1), ["1 posed photo", "at least 2"]),
    ] {
        fs::write(&path, bytes).unwrap();
        assert_says(&refusal(dir.path()), &parts);
    }
}
