//! `impasto prepare` as its users run it, with a program that stands in for COLMAP.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

#[path = "../crates/impasto-prepare/tests/common/mod.rs"]
mod common;

use std::path::Path;
use std::process::{Command, Output};

use common::Place;

fn place() -> Place {
    let fixtures = "crates/impasto-prepare/tests/fixtures";
    let names = ["a.png", "b.png", "c.png", "d.png"];
    Place::new(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join(fixtures),
        &names,
    )
}

fn impasto(place: &Place, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_impasto"))
        .args(arguments.split_whitespace())
        .current_dir(place.folder.path())
        .env("IMPASTO_COLMAP", place.path("colmap"))
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_summary_is_one_json_object_or_a_few_lines() {
    let place = place();
    let output = impasto(&place, "prepare photos -o scene --json");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["photos"]["registered"], 4);
    assert_eq!(summary["picture"], "scene/capture.png");
    assert!(text(&output.stderr).contains("comparing all 6 pairs"));

    let output = impasto(&place, "prepare photos -o other");
    let told = text(&output.stdout);
    for words in [
        "4 of 4 photos registered",
        "impasto train other -o MODEL",
        "other/colmap.log",
    ] {
        assert!(told.contains(words), "{told}");
    }
    let info = impasto(&place, "info scene --json");
    assert!(info.status.success(), "{}", text(&info.stderr));
}

#[test]
fn a_failure_is_one_line() {
    let place = place();
    place.write("mapper.sh", "kill -9 $$");
    let output = impasto(&place, "prepare photos -o scene");
    assert_eq!(output.status.code(), Some(1));
    let message = text(&output.stderr);
    let errors: Vec<&str> = message
        .lines()
        .filter(|l| l.starts_with("error: "))
        .collect();
    assert_eq!(errors.len(), 1, "{message}");
    assert!(errors[0].contains("scene/colmap.log"), "{message}");
    assert!(output.stdout.is_empty());
    let output = impasto(&place, "prepare photos -o scene --colmap missing");
    assert!(text(&output.stderr).contains("IMPASTO_COLMAP"));
    assert_eq!(impasto(&place, "prepare photos").status.code(), Some(2));
}
