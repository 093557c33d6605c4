//! `impasto export` as its users run it.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::fs;
use std::path::Path;

use common::{capture, impasto};
use serde_json::Value;

/// It must end with this code and an error that says this, and leave the folder as it was.
fn refused(folder: &Path, arguments: &str, code: i32, what: &str) {
    let before = fs::read_dir(folder).unwrap().count();
    let output = impasto(folder, arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments}: {message}");
    assert!(message.contains(what), "{arguments}: {message}");
    assert!(output.stdout.is_empty());
    assert_eq!(fs::read_dir(folder).unwrap().count(), before, "{arguments}");
}

#[test]
fn a_model_becomes_files_for_other_programs() {
    let folder = capture();
    let at = folder.path();
    refused(at, "export scene -o out.ply", 1, "no model");
    let trained = impasto(at, "train scene -o model --stage geometry --steps 60");
    assert!(trained.status.success(), "{trained:?}");
    for kind in ["points", "splats"] {
        let arguments = format!("export model --kind {kind} --views 3 --json -o {kind}.ply");
        let output = impasto(at, &arguments);
        assert!(output.status.success(), "{output:?}");
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(answer["kind"], kind);
        assert_eq!(answer["synthetic"], true);
        assert_eq!(answer["views"], 3);
        let bytes = fs::read(at.join(format!("{kind}.ply"))).unwrap();
        assert_eq!(answer["bytes"], bytes.len());
        let said = format!("element vertex {}\n", answer["count"]);
        assert!(
            String::from_utf8_lossy(&bytes[..400]).contains(&said),
            "{said}"
        );
    }
    fs::write(at.join("file"), "").unwrap();
    refused(at, "export model -o out.txt", 2, "FILE.ply");
    refused(at, "export model -o file/out.ply", 1, "cannot write");
    refused(
        at,
        "export model --style none.png -o out.ply",
        1,
        "none.png",
    );
    let two = "export model --style a.png --style b.png -o out.ply";
    refused(at, two, 2, "weight");
}
