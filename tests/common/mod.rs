//! The command in a folder, and small captures.

#![allow(
    clippy::unwrap_used,
    dead_code,
    reason = "a test may panic, and none uses all of this"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use impasto::scene::builtin::{BuiltinOptions, write_capture};
use tempfile::TempDir;

/// The command with its arguments split at blanks, in `folder`.
pub fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_impasto"));
    command
        .args(arguments.split_whitespace())
        .current_dir(folder)
        // Relative, so each test has its own; nothing is made of it where nothing is measured.
        .env("IMPASTO_CACHE", "cache");
    command
}

/// What becomes of it.
pub fn impasto(folder: &Path, arguments: &str) -> Output {
    let output = command(folder, arguments).output();
    output.expect("the binary starts")
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A folder with a small capture of the built-in scene in `scene`.
pub fn capture() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let options = BuiltinOptions {
        photos: 8,
        width: 56,
        height: 42,
        ..BuiltinOptions::default()
    };
    write_capture(&folder.path().join("scene"), &options).unwrap();
    folder
}

/// Two paintings in a folder's `paintings`.
pub fn paintings(folder: &Path) {
    fs::create_dir(folder.join("paintings")).unwrap();
    for (name, shade) in [("red.png", 180), ("grey.png", 90)] {
        let picture = image::RgbImage::from_fn(64, 64, |x, y| {
            image::Rgb([shade, (x * 3) as u8, ((x ^ y) * 4) as u8])
        });
        picture.save(folder.join("paintings").join(name)).unwrap();
    }
}

/// All paths below a folder.
pub fn everything(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(everything(&path));
        }
        found.push(path);
    }
    found.sort();
    found
}
