//! The command as its users run it: wrong input, and the whole way from photos to pictures.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
mod common;
#[path = "cli/study.rs"]
mod study;

use std::fs;
use std::path::Path;

use common::{capture, everything, impasto, text};
use serde_json::{Value, json};

/// The command must fail with exit code 1 and one line that names `what`, and change no file.
fn refused(folder: &Path, arguments: &str, what: &[&str]) {
    let before = everything(folder);
    let output = impasto(folder, arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments}: {message}");
    let errors: Vec<&str> = message
        .lines()
        .filter(|l| l.starts_with("error: "))
        .collect();
    assert_eq!(errors.len(), 1, "{arguments}: {message}");
    assert!(!message.contains("panicked"), "{message}");
    for word in what {
        assert!(
            errors[0].contains(word),
            "{arguments}: \"{}\" lacks \"{word}\"",
            errors[0]
        );
    }
    assert!(
        output.stdout.is_empty(),
        "{arguments}: {}",
        text(&output.stdout)
    );
    assert_eq!(
        everything(folder),
        before,
        "{arguments} left something behind"
    );
}

fn edit_transforms(folder: &Path, edit: impl FnOnce(&mut Value)) {
    let path = folder.join("scene/transforms.json");
    let mut value: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    edit(&mut value);
    fs::write(&path, value.to_string()).unwrap();
}

const TRAIN: &str = "train scene -o model --steps 2";

#[test]
fn a_capture_that_is_not_there_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), TRAIN, &["scene", "no such file or folder"]);
    fs::create_dir(folder.path().join("scene")).unwrap();
    refused(folder.path(), TRAIN, &["scene", "empty", "Supported"]);
    refused(folder.path(), "info scene", &["scene", "empty"]);
    refused(folder.path(), "render scene -o out", &["no model"]);
}

#[test]
fn bad_photos_are_named() {
    let folder = capture();
    let photo = folder.path().join("scene/images/0003.png");
    let bytes = fs::read(&photo).unwrap();
    fs::write(&photo, &bytes[..bytes.len() / 2]).unwrap();
    refused(folder.path(), TRAIN, &["0003.png", "not a usable photo"]);
    fs::remove_file(&photo).unwrap();
    refused(folder.path(), TRAIN, &["0003.png", "missing"]);
}

#[test]
fn a_pose_that_is_no_rotation_is_named() {
    let folder = capture();
    edit_transforms(folder.path(), |file| {
        file["frames"][2]["transform_matrix"][0] = json!([2.0, 0.0, 0.0, 1.0]);
    });
    refused(folder.path(), TRAIN, &["0002.png", "rotation"]);
}

#[test]
fn an_unknown_lens_is_named() {
    let folder = capture();
    edit_transforms(folder.path(), |file| {
        file["camera_model"] = json!("OPENCV_FISHEYE");
    });
    refused(folder.path(), TRAIN, &["OPENCV_FISHEYE", "not supported"]);
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let folder = capture();
    fs::write(folder.path().join("file"), "in the way").unwrap();
    for output in ["file", "file/below", "scene/transforms.json/model"] {
        refused(
            folder.path(),
            &format!("train scene -o {output}"),
            &["cannot write", output],
        );
    }
    refused(folder.path(), "demo --out file/below", &["cannot write"]);
    refused(
        folder.path(),
        "eval scene --styles scene -o file/below",
        &["cannot write"],
    );
    refused(
        folder.path(),
        "render scene -o file/below/x.gif",
        &["cannot write"],
    );
}

#[test]
fn presets_are_described_and_the_paper_has_its_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let paper = json_of(folder.path(), "info --preset paper");
    assert_eq!(
        (&paper["kind"], &paper["levels"]),
        (&json!("preset"), &json!(2))
    );
    let parameters = &paper["parameters"];
    for (key, count) in [
        ("per_level", 340_680),
        ("all_levels", 681_360),
        ("hypernetworks", 16_715_020),
    ] {
        assert_eq!(parameters[key], json!(count), "{key}");
    }
    assert_eq!(
        parameters["hypernetwork_by_volume"],
        json!([4_178_755, 4_178_755])
    );
    assert_eq!(
        json_of(folder.path(), "info --preset fast")["levels"],
        json!(1)
    );
}

