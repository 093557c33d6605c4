//! Frames that several processes render together, and batches: as many tasks as there may be, killed
//! and run again, leave what one process leaves.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, SystemTime};

use common::{capture, command, paintings, text};
use serde_json::{Value, json};
use tempfile::TempDir;

/// Settings with which a model trains in seconds.
const SMALL: [&str; 7] = [
    "style.patch=[36,44]",
    "style.generated=4",
    "field.sampling.occupancy.inner_grid=24",
    "field.sampling.occupancy.outer_grid=24",
    "field.inner.encoding.hash_grid.log2_entries=12",
    "field.outer.encoding.hash_grid.log2_entries=12",
    "geometry.samples=20000",
];

fn done(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("stdout is one JSON object")
}

fn json_of(folder: &Path, arguments: &str) -> Value {
    done(&command(folder, arguments).arg("--json").output().unwrap())
}

/// The command must fail with this exit code and one line that names `what`.
fn refused(folder: &Path, arguments: &str, code: i32, what: &[&str]) {
    let output = command(folder, arguments).output().unwrap();
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments}: {message}");
    for word in what {
        assert!(
            message.contains(word),
            "{arguments}: \"{message}\" lacks \"{word}\""
        );
    }
    assert!(output.stdout.is_empty());
}

/// A folder with a capture of the built-in scene and two paintings.
fn material() -> TempDir {
    let folder = capture();
    paintings(folder.path());
    folder
}

/// The bytes of all files below a folder, by their paths in it, but for the job's own.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            let below = contents(&path).into_iter();
            found.extend(below.map(|(path, bytes)| (format!("{name}/{path}"), bytes)));
        } else if name != "job.json" {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

/// Both folders hold the same files, byte for byte; their contents would be too long to print.
fn assert_same(found: &Path, wanted: &Path) {
    let (found, wanted) = (contents(found), contents(wanted));
    assert!(
        found.keys().eq(wanted.keys()),
        "{:?} instead of {:?}",
        found.keys(),
        wanted.keys()
    );
    for (name, bytes) in &wanted {
        assert!(found[name] == *bytes, "{name} differs");
    }
}

/// When the frames of a folder were last written.
fn times(folder: &Path) -> Vec<(String, SystemTime)> {
    let files = contents(folder).into_keys();
    let time = |name: &String| fs::metadata(folder.join(name)).unwrap().modified().unwrap();
    files.map(|name| (name.clone(), time(&name))).collect()
}

#[test]
fn shards_that_do_not_exist_are_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (shard, what) in [
        ("4/4", "0 to 3"),
        ("1", "I/N"),
        ("0/0", "I/N"),
        ("-1/2", "I/N"),
    ] {
        refused(
            folder,
            &format!("render m -o out --shard={shard}"),
            2,
            &[shard, what],
        );
        refused(
            folder,
            &format!("batch jobs.toml --shard={shard}"),
            2,
            &[shard, what],
        );
    }
    refused(
        folder,
        "render m -o out.png --shard 0/2",
        2,
        &["out.png", "folder"],
    );
    refused(
        folder,
        "render m -o out.gif --shard 0/2",
        2,
        &["out.gif", "folder"],
    );
    let styled = "render m -o out --shard 0/2 --style p.png";
    refused(folder, &format!("{styled} --refine 2s"), 2, &["--refine"]);
    refused(
        folder,
        &format!("{styled} --interpolate 3"),
        2,
        &["--interpolate"],
    );
    refused(folder, "render m -o out --shard 0/2", 1, &["no model"]);
    assert_eq!(fs::read_dir(folder).unwrap().count(), 0);
}

#[test]
fn a_batch_file_that_is_wrong_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    refused(
        folder,
        "batch jobs.toml",
        1,
        &["jobs.toml", "cannot be read"],
    );
    let wrong = [
        (
            "[[render]]\nmodels = [\"m\"]\nstile = [\"x.png\"]\n",
            ["line 3", "`stile`"],
        ),
        (
            "[[train]]\nscene = \"s\"\nmodel = \"m\"\nbudgte = \"9s\"\n",
            ["line 4", "`budgte`"],
        ),
        (
            "[[render]]\nmodels = [\"m\"]\nstyles = [\"a.png\", \"b/a.png\"]\n",
            ["items 0 and 1", "out/m/a"],
        ),
    ];
    for (file, what) in wrong {
        fs::write(folder.join("jobs.toml"), file).unwrap();
        refused(folder, "batch jobs.toml --list", 1, &what);
    }
}

