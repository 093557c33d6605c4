//! Whatever fails is told in a sentence, and leaves nothing but the log.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::fs::{self, File};
use std::path::Path;

use common::{ERROR, Place};
use impasto_prepare::{
    Cameras, Matching, PrepareError, PrepareEvent, PrepareOptions, PrepareSummary, prepare,
};

const NAMES: [&str; 5] = ["a.png", "b.png", "c.png", "d.png", "e.png"];

fn place() -> Place {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    Place::new(&fixtures, &NAMES)
}

fn options(place: &Place) -> PrepareOptions {
    PrepareOptions {
        input: place.path("photos"),
        scene: place.path("scene"),
        frames: 10,
        matching: Matching::Auto,
        cameras: Cameras::Auto,
        colmap: place.path("colmap"),
        ffmpeg: place.path("no-ffmpeg"),
    }
}

/// The summary and the warnings, or the error.
fn run(options: &PrepareOptions) -> Result<(PrepareSummary, Vec<String>), PrepareError> {
    let mut warnings = Vec::new();
    let summary = prepare(options, &mut |event| {
        if let PrepareEvent::Warning { message } = event {
            warnings.push(message.clone());
        }
    })?;
    Ok((summary, warnings))
}

/// The run must fail with these words and leave these files.
fn fails(place: &Place, options: &PrepareOptions, words: &[&str], left: &[&str]) {
    let message = run(options).unwrap_err().to_string();
    for word in words {
        assert!(message.contains(word), "\"{message}\" lacks \"{word}\"");
    }
    assert!(!message.contains('\n'), "{message}");
    assert_eq!(place.scene(), left, "{message}");
}

#[test]
fn a_run_without_failures_makes_a_capture() {
    let place = place();
    let (summary, warnings) = run(&options(&place)).unwrap();
    assert_eq!(warnings, [""; 0]);
    assert_eq!(
        place.scene(),
        ["capture.png", "colmap.log", "images", "sparse"]
    );
    let photos = summary.photos;
    assert_eq!((photos.given, photos.used, photos.registered), (5, 5, 5));
    assert_eq!((summary.points, summary.models.as_slice()), (1, &[5][..]));
    assert!((summary.reprojection_error - ERROR).abs() < 1e-9);
    assert!((summary.track_length - 5.0).abs() < 1e-9);
    assert_eq!(summary.colmap, "3.8");
    let lens = &summary.lenses[0];
    assert_eq!((lens.model, lens.photos, lens.w), ("SIMPLE_RADIAL", 5, 64));
    assert!((lens.fl_x - 50.0).abs() < 1e-9 && (lens.field_of_view - 65.2).abs() < 0.1);
    assert_eq!(
        fs::read(place.path("scene/images/c.png")).unwrap(),
        fs::read(place.path("photos/c.png")).unwrap()
    );
    let log = fs::read_to_string(&summary.log).unwrap();
    assert!(log.contains(" mapper --database_path ") && log.contains("Features:        500"));
    // Five photos are too few to move the principal point.
    assert!(
        !place
            .calls()
            .iter()
            .any(|call| call.starts_with("bundle_adjuster"))
    );
}

#[test]
fn what_is_missing_is_named() {
    let place = place();
    let mut wrong = options(&place);
    wrong.input = place.path("nowhere");
    fails(
        &place,
        &wrong,
        &["nowhere", "no such file", "give a folder"],
        &[],
    );
    wrong.input = place.path("options");
    fails(&place, &wrong, &["options", "neither", "mp4"], &[]);
    wrong = options(&place);
    wrong.colmap = place.path("no-colmap");
    let words = [
        "COLMAP",
        "no-colmap",
        "apt install colmap",
        "IMPASTO_COLMAP",
    ];
    fails(&place, &wrong, &words, &["colmap.log"]);
    wrong = options(&place);
    wrong.input = place.path("clip.mp4");
    place.write("clip.mp4", "no video");
    let words = [
        "ffmpeg",
        "no-ffmpeg",
        "apt install ffmpeg",
        "IMPASTO_FFMPEG",
    ];
    fails(&place, &wrong, &words, &["colmap.log"]);
}