#[test]
fn what_is_not_there_yet_is_said_plainly() {
    let folder = tempfile::tempdir().unwrap();
    refused(
        folder.path(),
        "render m -o clip.avi",
        &["avi", "not supported", ".mp4", ".gif"],
    );
    refused(
        folder.path(),
        "train s -o m --set geometry.gird_rate=1",
        &["gird_rate", "geometry.grid_rate"],
    );
}

#[test]
fn a_painter_is_learned_on_models_and_goes_on() {
    let folder = capture();
    let folder = folder.path();
    small_model(folder);
    let learn =
        "train-painter --scenes model model --styles paintings --steps 2 --set style.patch=[36,44]";
    let first = json_of(folder, &format!("{learn} -o one.safetensors"));
    assert_eq!((&first["scenes"], &first["steps"]), (&json!(2), &json!(2)));
    // Two paintings, each whole and in two crops.
    assert_eq!(first["pictures"], json!(6));
    json_of(
        folder,
        &format!("{learn} --init one.safetensors -o two.safetensors"),
    );
    let [one, two] =
        ["one", "two"].map(|n| fs::read(folder.join(format!("{n}.safetensors"))).unwrap());
    assert!(one.len() == two.len() && one != two && one.len() < 4 << 20);
    let other =
        format!("{learn} --init one.safetensors --set style.hyper_width=32 -o no.safetensors");
    refused(folder, &other, &["one.safetensors", "hypernetwork.0"]);
    refused(
        folder,
        &format!("{learn} --init none -o no.safetensors"),
        &["none", "no such file", "train-painter"],
    );
}

#[test]
fn wrong_usage_exits_with_two() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("p.png"), "").unwrap();
    for arguments in [
        "",
        "paint",
        "train scene",
        "train scene -o model --budget soon",
        "train scene -o model --budget 1m --steps 3",
        "train scene -o model --set nonsense",
        "render m -o out --views around",
        "render m -o out --strength 2 --style p.png",
        "render m -o out --style p.png:0.5 --style p.png",
        "render m -o out.gif --depth",
        "render m -o out --size 3",
        "render m -o x.png --interpolate 3",
        "render m -o x.png --interpolate 3 --style p.png",
        "render m -o x.png --interpolate 3 --style p.png --style p.png --style p.png",
        "render m -o x.png --interpolate 1 --style p.png --style p.png",
        "render m -o x.png --interpolate 3 --style p.png:1 --style p.png:1",
        "render m -o out --interpolate 3 --style p.png --style p.png",
        "render m -o x.png --interpolate 3 --frames 2 --style p.png --style p.png",
        "render m -o x.png --interpolate 3 --refine 2s --style p.png --style p.png",
        "render m -o x.png --refine 2s",
        "render m -o x.png --style p.png --save-look l.safetensors",
        "render m -o x.png --style p.png --look l.safetensors",
        "render m -o x.png --stroke-strength 0.5",
        "eval m --styles s --reconstruct 5s",
        "eval m --styles s --against wct --wct-weights w --reconstruct-paintings 0",
        "train-encoder",
        "train-encoder --styles s",
        "train-encoder --check",
        "train-encoder --check f --heldout h --steps 3",
        "train-encoder --styles s -o f --layers relu9",
        "study",
        "study make m --styles s -o out",
        "study make m --styles s -o out --against wct",
        "study summary out",
    ] {
        let output = impasto(folder.path(), arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments}: {}",
            text(&output.stderr)
        );
        assert!(output.stdout.is_empty());
    }
    assert_eq!(everything(folder.path()).len(), 1);
    assert_eq!(impasto(folder.path(), "--help").status.code(), Some(0));
}

