//! Nothing is lost: runs killed at any moment, full disks, folders that cannot be written, two runs at
//! once. `IMPASTO_KILLS` is the number of runs to kill, 8 by default.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use impasto::paintings::{Recipe, paint};
use impasto::scene::builtin::{BuiltinOptions, write_capture};
use impasto::scene::file::name_of_temporary;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use tempfile::TempDir;

/// A run of both stages that takes a second or two and keeps a checkpoint after each step.
const RUN: &str = "train scene -o model --styles paintings --steps 24 --checkpoint-every 0s \
    --set style.patch=[36,44] \
    --set style.generated=3 --set style.pool=2 --set field.sampling.occupancy.inner_grid=24 \
    --set field.sampling.occupancy.outer_grid=24 --set field.inner.encoding.hash_grid.log2_entries=12 \
    --set field.outer.encoding.hash_grid.log2_entries=12 --set geometry.samples=20000 \
    --set geometry.grid_every=4 --set style.hyper_width=8 \
    --set style.shading.painted.distilled.log2_entries=8";

fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_impasto"));
    command
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .env("IMPASTO_CACHE", "cache")
        // What a run on a GPU adds up has no fixed order.
        .env("IMPASTO_DEVICE", "cpu")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn impasto(folder: &Path, arguments: &str) -> Output {
    command(folder, arguments).output().unwrap()
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder with a small capture in `scene` and two paintings in `paintings`.
fn capture() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let options = BuiltinOptions {
        photos: 6,
        width: 56,
        height: 42,
        ..BuiltinOptions::default()
    };
    write_capture(&folder.path().join("scene"), &options).unwrap();
    let paintings = folder.path().join("paintings");
    fs::create_dir(&paintings).unwrap();
    for seed in 0..2 {
        let painting = paint(&Recipe::random(seed), 64, 48);
        painting
            .save(paintings.join(format!("{seed}.png")))
            .unwrap();
    }
    folder
}

fn signal(child: &Child, signal: &str) {
    let pid = child.id().to_string();
    let sent = Command::new("kill").args([signal, &pid]).status().unwrap();
    assert!(sent.success());
}

fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    let start = Instant::now();
    while !there() {
        assert!(start.elapsed() < Duration::from_secs(60), "no {what}");
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// When to kill a run.
enum Moment {
    /// Some time after its start.
    After(Duration),
    /// While it writes that file of the model's folder: a checkpoint, or its model.
    Writing(&'static str),
}

/// Files of a model's folder that are being written, or were when the run was killed.
fn half_written(model: &Path) -> Vec<String> {
    // The run may not have made the folder yet.
    let entries = fs::read_dir(model).into_iter().flatten();
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    names
        .filter_map(|name| name_of_temporary(&name).map(str::to_owned))
        .collect()
}

/// Starts the run in `folder` and kills it; whether it left a half-written file behind.
fn killed(folder: &Path, moment: &Moment) -> bool {
    let mut child = command(folder, &format!("{RUN} --resume")).spawn().unwrap();
    let model = folder.join("model");
    match moment {
        Moment::After(time) => std::thread::sleep(*time),
        Moment::Writing(file) => {
            let writing = || half_written(&model).iter().any(|name| name == file);
            while !writing() && child.try_wait().unwrap().is_none() {}
        }
    }
    // It may be over already.
    let _ = child.kill();
    child.wait().unwrap();
    !half_written(&model).is_empty()
}

#[test]
fn a_run_killed_at_any_moment_is_resumed_to_the_same_model() {
    let kills = std::env::var("IMPASTO_KILLS").map_or(8, |kills| kills.parse().unwrap());
    let folder = capture();
    let folder = folder.path();
    let output = impasto(folder, RUN);
    assert!(output.status.success(), "{}", told(&output));
    let model = folder.join("model");
    let wanted = fs::read(model.join("model.safetensors")).unwrap();
    fs::remove_dir_all(&model).unwrap();
    // Once more, with all paintings measured: how long a run takes that is to be killed.
    let start = Instant::now();
    assert!(impasto(folder, RUN).status.success());
    let length = start.elapsed();

    let mut rng = Pcg64::seed_from_u64(7);
    let mut interrupted_writes = 0;
    for kill in 0..kills {
        fs::remove_dir_all(&model).unwrap();
        let moment = match kill % 4 {
            0 => Moment::Writing("checkpoint.safetensors"),
            2 if kill % 8 == 2 => Moment::Writing("model.safetensors"),
            _ => Moment::After(length.mul_f64(rng.random())),
        };
        interrupted_writes += usize::from(killed(folder, &moment));
        let output = impasto(folder, &format!("{RUN} --resume"));
        assert!(output.status.success(), "kill {kill}: {}", told(&output));
        let found = fs::read(model.join("model.safetensors")).unwrap();
        assert!(found == wanted, "kill {kill}: another model");
        let log = fs::read_to_string(model.join("log.jsonl")).unwrap();
        for line in log.lines() {
            serde_json::from_str::<serde_json::Value>(line).unwrap();
        }
        let mut left: Vec<_> = fs::read_dir(&model).unwrap().map(|e| e.unwrap()).collect();
        left.retain(|entry| entry.file_name().to_string_lossy().ends_with(".tmp"));
        assert!(left.is_empty(), "kill {kill}: {left:?}");
    }
    eprintln!("{kills} runs killed, {interrupted_writes} of them while a file was half-written");
}

#[test]
fn an_interruption_ends_the_step_and_says_how_to_go_on() {
    let folder = capture();
    let folder = folder.path();
    let long = RUN.replace("--steps 24", "--steps 100000");
    let running = || {
        let child = command(folder, &long).spawn().unwrap();
        let checkpoint = folder.join("model/checkpoint.safetensors");
        wait_for("checkpoint", || checkpoint.exists());
        child
    };
    for request in ["-INT", "-TERM"] {
        let child = running();
        signal(&child, request);
        let output = child.wait_with_output().unwrap();
        let message = told(&output);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(output.stdout.is_empty());
        for part in [
            "stopped after ",
            " steps of the geometry stage",
            "impasto train scene -o model --styles paintings --steps 100000",
            "--resume",
        ] {
            assert!(message.contains(part), "{message}");
        }
        assert!(!message.contains("error"), "{message}");
        fs::remove_dir_all(folder.join("model")).unwrap();
    }
}

#[test]
fn a_second_interruption_leaves_at_once() {
    let folder = capture();
    let folder = folder.path();
    let run = RUN.replace("--styles paintings", "");
    let mut child = command(folder, &run).spawn().unwrap();
    // Without paintings, hundreds of pictures are made and looked at after the geometry stage.
    let geometry = folder.join("model/model.safetensors");
    wait_for("model", || geometry.exists());
    signal(&child, "-INT");
    std::thread::sleep(Duration::from_millis(200));
    assert!(child.try_wait().unwrap().is_none(), "it was to go on");
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    let message = told(&output);
    assert_eq!(output.status.code(), Some(130), "{message}");
    assert!(message.contains("once more leaves at once"), "{message}");
    assert!(
        !folder.join("cache").exists(),
        "pictures were still looked at"
    );
    let kept = fs::metadata(folder.join("model/checkpoint.safetensors"));
    assert!(kept.is_ok_and(|file| file.len() > 0));
}

#[test]
fn a_second_run_on_one_model_is_refused() {
    let folder = capture();
    let folder = folder.path();
    let long = RUN.replace("--steps 24", "--steps 100000");
    let mut child = command(folder, &long).spawn().unwrap();
    let checkpoint = folder.join("model/checkpoint.safetensors");
    wait_for("checkpoint", || checkpoint.exists());
    for arguments in [RUN.to_owned(), format!("{RUN} --resume")] {
        let output = impasto(folder, &arguments);
        let message = told(&output);
        assert_eq!(output.status.code(), Some(1), "{message}");
        let process = format!("(process {})", child.id());
        for part in ["model", "another run", &process, "choose another output"] {
            assert!(message.contains(part), "{message}");
        }
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

/// A file system in memory of a few bytes; `None` where this user cannot mount one.
struct Tmpfs(TempDir);

impl Tmpfs {
    #[allow(clippy::print_stderr, reason = "a test says why it is skipped")]
    fn mount(size: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let options = ["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"];
        let mounted = Command::new("mount")
            .args(options)
            .arg(folder.path())
            .stderr(Stdio::null())
            .status();
        if !mounted.is_ok_and(|status| status.success()) {
            eprintln!("skipped: only root can mount a file system for this test");
            return None;
        }
        Some(Self(folder))
    }

    fn change(&self, options: &str) {
        let mut mount = Command::new("mount");
        mount.args(["-o", &format!("remount,{options}")]);
        assert!(mount.arg(self.0.path()).status().unwrap().success());
    }
}

impl Drop for Tmpfs {
    fn drop(&mut self) {
        // Best effort: the folder goes with the machine.
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn a_full_disk_costs_checkpoints_and_nothing_else() {
    let folder = capture();
    let folder = folder.path();
    let Some(disk) = Tmpfs::mount("512m") else {
        return;
    };
    let model = disk.0.path().join("model");
    let run = RUN.replace("-o model", &format!("-o {}", model.display()));
    let output = impasto(folder, &run);
    assert!(output.status.success(), "{}", told(&output));
    let wanted = fs::read(model.join("model.safetensors")).unwrap();
    fs::remove_dir_all(&model).unwrap();

    // Room for the geometry stage, but not for what hypernetworks add.
    disk.change(&format!("size={}k", wanted.len() / 1024 - 100));
    let output = impasto(folder, &run);
    let message = told(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(
        message.contains("goes on without this checkpoint"),
        "{message}"
    );
    let end = message.lines().last().unwrap();
    for part in ["error: cannot write", "model.safetensors", "No space left"] {
        assert!(end.contains(part), "{message}");
    }
    for entry in fs::read_dir(&model).unwrap() {
        let name = entry.unwrap().file_name();
        assert!(!name.to_string_lossy().ends_with(".tmp"), "{name:?}");
    }
    disk.change("size=512m");
    let output = impasto(folder, &format!("{run} --resume"));
    assert!(output.status.success(), "{}", told(&output));
    assert!(fs::read(model.join("model.safetensors")).unwrap() == wanted);

    disk.change("ro");
    let output = impasto(folder, &run);
    let message = told(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    for part in [
        "error: cannot write",
        "read-only filesystem",
        "choose another",
    ] {
        assert!(message.contains(part), "{message}");
    }
}
