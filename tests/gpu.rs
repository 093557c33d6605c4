//! What a GPU cannot do is told like everything else. `IMPASTO_DEVICE=gpu` names the device.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::process::Command;

#[test]
fn no_memory_left_is_a_sentence() {
    if !std::env::var("IMPASTO_DEVICE").is_ok_and(|device| device.starts_with("gpu")) {
        eprintln!("skipped: IMPASTO_DEVICE names no GPU");
        return;
    }
    let folder = common::capture();
    // Forty gigabytes for each of a step's buffers.
    let rays = 10_000_000;
    let output = Command::new(env!("CARGO_BIN_EXE_impasto"))
        .args(["train", "scene", "-o", "model", "--stage", "geometry"])
        .args(["--steps", "1", "--set", "geometry.samples=400000000"])
        .args(["--set", &format!("geometry.rays=[512,{rays}]")])
        .args(["--set", &format!("geometry.rays_at_once={rays}")])
        .current_dir(folder.path())
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    // Drivers have errors of their own to tell, of displays that are not there.
    let told = "error: computing on ";
    let errors: Vec<&str> = message.lines().filter(|l| l.starts_with(told)).collect();
    assert_eq!(errors.len(), 1, "{message}");
    assert!(errors[0].contains("--device cpu"), "{message}");
    assert!(!message.contains("panicked"), "{message}");
}