#[test]
fn too_few_photos_are_refused_with_reasons() {
    let place = place();
    for name in ["a.png", "b.png", "c.png"] {
        place.write(&format!("photos/{name}"), "no photo");
    }
    let words = ["2 usable", "5 file(s)", "a.png", "b.png", "at least 3"];
    fails(&place, &options(&place), &words, &["colmap.log"]);
    fs::remove_dir_all(place.path("photos")).unwrap();
    fs::create_dir(place.path("photos")).unwrap();
    place.write("photos/a.heic", "from a phone");
    let words = ["0 usable", "heic is not read", "convert it to JPEG"];
    fails(&place, &options(&place), &words, &["colmap.log"]);
}

#[test]
fn a_crash_names_the_command_and_what_it_said() {
    let place = place();
    place.write(
        "exhaustive_matcher.sh",
        "echo 'ERROR: database is locked'; echo done; exit 3",
    );
    let words = [
        "COLMAP exhaustive_matcher",
        "exit code 3",
        "database is locked",
        "colmap.log",
    ];
    fails(&place, &options(&place), &words, &["colmap.log"]);
    place.write("exhaustive_matcher.sh", "kill -SEGV $$");
    fails(&place, &options(&place), &["signal 11"], &["colmap.log"]);
    let log = fs::read_to_string(place.path("scene/colmap.log")).unwrap();
    assert!(log.contains("exhaustive_matcher"));
}

#[test]
fn a_kill_and_a_lack_of_memory_say_to_use_less() {
    let place = place();
    place.write("mapper.sh", "kill -9 $$");
    let words = [
        "COLMAP mapper",
        "killed",
        "memory",
        "smaller photos",
        "colmap.log",
    ];
    fails(&place, &options(&place), &words, &["colmap.log"]);
    let thrown = "echo \"terminate called after throwing an instance of 'std::bad_alloc'\"";
    place.write("mapper.sh", &format!("{thrown}; kill -ABRT $$"));
    fails(
        &place,
        &options(&place),
        &["memory ran out", "smaller photos"],
        &["colmap.log"],
    );
}

#[test]
fn nothing_registered_says_how_to_take_photos() {
    let place = place();
    fs::remove_dir_all(place.path("models")).unwrap();
    let words = ["0 of 5", "overlap", "colmap.log"];
    fails(&place, &options(&place), &words, &["colmap.log"]);
    let mut sequential = options(&place);
    sequential.matching = Matching::Sequential;
    fails(
        &place,
        &sequential,
        &["--matching exhaustive"],
        &["colmap.log"],
    );
    place.model(0, &NAMES[..2]);
    fails(&place, &options(&place), &["2 of 5"], &["colmap.log"]);
}

#[test]
fn a_mapper_that_breaks_is_no_lack_of_overlap() {
    let place = place();
    place.write(
        "mapper.sh",
        "echo 'ERROR: cannot open the database'; exit 1",
    );
    fails(
        &place,
        &options(&place),
        &["failed", "cannot open the database"],
        &["colmap.log"],
    );
}

#[test]
fn of_two_models_the_larger_is_kept_and_the_other_named() {
    let place = place();
    place.model(0, &NAMES[..2]);
    place.model(1, &NAMES[1..4]);
    let (summary, warnings) = run(&options(&place)).unwrap();
    assert_eq!(summary.models, [3, 2]);
    assert_eq!(summary.in_other_models, ["a.png"]);
    assert_eq!(summary.not_registered, ["a.png", "e.png"]);
    for word in ["2 separate models", "3 and 2 photos", "a.png, e.png"] {
        assert!(warnings[0].contains(word), "{warnings:?}");
    }
    let scene = impasto_scene::load(&place.path("scene"), &Default::default()).unwrap();
    let names: Vec<&str> = scene.photos.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, &NAMES[1..4]);
}

#[test]
fn a_broken_model_is_told() {
    let place = place();
    let images = place.path("models/0/images.bin");
    let bytes = fs::read(&images).unwrap();
    fs::write(&images, &bytes[..bytes.len() - 9]).unwrap();
    fails(
        &place,
        &options(&place),
        &["model cannot be used", "images.bin"],
        &["colmap.log"],
    );
}

