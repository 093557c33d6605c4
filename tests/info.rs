//! `impasto info SCENE` as its users run it.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use image::{Rgb, imageops};
use impasto::scene::builtin::{BuiltinOptions, write_capture};
use serde_json::Value;
use tempfile::TempDir;

fn info(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_impasto"))
        .arg("info")
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the binary starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(folder: &Path, arguments: &str) -> Value {
    let output = info(folder, &format!("{arguments} --json"));
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A capture of the built-in scene in `scene`.
fn capture() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let options = BuiltinOptions {
        photos: 16,
        width: 160,
        height: 120,
        ..BuiltinOptions::default()
    };
    write_capture(&folder.path().join("scene"), &options).unwrap();
    folder
}

fn edit(folder: &Path, index: usize, change: impl FnOnce(image::RgbImage) -> image::RgbImage) {
    let path = folder.join(format!("scene/images/{index:04}.png"));
    let photo = image::open(&path).unwrap().into_rgb8();
    change(photo).save(&path).unwrap();
}

#[test]
fn a_good_capture_is_described_without_complaint() {
    let folder = capture();
    let facts = json(folder.path(), "scene --quick -o overview.png");
    assert_eq!(facts["kind"], "scene");
    assert_eq!(facts["name"], "scene");
    assert_eq!(facts["photos"], 16);
    assert_eq!(facts["train"].as_array().unwrap().len(), 14);
    assert_eq!(facts["test"].as_array().unwrap().len(), 2);
    assert_eq!(facts["sizes"][0]["w"], 160);
    assert_eq!(facts["problems"], Value::Array(vec![]));
    assert_eq!(facts["warnings"], Value::Array(vec![]));
    assert_eq!(facts["cameras"]["walk"], "around");
    assert_eq!(facts["per_photo"].as_array().unwrap().len(), 16);
    assert!((facts["lenses"][0]["fov_x"].as_f64().unwrap() - 60.0).abs() < 0.2);
    assert!(facts["normalisation"]["scale"].as_f64().unwrap() > 0.0);
    let fast = &facts["estimates"]["fast"];
    assert_eq!(fast["seconds"], 180.0);
    assert!(fast["steps_per_second"].is_null(), "not measured");
    let memory = |preset: &str| facts["estimates"][preset]["memory_gib"].as_f64().unwrap();
    assert!(memory("fast") > 0.3 && memory("paper") > memory("fast"));
    let picture = image::open(folder.path().join("overview.png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (1200, 600));

    let told = text(&info(folder.path(), "scene --quick").stdout);
    assert!(told.starts_with("scene: 16 synthetic photos, 14 to learn from and 2 held out"));
    assert!(told.contains("No single photo stands out"), "{told}");
    assert!(
        told.contains("160×120 pixels; field of view 60°×"),
        "{told}"
    );
}

#[test]
fn bad_photos_are_named_with_advice_the_worst_first() {
    let folder = capture();
    edit(folder.path(), 4, |photo| imageops::blur(&photo, 1.5));
    edit(folder.path(), 9, |mut photo| {
        for Rgb(values) in photo.pixels_mut() {
            *values = values.map(|v| (f32::from(v) * 1.8).min(255.0) as u8);
        }
        photo
    });
    let facts = json(folder.path(), "scene --quick");
    let problems = facts["problems"].as_array().unwrap();
    let mut named: Vec<_> = problems
        .iter()
        .map(|p| (p["photo"].as_str().unwrap(), p["kind"].as_str().unwrap()))
        .collect();
    named.sort_unstable();
    assert_eq!(
        named,
        [("images/0004.png", "blur"), ("images/0009.png", "exposure")]
    );
    let severity = |i: usize| problems[i]["severity"].as_f64().unwrap();
    assert!(severity(0) >= severity(1));

    let told = text(&info(folder.path(), "scene --quick").stdout);
    let line = told.lines().find(|line| line.contains("0004.png")).unwrap();
    assert!(line.contains("blurrier than its neighbours"), "{line}");
    assert!(line.ends_with("leave it out or retake it"), "{line}");
}

#[test]
fn the_machine_is_measured_unless_it_should_not() {
    let folder = capture();
    let output = info(folder.path(), "scene --json");
    assert!(text(&output.stderr).contains("--quick"));
    let facts: Value = serde_json::from_slice(&output.stdout).unwrap();
    for preset in ["fast", "paper"] {
        let estimate = &facts["estimates"][preset];
        for stage in 0..2 {
            let rate = estimate["steps_per_second"][stage].as_f64().unwrap();
            assert!(rate > 0.0, "{preset}");
            let steps = estimate["steps"][stage].as_u64().unwrap();
            // The painter that the program holds need not learn.
            let learns = stage == 0 || preset == "paper";
            assert_eq!(steps > 0, learns, "{preset}");
        }
        assert!(estimate["seconds"].as_f64().unwrap() >= 180.0, "{preset}");
    }
    let rate = |preset: &str| {
        facts["estimates"][preset]["steps_per_second"][0]
            .as_f64()
            .unwrap()
    };
    assert!(
        rate("fast") > 10.0 * rate("paper"),
        "the paper's steps are far larger"
    );
}

#[test]
fn photos_too_small_to_style_are_warned_of() {
    let folder = capture();
    let facts = json(folder.path(), "scene --quick --downscale 4");
    assert_eq!(facts["sizes"][0]["w"], 40);
    let warnings = facts["warnings"].as_array().unwrap();
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0]["problem"].as_str().unwrap().contains("40×30"));
    assert!(
        warnings[0]["advice"]
            .as_str()
            .unwrap()
            .contains("smaller --downscale")
    );
}

#[test]
fn a_picture_is_of_a_capture_and_needs_a_place() {
    let folder = capture();
    fs::create_dir(folder.path().join("model")).unwrap();
    fs::write(folder.path().join("model/model.safetensors"), "").unwrap();
    let model = info(folder.path(), "model -o overview.png");
    assert_eq!(model.status.code(), Some(2), "{}", text(&model.stderr));
    assert!(text(&model.stderr).contains("is a model"));
    fs::write(folder.path().join("file"), "").unwrap();
    let nowhere = info(folder.path(), "scene --quick -o file/overview.png");
    assert_eq!(nowhere.status.code(), Some(1));
    assert!(
        text(&nowhere.stderr).contains("cannot write"),
        "{}",
        text(&nowhere.stderr)
    );
    let odd = info(folder.path(), "scene --downscale 0");
    assert_eq!(odd.status.code(), Some(2));
}
