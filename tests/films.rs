//! Films: what is written is decoded again by the installed ffmpeg, and compared with single frames.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![allow(clippy::print_stdout, reason = "a skipped test says so")]

mod common;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::LazyLock;

use common::{capture, command, everything, paintings};
use image::{AnimationDecoder, RgbImage};
use serde_json::{Value, json};
use tempfile::TempDir;

const ORBIT: &str = "render model --views orbit --frames 6 --size 64x48";

/// Runs the command with its arguments split at blanks, in `folder`.
fn impasto(folder: &Path, arguments: &str) -> Output {
    command(folder, arguments)
        .env("IMPASTO_DEVICE", "cpu")
        .env_remove("IMPASTO_FFMPEG")
        .output()
        .expect("the binary starts")
}

fn json_of(folder: &Path, arguments: &str) -> Value {
    let output = impasto(folder, &format!("{arguments} --json"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments}: {said}");
    serde_json::from_slice(&output.stdout).expect("stdout is one JSON object")
}

/// The one line that the command fails with, after which the folder is as it was.
fn refused(folder: &Path, arguments: &str, code: i32) -> String {
    let before = everything(folder);
    let output = impasto(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
    assert_eq!(everything(folder), before, "{arguments} left something");
    let errors = said.lines().filter(|line| line.starts_with("error: "));
    errors.collect::<Vec<_>>().join("\n")
}

/// A folder with a model that was trained for seconds.
static TRAINED: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = capture();
    paintings(folder.path());
    let settings = [
        "style.patch=[36,44]",
        "style.generated=6",
        "field.sampling.occupancy.inner_grid=24",
        "field.sampling.occupancy.outer_grid=24",
        "field.inner.encoding.hash_grid.log2_entries=12",
        "field.outer.encoding.hash_grid.log2_entries=12",
        "geometry.samples=20000",
    ];
    let settings: String = settings.iter().map(|s| format!(" --set {s}")).collect();
    json_of(
        folder.path(),
        &format!("train scene -o model --styles paintings --steps 40{settings}"),
    );
    folder
});