#[test]
fn options_are_those_of_the_installed_version() {
    let place = place();
    let new = "COLMAP 3.13.0 (Commit abc)\n  --FeatureExtraction.use_gpu arg (=1)\n  \
               --FeatureExtraction.num_threads arg (=-1)\n  --FeatureMatching.use_gpu arg (=1)\n";
    place.write("options", new);
    let (summary, _) = run(&options(&place)).unwrap();
    assert_eq!(summary.colmap, "3.13.0");
    let calls = place.calls();
    assert!(
        calls[0].contains("--FeatureExtraction.use_gpu 0"),
        "{calls:?}"
    );
    assert!(
        calls[0].contains("--FeatureExtraction.num_threads "),
        "{calls:?}"
    );
    assert!(
        calls[1].contains("--FeatureMatching.use_gpu 0"),
        "{calls:?}"
    );
    assert!(
        !calls
            .iter()
            .any(|call| call.contains("Sift") || call.contains("block_size"))
    );

    place.write("options", "COLMAP 5.0\n  --something.else arg\n");
    let mut other = options(&place);
    other.scene = place.path("other");
    let message = run(&other).unwrap_err().to_string();
    for word in [
        "COLMAP (5.0)",
        "SiftExtraction.use_gpu",
        "feature_extractor",
        "3.8",
    ] {
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn many_photos_of_one_camera_get_a_richer_lens_and_are_adjusted_again() {
    let names: Vec<String> = (0..24).map(|i| format!("{i:04}.png")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let place = Place::new(&fixtures, &names);
    run(&options(&place)).unwrap();
    let calls = place.calls();
    assert!(
        calls[0].contains("--ImageReader.camera_model OPENCV"),
        "{calls:?}"
    );
    assert!(
        calls[0].contains("--ImageReader.single_camera 1"),
        "{calls:?}"
    );
    let last = calls.last().unwrap();
    assert!(last.starts_with("bundle_adjuster") && last.contains("refine_principal_point 1"));

    // When that fails, the capture is made all the same.
    place.write("bundle_adjuster.sh", "exit 1");
    let mut again = options(&place);
    again.scene = place.path("again");
    again.cameras = Cameras::One;
    let (summary, warnings) = run(&again).unwrap();
    assert_eq!(summary.photos.registered, 24);
    assert!(warnings[0].contains("principal point"), "{warnings:?}");
}

#[test]
fn a_folder_with_other_files_is_left_alone() {
    let place = place();
    fs::create_dir_all(place.path("scene/images")).unwrap();
    place.write("scene/images/mine.jpg", "mine");
    fails(
        &place,
        &options(&place),
        &["scene", "images", "choose another"],
        &["images"],
    );
    assert!(place.path("scene/images/mine.jpg").is_file());
    let mut inside = options(&place);
    inside.scene = place.path("photos");
    assert!(run(&inside).unwrap_err().to_string().contains("a.png"));
}

#[test]
fn an_interrupted_or_failed_run_is_begun_anew() {
    let place = place();
    place.write("mapper.sh", "exit 7");
    run(&options(&place)).unwrap_err();
    fs::remove_file(place.path("mapper.sh")).unwrap();
    // As a kill between two renames leaves it.
    for folder in ["scene/.impasto-prepare/models/0", "scene/images"] {
        fs::create_dir_all(place.path(folder)).unwrap();
    }
    place.write("scene/.impasto-prepare/models/0/images.bin", "old");
    place.write("scene/images/old.png", "old");
    run(&options(&place)).unwrap();
    assert!(!place.path("scene/images/old.png").exists());
    let message = run(&options(&place)).unwrap_err().to_string();
    assert!(message.contains("holds other files already"), "{message}");
}

#[test]
fn two_runs_on_one_folder_are_one_too_many() {
    let place = place();
    fs::create_dir_all(place.path("scene/.impasto-prepare")).unwrap();
    let lock = File::create(place.path("scene/.impasto-prepare/lock")).unwrap();
    lock.lock().unwrap();
    let words = ["another process", "scene"];
    fails(&place, &options(&place), &words, &[".impasto-prepare"]);
    drop(lock);
    run(&options(&place)).unwrap();
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let place = place();
    let mut below = options(&place);
    below.scene = place.path("options/below");
    let message = run(&below).unwrap_err().to_string();
    assert!(
        message.contains("cannot write") && message.contains("below"),
        "{message}"
    );
}
