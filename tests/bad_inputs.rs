//! Bad input of every kind, given to the real program: each is refused with one line that says
//! what, where and what to do, nothing is left behind, and docs/errors.md lists all of them.
//!
//! `IMPASTO_WRITE_ERRORS=1` rewrites that table.

// Pipes, devices and links are among the inputs.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![allow(
    clippy::semicolon_if_nothing_returned,
    reason = "what spoils an input is one expression"
)]

#[path = "bad_inputs/arguments.rs"]
mod arguments;
#[path = "bad_inputs/base.rs"]
mod base;
#[path = "bad_inputs/captures.rs"]
mod captures;
#[path = "bad_inputs/models.rs"]
mod models;
#[path = "bad_inputs/pictures.rs"]
mod pictures;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longer than any refusal takes: whatever still runs then would wait for ever.
const FOR_EVER: Duration = Duration::from_secs(120);
/// The messages, for people.
const TABLE: &str = "docs/errors.md";

/// One bad input.
pub struct Case {
    /// What is wrong with it, for people.
    pub what: &'static str,
    /// Makes it, in a folder that holds sound inputs.
    pub spoil: fn(&Path),
    /// What meets it.
    pub command: &'static str,
    /// Exit code.
    pub code: i32,
    /// What the message must name: what, where, what to do.
    pub says: &'static [&'static str],
}

/// A case that ends with exit code 1.
pub fn bad(
    what: &'static str,
    command: &'static str,
    spoil: fn(&Path),
    says: &'static [&'static str],
) -> Case {
    Case {
        what,
        spoil,
        command,
        code: 1,
        says,
    }
}

/// Runs the command in a folder; a run that does not end is killed and fails.
fn run(folder: &Path, command: &str) -> Output {
    let words = command
        .split_whitespace()
        .map(|word| word.replace('+', " "));
    let mut child = Command::new(env!("CARGO_BIN_EXE_impasto"))
        .args(words)
        .current_dir(folder)
        .env("IMPASTO_CACHE", "cache")
        .env("IMPASTO_WEIGHTS", "weights")
        .env("IMPASTO_DEVICE", "cpu")
        .env_remove("RUST_BACKTRACE")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > FOR_EVER {
            child.kill().unwrap();
            panic!("{command} hangs");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.wait_with_output().unwrap()
}

/// All paths below a folder with the sizes of files.
fn everything(folder: &Path) -> Vec<(PathBuf, u64)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let facts = fs::symlink_metadata(&path).unwrap();
        if facts.is_dir() {
            found.extend(everything(&path));
        }
        found.push((path, if facts.is_file() { facts.len() } else { 0 }));
    }
    found.sort();
    found
}

/// The message that a case ends with, or what is wrong about how it ends.
fn message(case: &Case, base: &Path) -> Result<String, String> {
    let folder = tempfile::tempdir().unwrap();
    base::copy(base, folder.path());
    (case.spoil)(folder.path());
    let before = everything(folder.path());
    let output = run(folder.path(), case.command);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let fault = |problem: &str| {
        Err(format!(
            "{} ({}): {problem}: {said}",
            case.what, case.command
        ))
    };
    if output.status.code() != Some(case.code) {
        return fault(&format!(
            "exit code {:?} instead of {}",
            output.status.code(),
            case.code
        ));
    }
    if !output.stdout.is_empty() {
        return fault("something on stdout");
    }
    if everything(folder.path()) != before {
        return fault("files were changed");
    }
    if said.contains("panicked") || said.contains("backtrace") || said.contains("os error") {
        return fault("not for people");
    }
    let errors: Vec<&str> = said
        .lines()
        .filter_map(|line| line.strip_prefix("error: "))
        .collect();
    let [error] = errors[..] else {
        return fault("not one line of error");
    };
    for part in case.says {
        if !error.contains(part) {
            return fault(&format!("\"{part}\" is missing"));
        }
    }
    Ok(error.replace(&*folder.path().to_string_lossy(), "/FOLDER"))
}

/// All messages, in the cases' order.
fn messages(cases: &[Case], base: &Path) -> Vec<Result<String, String>> {
    let next = AtomicUsize::new(0);
    let found = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                while let Some((i, case)) = {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    cases.get(i).map(|case| (i, case))
                } {
                    let said = message(case, base);
                    found.lock().unwrap().push((i, said));
                }
            });
        }
    });
    let mut found = found.into_inner().unwrap();
    found.sort_by_key(|(i, _)| *i);
    found.into_iter().map(|(_, said)| said).collect()
}

fn table(groups: &[(&str, Vec<Case>)], said: &[String]) -> String {
    let mut text = String::from(
        "# What Impasto says of bad input\n\n\
         Made by `tests/bad_inputs.rs`, which gives each of these inputs to the program and fails when \
         it says anything else; `IMPASTO_WRITE_ERRORS=1` rewrites this file. Exit code 1 unless \
         noted, one line on stderr, nothing written.\n",
    );
    let mut said = said.iter();
    for (title, cases) in groups {
        text += &format!("\n## {title}\n\n| input | command | message |\n|---|---|---|\n");
        for (case, said) in cases.iter().zip(said.by_ref()) {
            let cell = |text: &str| text.replace('|', "\\|").replace('<', "&lt;");
            let code = match case.code {
                1 => String::new(),
                code => format!(" (exit {code})"),
            };
            let command = case.command.replace('+', " ").replace('|', "\\|");
            text += &format!(
                "| {}{code} | `{command}` | {} |\n",
                cell(case.what),
                cell(said)
            );
        }
    }
    text
}

#[test]
fn every_bad_input_is_told_plainly() {
    let base = tempfile::tempdir().unwrap();
    base::make(base.path());
    let trained = run(
        base.path(),
        "train scene -o model --steps 1 --stage geometry --set style.hyper_width=32",
    );
    assert!(
        trained.status.success(),
        "{}",
        String::from_utf8_lossy(&trained.stderr)
    );
    let groups = [
        ("Captures", captures::cases()),
        ("Photos and masks", pictures::photos()),
        ("Paintings", pictures::paintings()),
        ("Models and networks", models::cases()),
        ("Settings and arguments", arguments::cases()),
    ];
    let cases: usize = groups.iter().map(|(_, cases)| cases.len()).sum();
    assert!(cases >= 60, "{cases} cases");
    let mut said = Vec::new();
    let mut faults = Vec::new();
    for result in groups
        .iter()
        .flat_map(|(_, cases)| messages(cases, base.path()))
    {
        match result {
            Ok(message) => said.push(message),
            Err(fault) => faults.push(fault),
        }
    }
    assert!(
        faults.is_empty(),
        "{} faults:\n{}",
        faults.len(),
        faults.join("\n")
    );
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(TABLE);
    let now = table(&groups, &said);
    if std::env::var_os("IMPASTO_WRITE_ERRORS").is_some() {
        fs::write(&path, &now).unwrap();
    }
    // What the system says of files is worded as Linux does.
    if cfg!(target_os = "linux") {
        let kept = fs::read_to_string(&path).unwrap_or_default();
        let changed: Vec<&str> = now.lines().filter(|line| !kept.contains(line)).collect();
        assert!(
            kept == now,
            "{TABLE} is out of date (IMPASTO_WRITE_ERRORS=1 rewrites it):\n{}",
            changed.join("\n")
        );
    }
}