/// A folder of its own with the model, and nothing else.
fn workplace() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["model", "paintings"] {
        let to = folder.path().join(name);
        fs::create_dir(&to).unwrap();
        for entry in fs::read_dir(TRAINED.path().join(name)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    folder
}

fn ffmpeg_is_missing() -> bool {
    let missing = Command::new("ffmpeg").arg("-version").output().is_err();
    if missing {
        println!("skipped: ffmpeg is not installed");
    }
    missing
}

/// A film's frames as ffmpeg decodes them.
fn decoded(film: &Path, (width, height): (u32, u32)) -> Vec<RgbImage> {
    let output = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-i"])
        .arg(film)
        .args(["-f", "rawvideo", "-pix_fmt", "rgb24", "-"])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let size = (3 * width * height) as usize;
    assert_eq!(output.stdout.len() % size, 0);
    let frames = output.stdout.chunks_exact(size);
    frames
        .map(|bytes| RgbImage::from_raw(width, height, bytes.to_vec()).unwrap())
        .collect()
}

/// What ffmpeg says of a film.
fn described(film: &Path) -> String {
    let output = Command::new("ffmpeg")
        .arg("-hide_banner")
        .arg("-i")
        .arg(film)
        .output();
    String::from_utf8_lossy(&output.unwrap().stderr).into_owned()
}

fn picture(path: &Path) -> RgbImage {
    image::open(path).unwrap().to_rgb8()
}

/// Mean difference of all numbers, and the largest difference of the channels' means.
fn apart(a: &RgbImage, b: &RgbImage) -> (f64, f64) {
    assert_eq!(a.dimensions(), b.dimensions());
    let pixels = f64::from(a.width() * a.height());
    let (mut sum, mut means) = (0.0, [0.0; 3]);
    for (a, b) in a.pixels().zip(b.pixels()) {
        for ((a, b), mean) in a.0.iter().zip(b.0).zip(&mut means) {
            let difference = f64::from(*a) - f64::from(b);
            sum += difference.abs();
            *mean += difference / pixels;
        }
    }
    let largest = means
        .iter()
        .fold(0.0, |most: f64, mean| most.max(mean.abs()));
    (sum / (3.0 * pixels), largest)
}

#[test]
fn a_film_shows_the_frames_of_the_folder() {
    if ffmpeg_is_missing() {
        return;
    }
    let folder = workplace();
    let folder = folder.path();
    let style = "--style paintings/red.png";
    json_of(folder, &format!("{ORBIT} {style} -o frames"));
    for (name, codec) in [("clip.mp4", "h264"), ("clip.webm", "vp9")] {
        let answer = json_of(folder, &format!("{ORBIT} {style} --fps 10 -o {name}"));
        assert_eq!(answer["outputs"], json!([name]));
        let path = folder.join(name);
        let frames = decoded(&path, (64, 48));
        assert_eq!(frames.len(), 6);
        for (i, frame) in frames.iter().enumerate() {
            let single = picture(&folder.join(format!("frames/{i:04}.png")));
            let (mean, shift) = apart(frame, &single);
            assert!(mean < 6.0 && shift < 2.0, "{name} {i}: {mean} {shift}");
        }
        let said = described(&path);
        for word in [codec, "yuv420p", "tv, bt709", "64x48", "10 fps"] {
            assert!(said.contains(word), "\"{word}\" is missing: {said}");
        }
    }
    // What is at the beginning is what a player needs first.
    let bytes = fs::read(folder.join("clip.mp4")).unwrap();
    let place = |atom: &[u8]| bytes.windows(4).position(|four| four == atom);
    assert!(place(b"moov") < place(b"mdat"));
    let names = everything(folder);
    assert!(
        !names
            .iter()
            .any(|path| path.to_string_lossy().contains(".impasto-"))
    );
}

#[test]
fn odd_sizes_and_several_styles_make_films_too() {
    if ffmpeg_is_missing() {
        return;
    }
    let folder = workplace();
    let folder = folder.path();
    let orbit = "render model --views orbit --frames 3 --size 33x25";
    let styles = "--style paintings/red.png --style paintings/grey.png";
    let answer = json_of(folder, &format!("{orbit} {styles} -o clip.mp4"));
    assert_eq!(answer["outputs"], json!(["clip.red.mp4", "clip.grey.mp4"]));
    json_of(folder, &format!("{orbit} {styles} -o frames"));
    for style in ["red", "grey"] {
        let film = folder.join(format!("clip.{style}.mp4"));
        let frames = decoded(&film, (34, 26));
        assert_eq!(frames.len(), 3);
        let single = picture(&folder.join("frames").join(style).join("0001.png"));
        let shown = image::imageops::crop_imm(&frames[1], 0, 0, 33, 25).to_image();
        let (mean, shift) = apart(&shown, &single);
        assert!(mean < 8.0 && shift < 3.0, "{style}: {mean} {shift}");
        assert!(described(&film).contains("24 fps"));
    }
}

#[test]
fn a_camera_path_sets_the_speed() {
    let folder = workplace();
    let folder = folder.path();
    let path = json!({
        "camera_path": [
            {"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "fov": 60.0},
            {"camera_to_world": [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1], "fov": 60.0}],
        "fps": 20, "seconds": 0.1, "render_width": 32, "render_height": 24,
    });
    fs::write(folder.join("path.json"), path.to_string()).unwrap();
    let delays = |arguments: &str| -> Vec<(u32, u32)> {
        json_of(
            folder,
            &format!("render model --views path.json {arguments} -o clip.gif"),
        );
        let bytes = std::io::Cursor::new(fs::read(folder.join("clip.gif")).unwrap());
        let frames = image::codecs::gif::GifDecoder::new(bytes)
            .unwrap()
            .into_frames();
        let frames = frames.collect_frames().unwrap();
        frames
            .iter()
            .map(|frame| frame.delay().numer_denom_ms())
            .collect()
    };
    assert_eq!(delays(""), [(50, 1), (50, 1)]);
    assert_eq!(delays("--fps 5"), [(200, 1), (200, 1)]);
}

#[test]
fn the_original_is_on_the_left() {
    let folder = workplace();
    let folder = folder.path();
    let small = "render model --views orbit --frames 2 --size 32x24";
    let styles = "--style paintings/red.png --style paintings/grey.png";
    json_of(folder, &format!("{small} -o photo"));
    json_of(folder, &format!("{small} {styles} -o styled"));
    let answer = json_of(folder, &format!("{small} {styles} --side-by-side -o both"));
    assert_eq!(answer["styles"], json!(["red", "grey"]));
    let both = picture(&folder.join("both/0001.png"));
    let gap = (both.width() - 3 * 32) / 2;
    assert!((1..8).contains(&gap) && both.height() == 24);
    let part = |i: u32| image::imageops::crop_imm(&both, i * (32 + gap), 0, 32, 24).to_image();
    assert_eq!(part(0), picture(&folder.join("photo/0001.png")));
    assert_eq!(part(1), picture(&folder.join("styled/red/0001.png")));
    assert_eq!(part(2), picture(&folder.join("styled/grey/0001.png")));
    let cameras: Value =
        serde_json::from_slice(&fs::read(folder.join("both/cameras.json")).unwrap()).unwrap();
    assert_eq!(cameras["side_by_side"], json!(["photo", "red", "grey"]));
    assert_eq!(cameras["frames"][0]["w"], 32);

    // In shards, in a ZIP, as a film and on a sheet it is the same.
    for shard in ["0/2", "1/2"] {
        json_of(
            folder,
            &format!("{small} {styles} --side-by-side -o shards --shard {shard}"),
        );
    }
    for name in ["0000.png", "0001.png", "cameras.json"] {
        let bytes = |folder_name: &str| fs::read(folder.join(folder_name).join(name)).unwrap();
        assert!(bytes("shards") == bytes("both"), "{name}");
    }
    json_of(
        folder,
        &format!("{small} {styles} --side-by-side -o clip.gif"),
    );
    let film = image::open(folder.join("clip.gif")).unwrap();
    assert_eq!((film.width(), film.height()), both.dimensions());
    json_of(
        folder,
        &format!("{small} {styles} --side-by-side -o sheet.png"),
    );
    assert!(picture(&folder.join("sheet.png")).width() >= both.width());
    json_of(
        folder,
        &format!("{small} {styles} --side-by-side -o frames.zip"),
    );
    let zip = fs::read(folder.join("frames.zip")).unwrap();
    let png = fs::read(folder.join("both/0001.png")).unwrap();
    assert!(zip.starts_with(b"PK") && zip.windows(png.len()).any(|bytes| bytes == png));
}

#[test]
fn a_generated_painting_is_said_to_be_one() {
    let folder = workplace();
    let folder = folder.path();
    let small = "render model --views test --size 32x24";
    let answer = json_of(folder, &format!("{small} --style random:42 -o a.png"));
    assert_eq!(answer["styles"], json!(["random-42"]));
    let label = answer["generated"][0].as_str().unwrap().to_owned();
    assert!(
        label.starts_with("synthetic") && label.contains("#42"),
        "{label}"
    );
    let plain = impasto(folder, &format!("{small} --style random:42 -o b.png"));
    assert!(String::from_utf8_lossy(&plain.stdout).contains(&label));
    // As a painting of any other kind: alone or mixed, and in coats.
    json_of(
        folder,
        &format!("{small} --style random:42:1 --style random:7:0 -o mix.png"),
    );
    let coats = json!({"coats": [{"paintings": [{"painting": "random:42"}]}]});
    fs::write(folder.join("coats.json"), coats.to_string()).unwrap();
    let coated = json_of(folder, &format!("{small} --coats coats.json -o coats.png"));
    assert_eq!(coated["generated"], json!([label]));
    let one = picture(&folder.join("a.png"));
    assert_eq!(one, picture(&folder.join("mix.png")));
    assert_eq!(one, picture(&folder.join("coats.png")));
    let other = json_of(
        folder,
        &format!("{small} --style paintings/red.png -o red.png"),
    );
    assert_eq!(other["generated"], json!([]));
    assert_ne!(one, picture(&folder.join("red.png")));
}

#[test]
fn a_batch_has_both_sides_and_generated_paintings() {
    let folder = workplace();
    let folder = folder.path();
    let jobs = "[[render]]\nmodels = [\"model\"]\nstyles = [\"random:42\", \"paintings/red.png\"]\n\
        frames = 2\nsize = \"32x24\"\nside_by_side = true\n";
    fs::write(folder.join("jobs.toml"), jobs).unwrap();
    let answer = json_of(folder, "batch jobs.toml");
    assert!(
        answer["renders"][0]["generated"]
            .as_str()
            .is_some_and(|l| l.contains("#42"))
    );
    assert_eq!(answer["renders"][1]["generated"], Value::Null);
    let small = "render model --views orbit --frames 2 --size 32x24 --side-by-side";
    for (style, name) in [("random:42", "random-42"), ("paintings/red.png", "red")] {
        json_of(folder, &format!("{small} --style {style} -o {name}"));
        for file in ["0000.png", "0001.png", "cameras.json"] {
            let single = fs::read(folder.join(name).join(file)).unwrap();
            let batch = fs::read(folder.join("out/model").join(name).join("orbit").join(file));
            assert!(batch.unwrap() == single, "{name} {file}");
        }
    }
}

#[test]
fn what_makes_no_sense_is_wrong_usage() {
    let folder = workplace();
    let folder = folder.path();
    for arguments in [
        "render model --side-by-side -o out",
        "render model --style paintings/red.png --side-by-side --depth -o out",
        "render model --fps 24 -o out",
        "render model --fps 24 -o out.png",
        "render model --fps 0 -o out.gif",
        "render model --fps 60 -o out.gif",
        "render model --style random:x -o out",
        "render model --shard 0/2 -o out.zip",
    ] {
        refused(folder, arguments, 2);
    }
}

#[cfg(unix)]
#[test]
fn an_ffmpeg_that_fails_is_quoted_and_leaves_nothing() {
    use std::os::unix::fs::PermissionsExt;

    let folder = workplace();
    let folder = folder.path();
    let program = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    };
    let lists = "case \"$*\" in *-encoders*) echo ' V....D libx264 H.264'; exit 0;; esac";
    program(
        "early",
        &format!("{lists}\necho first >&2\necho 'the disk is full' >&2\nexit 3"),
    );
    program(
        "late",
        &format!("{lists}\ncat >/dev/null\necho 'no trailer today' >&2\nexit 1"),
    );
    program("bare", "echo ' V....D mpeg4 something'");
    let small = "render model --frames 3 --size 64x48 --views orbit -o films/clip.mp4 --ffmpeg";
    for (name, parts) in [
        ("./early", &["clip.mp4", "the disk is full", ".gif"][..]),
        ("./late", &["clip.mp4", "no trailer today", ".gif"]),
        ("./bare", &["clip.mp4", "libx264", ".gif"]),
        (
            "./none",
            &["clip.mp4", "./none", "install", "IMPASTO_FFMPEG", ".gif"],
        ),
    ] {
        let said = refused(folder, &format!("{small} {name}"), 1);
        for part in parts {
            assert!(said.contains(part), "{name}: \"{part}\" is missing: {said}");
        }
    }
}