#[test]
fn many_processes_leave_what_one_does() {
    let folder = material();
    let folder = folder.path();
    let small: String = SMALL.iter().map(|s| format!(" --set {s}")).collect();
    json_of(
        folder,
        &format!("train scene -o model --styles paintings --steps 20{small}"),
    );

    shards_make_the_single_run(folder);
    a_killed_task_goes_on(folder);
    other_jobs_are_refused(folder);
    the_command_line_for_kubernetes_takes_its_index(folder);
    a_batch_does_what_is_missing(folder);
    a_batch_trains_before_it_renders(folder);
}

const SHARED: &str = "render model --style paintings/red.png --style paintings/grey.png \
                      --strength 0.7 --frames 5 --size 40x30 --depth";

fn shards_make_the_single_run(folder: &Path) {
    json_of(folder, &format!("{SHARED} -o single"));
    let shard = |arguments: &str, threads: &str| {
        let arguments = format!("{SHARED} -o shared {arguments} --json");
        let mut command = command(folder, &arguments);
        done(&command.env("RAYON_NUM_THREADS", threads).output().unwrap())
    };
    // Whoever comes last completes the folder, and how many threads a task has does not show.
    let first = shard("--shard 2/3", "1");
    assert_eq!(
        [&first["rendered"], &first["kept"], &first["complete"]],
        [&json!(1), &json!(0), &json!(false)]
    );
    assert!(folder.join("shared/red/0002.png").exists());
    shard("--shard 0/3", "2");
    assert!(!folder.join("shared/red/cameras.json").exists());
    let last = shard("--shard 1/3", "3");
    assert_eq!(
        [&last["rendered"], &last["complete"]],
        [&json!(2), &json!(true)]
    );
    assert_same(&folder.join("shared"), &folder.join("single"));

    // Nothing is done twice, by however many tasks.
    let before = times(&folder.join("shared"));
    for again in ["--shard 1/3", "--shard 0/1"] {
        assert_eq!(shard(again, "2")["rendered"], json!(0));
    }
    assert_eq!(times(&folder.join("shared")), before);

    // A file that has gone is made again, and cameras.json says that all are there.
    fs::remove_file(folder.join("shared/grey/0004.depth.npy")).unwrap();
    let other = shard("--shard 0/3", "2");
    assert_eq!(
        [&other["rendered"], &other["complete"]],
        [&json!(0), &json!(false)]
    );
    assert!(!folder.join("shared/red/cameras.json").exists());
    assert_eq!(shard("--shard 1/3", "2")["rendered"], json!(1));
    assert_same(&folder.join("shared"), &folder.join("single"));
}