fn json_of(folder: &Path, arguments: &str) -> Value {
    let output = impasto(folder, &format!("{arguments} --json"));
    assert!(
        output.status.success(),
        "{arguments}: {}",
        text(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).expect("stdout is one JSON object")
}

/// Arguments for a model that trains in seconds.
fn small() -> String {
    let settings = [
        "style.patch=[36,44]",
        "style.generated=6",
        "field.sampling.occupancy.inner_grid=24",
        "field.sampling.occupancy.outer_grid=24",
        "field.inner.encoding.hash_grid.log2_entries=12",
        "field.outer.encoding.hash_grid.log2_entries=12",
        "geometry.samples=20000",
    ];
    settings.iter().map(|s| format!(" --set {s}")).collect()
}

/// A model that trains in seconds.
fn small_model(folder: &Path) -> Value {
    fs::create_dir(folder.join("paintings")).unwrap();
    for (name, shade) in [("red.png", 180), ("grey.png", 90)] {
        let picture = image::RgbImage::from_fn(64, 64, |x, y| {
            image::Rgb([shade, (x * 3) as u8, ((x ^ y) * 4) as u8])
        });
        picture.save(folder.join("paintings").join(name)).unwrap();
    }
    let small = small();
    json_of(
        folder,
        &format!("train scene -o model --styles paintings --steps 40{small}"),
    )
}

#[test]
fn photos_become_a_model_and_pictures() {
    let folder = capture();
    let folder = folder.path();
    let scene = json_of(folder, "info scene");
    assert_eq!(
        (&scene["photos"], &scene["synthetic"]),
        (&json!(8), &json!(true))
    );

    let summary = small_model(folder);
    assert_eq!(summary["synthetic"], true);
    assert!(
        summary["psnr"].as_f64().is_some_and(|psnr| psnr > 5.0),
        "{summary}"
    );
    let model = json_of(folder, "info model");
    assert_eq!(
        (&model["kind"], &model["synthetic"]),
        (&json!("model"), &json!(true))
    );

    one_style_in_a_folder(folder);
    several_styles_side_by_side(folder);
    strength_and_mixes(folder);
    between_styles(folder);
    a_report(folder);
    refused_paintings(folder);
    study::is_made_and_counted(folder);
}

fn one_style_in_a_folder(folder: &Path) {
    let answer = json_of(
        folder,
        "render model --style paintings/red.png --views test --depth -o out",
    );
    assert_eq!(answer["styles"], json!(["red"]));
    let cameras: Value =
        serde_json::from_slice(&fs::read(folder.join("out/cameras.json")).unwrap()).unwrap();
    let frames = cameras["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 1);
    assert_eq!(
        (&frames[0]["file"], &frames[0]["w"]),
        (&json!("0000.png"), &json!(56))
    );
    assert!(
        frames[0]["photo"]
            .as_str()
            .is_some_and(|name| name.contains("0000"))
    );
    assert_eq!(frames[0]["camera_to_world"][3], json!([0.0, 0.0, 0.0, 1.0]));
    assert_eq!(
        image::open(folder.join("out/0000.png"))
            .unwrap()
            .to_rgb8()
            .dimensions(),
        (56, 42)
    );
    let depth = fs::read(folder.join("out/0000.depth.npy")).unwrap();
    assert!(depth.starts_with(b"\x93NUMPY") && depth.len() == 128 + 56 * 42 * 4);
    let names = everything(&folder.join("out"));
    assert_eq!(names.len(), 3, "{names:?}");

    // A camera file that was written can be rendered from.
    let again = json_of(
        folder,
        "render model --views out/cameras.json --frames 1 -o again",
    );
    assert_eq!(again["views"], 1);
}

fn several_styles_side_by_side(folder: &Path) {
    let styles = "--style paintings/red.png --style paintings/grey.png";
    let orbit = "--views orbit --frames 3 --size 32x24";
    json_of(folder, &format!("render model {styles} {orbit} -o both"));
    for style in ["red", "grey"] {
        assert!(folder.join("both").join(style).join("0002.png").is_file());
        assert!(
            folder
                .join("both")
                .join(style)
                .join("cameras.json")
                .is_file()
        );
    }
    let films = json_of(
        folder,
        &format!("render model {styles} {orbit} -o clip.gif"),
    );
    assert_eq!(films["outputs"], json!(["clip.red.gif", "clip.grey.gif"]));
    assert!(
        fs::read(folder.join("clip.red.gif"))
            .unwrap()
            .starts_with(b"GIF89a")
    );
    json_of(
        folder,
        &format!("render model {styles} {orbit} -o sheet.png"),
    );
    let sheet = image::open(folder.join("sheet.png")).unwrap();
    assert!(sheet.width() > 2 * 32 && sheet.width() < 3 * 32 && sheet.height() > 3 * 24);
}

/// Strength 0 is the photo's look, a mix of one painting is that painting, and a refined look is
/// neither the photo's nor the predicted one.
fn strength_and_mixes(folder: &Path) {
    let view = "--views test --size 28x21";
    let picture = |name: &str, arguments: &str| {
        json_of(
            folder,
            &format!("render model {view} {arguments} -o {name}"),
        );
        image::open(folder.join(name)).unwrap().to_rgb8()
    };
    let photo = picture("photo.png", "");
    let red = picture("red.png", "--style paintings/red.png");
    assert_ne!(photo, red);
    assert_eq!(
        picture("none.png", "--style paintings/red.png --strength 0"),
        photo
    );
    let mix = "--style paintings/red.png:2 --style paintings/grey.png:0";
    assert_eq!(picture("mix.png", mix), red);
    let refined = picture(
        "closer.png",
        "--style paintings/red.png --refine 1s --save-look red.safetensors",
    );
    assert!(refined != red && refined != photo);
    // What was kept is what was rendered, put on as any other look.
    let look = "--look red.safetensors";
    assert_eq!(picture("again.png", look), refined);
    assert_eq!(
        picture("again-none.png", &format!("{look} --strength 0")),
        photo
    );
    assert_ne!(
        picture("bold.png", &format!("{look} --stroke-size 2")),
        refined
    );
}

/// The ends of a row are the styles themselves.
fn between_styles(folder: &Path) {
    let view = "--views test --size 40x30";
    let rendered = |arguments: &str, name: &str| {
        let answer = json_of(
            folder,
            &format!("render model {view} {arguments} -o {name}"),
        );
        let picture = image::open(folder.join(name)).unwrap().to_rgb8();
        (answer, picture)
    };
    let (red, grey) = ("--style paintings/red.png", "--style paintings/grey.png");
    let (answer, row) = rendered(&format!("{red} {grey} --interpolate 3"), "row.png");
    assert_eq!(answer["styles"], json!(["red", "grey"]));
    assert_eq!(
        (&answer["rows"], &answer["columns"]),
        (&json!(1), &json!(3))
    );
    let step = |key: &str| answer[key].as_f64().unwrap();
    assert!(0.0 < step("mean_step") && step("mean_step") <= step("largest_step"));
    let (gap, band) = (4, 11);
    let cell = |i: u32| {
        let cell = image::imageops::crop_imm(&row, gap + i * (40 + gap), band + gap, 40, 30);
        cell.to_image()
    };
    assert_eq!(cell(0), rendered(red, "end.png").1);
    assert_eq!(cell(2), rendered(grey, "end.png").1);
    assert!(cell(1) != cell(0) && cell(1) != cell(2));

    let four = format!("{red} {grey} {grey} {red} --interpolate 2");
    let (answer, square) = rendered(&four, "square.png");
    assert_eq!(answer["rows"], json!(2));
    assert_eq!(square.dimensions(), (3 * gap + 80, 3 * gap + 60 + 2 * band));
}

/// The page, the table and what was printed are all there and agree.
fn a_report(folder: &Path) {
    let eval = "eval model --styles paintings --frames 9 --against photo -o report --json";
    let output = impasto(folder, eval);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let read = |name: &str| fs::read_to_string(folder.join("report").join(name)).unwrap();
    assert_eq!(text(&output.stdout), read("report.json"));
    let names = everything(&folder.join("report"));
    assert_eq!(names.len(), 3, "{names:?}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["command"], json!(format!("impasto {eval}")));
    assert_eq!(
        (&found["settings"]["frame_size"], &found["synthetic"]),
        (&json!([56, 42]), &json!(true))
    );
    assert!(
        found["seconds"]
            .as_f64()
            .is_some_and(|seconds| seconds > 0.0)
    );
    // A head, and two methods' two paintings and means.
    let table = read("report.csv");
    assert_eq!(table.lines().count(), 1 + 2 * 3);
    let e100 = &found["methods"]["impasto"]["short"]["e100"];
    let mean = table.lines().find(|line| line.starts_with("mean,impasto,"));
    let mean: f64 = mean.unwrap().split(',').nth(7).unwrap().parse().unwrap();
    assert_eq!(json!(mean), *e100);
    let page = read("report.html");
    assert!(page.contains(&format!("{mean:.3}")) && page.contains("Worst pairs"));
    // The paintings, and three pictures of each with two methods; the walk for both paintings, and
    // unstylised.
    assert!(page.contains("All 9 frames with the first 2 paintings"));
    assert!(page.matches("data:image/jpeg;base64,").count() >= 2 + 2 * 2 * 2 + 3 * 9);
}

/// Sub-folders count, a second look at the same paintings is none, and a model takes the encoder.
#[test]
fn encoders_are_trained_checked_and_used() {
    let folder = capture();
    let folder = folder.path();
    for (name, shade) in [("a.png", 20), ("b.png", 120), ("deep/c.png", 220)] {
        let path = folder.join("paintings").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let picture =
            image::RgbImage::from_fn(48, 48, |x, y| image::Rgb([shade, (x * 5) as u8, y as u8]));
        picture.save(path).unwrap();
    }
    fs::write(folder.join("paintings/notes.txt"), "no picture").unwrap();
    let train = "train-encoder --styles paintings -o mine.safetensors --layers relu4_1";
    let answer = json_of(folder, &format!("{train} --steps 2 --generated 2"));
    assert_eq!(answer["heldout"]["input"], "relu4_1");
    assert_eq!(answer["heldout"]["paintings"], 1);
    let check = json_of(
        folder,
        "train-encoder --check mine.safetensors --heldout paintings",
    );
    assert_eq!(
        (&check["paintings"], &check["unreadable"]),
        (&json!(3), &json!(1))
    );
    let small = small();
    let run = "train scene -o model --styles paintings --encoder mine.safetensors --steps 4";
    let summary = json_of(folder, &format!("{run}{small}"));
    assert_eq!(
        (&summary["paintings"], &summary["unreadable_paintings"]),
        (&json!(3), &json!(1))
    );
    assert_eq!(json_of(folder, "info model")["encoder"]["input"], "relu4_1");
    a_walk_is_evaluated(folder);
    json_of(
        folder,
        "render model --style paintings/deep/c.png --frames 1 -o c.png",
    );

    let shipped = json_of(folder, "train-encoder --check --heldout paintings");
    assert_eq!(shipped["encoder"], "built-in");
    assert!(fs::read_dir(folder.join("cache")).unwrap().count() >= 2);
    refused(
        folder,
        "train-encoder --check paintings/a.png --heldout paintings",
        &["a.png", "safetensors"],
    );
    refused(
        folder,
        "train-encoder --styles none -o x.safetensors",
        &["none", "cannot be read"],
    );
    refused(
        folder,
        "train scene -o m --encoder paintings/a.png --steps 2 --set style.patch=[36,42]",
        &["a.png", "safetensors"],
    );
}

/// Of the model of [`encoders_are_trained_checked_and_used`].
fn a_walk_is_evaluated(folder: &Path) {
    let measured = json_of(folder, "eval model --styles paintings --frames 9");
    assert_eq!(measured["unreadable"].as_array().unwrap().len(), 1);
    let methods = &measured["methods"];
    for name in ["impasto", "photo"] {
        for range in ["short", "long"] {
            let found = &methods[name][range];
            let pairs = [&found["pairs"], &found["dropped"]].map(|n| n.as_u64().unwrap());
            assert_eq!(
                pairs.iter().sum::<u64>(),
                if range == "short" { 8 } else { 2 }
            );
            assert!(found["e100"].as_f64().unwrap() >= 0.0);
        }
    }
    let photo = &methods["photo"];
    assert_eq!(
        (&photo["sharpness"], &photo["style_gain"]),
        (&json!(1.0), &json!(0.0))
    );
    let without = json_of(folder, "eval model --styles paintings --frames 0");
    assert!(without["methods"]["impasto"]["short"].is_null());
}

fn refused_paintings(folder: &Path) {
    fs::write(folder.join("notes.png"), "not an image").unwrap();
    refused(
        folder,
        "render model --style notes.png -o p",
        &["notes.png", "not a usable painting"],
    );
    refused(
        folder,
        "render model --style none.jpg -o p",
        &["none.jpg", "cannot be read"],
    );
    refused(
        folder,
        "render model --views none.json -o p",
        &["none.json", "cannot be read"],
    );
    fs::create_dir(folder.join("empty")).unwrap();
    refused(
        folder,
        "train scene -o m --styles empty --steps 2 --set style.patch=[36,42]",
        &["empty"],
    );
}