fn a_killed_task_goes_on(folder: &Path) {
    let render = "render model --style paintings/red.png --frames 24 --size 200x150";
    json_of(folder, &format!("{render} -o whole"));
    let arguments = format!("{render} -o killed --shard 0/1 --json");
    let mut task = command(folder, &arguments)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let killed = folder.join("killed");
    let frames = || {
        let listed = fs::read_dir(&killed).into_iter().flatten();
        let names = listed.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
        names.filter(|name| name.ends_with(".png")).count()
    };
    while frames() < 3 {
        assert!(
            task.try_wait().unwrap().is_none(),
            "the task ended by itself"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
    task.kill().unwrap();
    task.wait().unwrap();
    let there = frames();
    assert!((3..24).contains(&there), "{there}");
    assert!(!killed.join("cameras.json").exists());
    // What a task leaves that is killed while it writes.
    fs::write(killed.join(".0020.png.a1B2c3.tmp"), "half").unwrap();
    let before = times(&killed);

    let again = done(&command(folder, &arguments).output().unwrap());
    assert_eq!(
        [&again["kept"], &again["rendered"]],
        [&json!(there), &json!(24 - there)]
    );
    assert_same(&killed, &folder.join("whole"));
    let after = times(&killed);
    let kept = before.iter().filter(|(name, _)| name.ends_with(".png"));
    assert!(kept.clone().count() == there && kept.clone().all(|file| after.contains(file)));
}

fn other_jobs_are_refused(folder: &Path) {
    let shared = "render model --style paintings/red.png --style paintings/grey.png \
                  --frames 5 --size 40x30 --depth -o shared --shard 0/2";
    let refuse = |arguments: &str, what: &[&str]| refused(folder, arguments, 1, what);
    refuse(
        &format!("{shared} --strength 0.6"),
        &["shared", "another job", "strength"],
    );
    refuse(
        &format!("{shared} --strength 0.7 --views test"),
        &["cameras, frames"],
    );
    // Another painting of the same name.
    fs::create_dir(folder.join("other")).unwrap();
    fs::copy(
        folder.join("paintings/grey.png"),
        folder.join("other/red.png"),
    )
    .unwrap();
    let other = shared.replace("paintings/red.png", "other/red.png");
    refuse(&format!("{other} --strength 0.7"), &["differs: styles"]);
    // Frames of a single run, and a single run among shards.
    refuse(
        &format!("{SHARED} -o single --shard 0/2"),
        &["single", "job.json"],
    );
    refuse(&format!("{SHARED} -o shared"), &["shared", "shards"]);
    assert_same(&folder.join("shared"), &folder.join("single"));
}

/// As docs/cluster.md gives it to a shell.
fn the_command_line_for_kubernetes_takes_its_index(folder: &Path) {
    let page = include_str!("../docs/cluster.md");
    let mut lines = page.lines().map(|line| line.trim_start_matches([' ', '-']));
    let line = lines
        .find(|line| line.starts_with("exec impasto "))
        .unwrap();
    let painting = image::open(folder.join("paintings/red.png")).unwrap();
    painting.save(folder.join("starry.jpg")).unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_impasto")).parent().unwrap();
    let output = Command::new("/bin/sh")
        .args(["-c", line])
        .current_dir(folder)
        .env("PATH", program)
        .env("JOB_COMPLETION_INDEX", "31")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let frames: Vec<String> = contents(&folder.join("walk")).into_keys().collect();
    let wanted = (31..600).step_by(32);
    assert!(
        frames
            .iter()
            .cloned()
            .eq(wanted.map(|frame| format!("{frame:04}.png"))),
        "{frames:?}"
    );
}

const BATCH: &str = "
[[render]]
models = [\"model\"]
styles = [\"paintings\", \"missing.png\"]
views = [\"orbit\", \"test\"]
frames = 4
size = \"32x24\"
output = \"batch/{style}-{views}\"

[[render]]
models = [\"model\", \"nowhere\"]
frames = 2
size = \"32x24\"
output = \"batch/{model}\"
";

#[allow(clippy::too_many_lines, reason = "one story, step by step")]
fn a_batch_does_what_is_missing(folder: &Path) {
    fs::create_dir(folder.join("jobs")).unwrap();
    // Paths start at the file.
    fs::write(folder.join("jobs.toml"), BATCH).unwrap();
    let list = json_of(folder, "batch jobs.toml --list");
    let outputs: Vec<&str> = list["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|item| item["output"].as_str().unwrap())
        .collect();
    let wanted = [
        "batch/grey-orbit",
        "batch/red-orbit",
        "batch/missing-orbit",
        "batch/grey-test",
        "batch/red-test",
        "batch/missing-test",
        "batch/model",
        "batch/nowhere",
    ];
    assert_eq!(outputs, wanted);
    assert!(!folder.join("batch").exists());

    let batch = |arguments: &str| {
        let arguments = format!("batch ../jobs.toml {arguments} --json");
        let output = command(&folder.join("jobs"), &arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        assert!(text(&output.stderr).contains("error: some of the batch failed"));
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        answer
    };
    let counts = |answer: &Value| ["rendered", "kept"].map(|key| answer[key].as_u64().unwrap());
    // Two styles with 4 frames from the orbit and 1 test view, and 2 frames as photographed.
    let first = batch("--shard 0/3");
    let second = batch("--shard 1/3");
    let third = batch("--shard 2/3");
    let shares = [&first, &second, &third].map(|answer| counts(answer)[0]);
    assert_eq!(shares.iter().sum::<u64>(), 2 * (4 + 1) + 2);
    assert!(shares.iter().all(|share| *share >= 2), "{shares:?}");
    let failed = third["failed"].as_array().unwrap();
    assert!(
        failed
            .iter()
            .any(|f| f["item"] == 7 && f["problem"].as_str().unwrap().contains("no model"))
    );
    assert!(
        failed
            .iter()
            .any(|f| f["problem"].as_str().unwrap().contains("missing.png"))
    );

    let single = [
        (
            "grey-orbit",
            "--style paintings/grey.png --views orbit --frames 4",
        ),
        (
            "red-orbit",
            "--style paintings/red.png --views orbit --frames 4",
        ),
        ("red-test", "--style paintings/red.png --views test"),
        ("model", "--frames 2"),
    ];
    for (name, arguments) in single {
        json_of(
            folder,
            &format!("render model {arguments} --size 32x24 -o alone/{name}"),
        );
        assert_same(
            &folder.join("batch").join(name),
            &folder.join("alone").join(name),
        );
    }
    assert_eq!(counts(&batch("")), [0, 12]);
    // What failed is made good, and the batch then succeeds.
    fs::copy(folder.join("paintings/red.png"), folder.join("missing.png")).unwrap();
    fs::write(folder.join("jobs.toml"), BATCH.replace(", \"nowhere\"", "")).unwrap();
    let mended = json_of(folder, "batch jobs.toml");
    assert_eq!(
        (counts(&mended), mended["failed"].as_array().unwrap().len()),
        ([5, 12], 0)
    );
}

fn a_batch_trains_before_it_renders(folder: &Path) {
    let set: Vec<String> = SMALL.iter().map(|s| format!("{s:?}")).collect();
    let jobs = format!(
        "[[train]]\nscene = \"scene\"\nmodel = \"trained/square\"\nstage = \"geometry\"\nsteps = 3\nset = [{}]\n\
         [[render]]\nmodels = [\"trained/square\"]\nframes = 1\nsize = \"16x12\"\noutput = \"of/{{model}}\"\n",
        set.join(", ")
    );
    fs::write(folder.join("train.toml"), &jobs).unwrap();
    refused_items(
        folder,
        "batch train.toml --only render",
        &["not trained yet"],
    );
    let first = json_of(folder, "batch train.toml --only train");
    assert_eq!(
        [
            &first["models"][0]["trained"],
            &first["models"][0]["summary"]["geometry_steps"]
        ],
        [&json!(true), &json!(3)]
    );
    let model = fs::metadata(folder.join("trained/square/model.safetensors")).unwrap();
    let again = json_of(folder, "batch train.toml");
    assert_eq!(
        [&again["models"][0]["trained"], &again["rendered"]],
        [&json!(false), &json!(1)]
    );
    assert!(folder.join("of/square/cameras.json").exists());
    let kept = fs::metadata(folder.join("trained/square/model.safetensors")).unwrap();
    assert_eq!(kept.modified().unwrap(), model.modified().unwrap());

    // Another training does not take the folder, nor one whose model was trained by hand.
    fs::write(
        folder.join("train.toml"),
        jobs.replace("steps = 3", "steps = 4"),
    )
    .unwrap();
    refused_items(folder, "batch train.toml", &["another job", "steps"]);
    fs::write(
        folder.join("train.toml"),
        jobs.replace("trained/square", "model"),
    )
    .unwrap();
    refused_items(
        folder,
        "batch train.toml",
        &["model.safetensors", "job.json"],
    );
    // A mistake that is mended does not leave the folder taken.
    fs::write(
        folder.join("train.toml"),
        jobs.replace("\"scene\"", "\"none\"")
            .replace("square", "late"),
    )
    .unwrap();
    refused_items(folder, "batch train.toml", &["none"]);
    assert!(!folder.join("trained/late").exists());
}

/// Items fail; the rest is told on stdout.
fn refused_items(folder: &Path, arguments: &str, what: &[&str]) {
    let output = command(folder, arguments).arg("--json").output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let problem = answer["failed"][0]["problem"].as_str().unwrap();
    for word in what {
        assert!(problem.contains(word), "\"{problem}\" lacks \"{word}\"");
    }
}
