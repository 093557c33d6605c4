//! `impasto weights` as its users run it: listing, installing, and every way to fail.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#[path = "../crates/impasto-style/tests/torch_files/mod.rs"]
mod torch_files;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use impasto::paintings::{Recipe, paint};
use impasto::scene::builtin::{BuiltinOptions, write_capture};
use serde_json::{Value, json};
use torch_files::{SEQUENTIAL, Saved, TORCHVISION, random_vgg19, stream_form, zip_form};

/// Runs `impasto weights` in `folder`, weights being kept in its `kept`.
fn weights(folder: &Path, arguments: &[&str]) -> Output {
    with_path(folder, arguments, None)
}

/// The same with another search path for programs.
fn with_path(folder: &Path, arguments: &[&str], path: Option<&Path>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_impasto"));
    command.arg("weights").args(arguments).current_dir(folder);
    command.env("IMPASTO_WEIGHTS", "kept");
    if let Some(path) = path {
        command.env("PATH", path);
    }
    command.output().expect("the binary starts")
}

fn answer(output: &Output) -> Value {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{message}");
    serde_json::from_slice(&output.stdout).expect("stdout is one JSON object")
}

/// The command must have failed with exit code 1 and one error that names `what`, and have left no
/// weights behind.
fn refused(folder: &Path, output: &Output, what: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(
        output.stdout.is_empty() && !message.contains("panicked"),
        "{message}"
    );
    let errors: Vec<&str> = message
        .lines()
        .filter(|l| l.starts_with("error: "))
        .collect();
    assert_eq!(errors.len(), 1, "{message}");
    for word in what {
        assert!(
            errors[0].contains(word),
            "\"{}\" lacks \"{word}\"",
            errors[0]
        );
    }
    assert!(!folder.join("kept").exists(), "something was left behind");
}

#[test]
fn what_is_shipped_is_listed_with_source_and_licence() {
    let folder = tempfile::tempdir().unwrap();
    let list = answer(&weights(folder.path(), &["--json"]));
    let shipped = list["shipped"].as_array().unwrap();
    assert_eq!(shipped.len(), 3);
    assert!(shipped.iter().all(|s| s["whole"] == json!(true)), "{list}");
    assert_eq!(shipped[0]["licence"], "CC BY 4.0");
    assert_eq!(list["vgg19"]["state"], "missing");
    assert_eq!(list["vgg19"]["path"], "kept/vgg19.safetensors");
    let text = weights(folder.path(), &[]).stdout;
    let text = String::from_utf8(text).unwrap();
    for words in [
        "VGG-16",
        "style-VAE",
        "Oxford",
        "kept",
        "impasto weights --fetch vgg19",
    ] {
        assert!(text.contains(words), "{text}");
    }
    assert!(
        !folder.path().join("kept").exists(),
        "listing makes no folder"
    );
}

#[test]
fn a_checkpoint_becomes_an_installed_network() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let tensors = random_vgg19(5, "features.", TORCHVISION);
    fs::write(folder.join("vgg19.pth"), stream_form(&tensors)).unwrap();
    let added = answer(&weights(folder, &["--add", "vgg19.pth", "--json"]));
    assert_eq!(
        (&added["made_from"], &added["tensors"]),
        (&json!("torchvision"), &json!(19))
    );
    assert_eq!(added["form"], "PyTorch checkpoint (stream)");
    let listed = answer(&weights(folder, &["--json"]));
    assert_eq!(listed["vgg19"]["state"], "whole");
    assert_eq!(listed["vgg19"]["sha256"], added["sha256"]);

    // The installed file is one that can be installed elsewhere.
    fs::rename(
        folder.join("kept/vgg19.safetensors"),
        folder.join("copy.safetensors"),
    )
    .unwrap();
    let copied = answer(&weights(folder, &["--add", "copy.safetensors", "--json"]));
    assert_eq!(
        (&copied["sha256"], &copied["pictures"]),
        (&added["sha256"], &json!(0))
    );

    // Another one takes its place; nothing else is left in the folder.
    let mut tensors = random_vgg19(6, "", SEQUENTIAL);
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    tensors.push(Saved::new("0.weight", &[3, 3, 1, 1], identity.into()));
    tensors.push(Saved::new("0.bias", &[3], vec![0.0; 3]));
    fs::write(folder.join("vgg_normalised.pth"), zip_form(&tensors, "x")).unwrap();
    let again = answer(&weights(folder, &["--add", "vgg_normalised.pth", "--json"]));
    assert_eq!(
        (&again["made_from"], &again["pictures"]),
        (&json!("normalised"), &json!(0))
    );
    assert_ne!(again["sha256"], added["sha256"]);
    assert_eq!(fs::read_dir(folder.join("kept")).unwrap().count(), 1);

    let path = folder.join("kept/vgg19.safetensors");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 5]).unwrap();
    let listed = answer(&weights(folder, &["--json"]));
    assert_eq!(listed["vgg19"]["state"], "damaged");
}

/// Runs a command that uses installed weights.
fn impasto(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_impasto"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .env("IMPASTO_WEIGHTS", "kept")
        .env("IMPASTO_CACHE", "")
        .output()
        .expect("the binary starts")
}

#[test]
fn styles_are_learned_through_an_installed_vgg19_with_an_encoder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let options = BuiltinOptions {
        photos: 4,
        width: 40,
        height: 32,
        ..BuiltinOptions::default()
    };
    write_capture(&folder.join("scene"), &options).unwrap();
    fs::create_dir(folder.join("paintings")).unwrap();
    for seed in 0..3 {
        let painting = paint(&Recipe::random(seed), 64, 64);
        let path = folder.join(format!("paintings/{seed}.png"));
        painting.save(path).unwrap();
    }
    let train = "train scene -o model --styles paintings --steps 10 --json --set style.generated=0 \
                 --set style.patch=[16,20] --set style.perceptual=vgg19 --set style.pictures.side=64";
    let missing = impasto(folder, train);
    refused(
        folder,
        &missing,
        &["not installed", "impasto weights --add"],
    );

    let mut tensors = random_vgg19(6, "", SEQUENTIAL);
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    tensors.push(Saved::new("0.weight", &[3, 3, 1, 1], identity.into()));
    tensors.push(Saved::new("0.bias", &[3], vec![0.0; 3]));
    fs::write(folder.join("vgg.pth"), zip_form(&tensors, "x")).unwrap();
    answer(&weights(folder, &["--add", "vgg.pth", "--json"]));
    let output = impasto(folder, train);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        message.contains("train-encoder --perceptual vgg19"),
        "{message}"
    );
    assert!(
        !folder.join("model").exists(),
        "said before anything is made"
    );

    let encoder = "train-encoder --styles paintings -o mine.safetensors --steps 2 --generated 4 \
                   --perceptual vgg19 --layers relu4_1 --side 64 --json";
    answer(&impasto(folder, encoder));
    answer(&impasto(
        folder,
        &format!("{train} --encoder mine.safetensors"),
    ));
    let render = "render model --style paintings/0.png --views test -o sheet.png --json";
    answer(&impasto(folder, render));
}

#[test]
fn files_that_are_no_vgg19_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let add = |name: &str, bytes: &[u8]| {
        fs::write(folder.join(name), bytes).unwrap();
        weights(folder, &["--add", name])
    };
    let whole = stream_form(&random_vgg19(7, "features.", TORCHVISION));
    refused(
        folder,
        &add("cut.pth", &whole[..1 << 20]),
        &["cut.pth", "ends too early"],
    );
    refused(
        folder,
        &add("page.pth", b"<html>"),
        &["page.pth", "neither"],
    );
    let other = [Saved::new("layer1.weight", &[1], vec![1.0])];
    refused(
        folder,
        &add("resnet.pth", &zip_form(&other, "a")),
        &["no VGG-19", "layer1.weight"],
    );
    refused(
        folder,
        &add("vgg19-dcbb9e9d.pth", &whole),
        &["vgg19-dcbb9e9d.pth", "damaged", "SHA-256 begins with"],
    );
    refused(
        folder,
        &weights(folder, &["--add", "none.pth"]),
        &["none.pth", "cannot be read"],
    );
}

#[test]
fn a_folder_that_cannot_be_written_is_named_first() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("kept"), "in the way").unwrap();
    for arguments in [&["--add", "none.pth"], &["--fetch", "vgg19"]] {
        let output = weights(folder, arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(message.contains("cannot write kept"), "{message}");
    }
    assert_eq!(fs::read(folder.join("kept")).unwrap(), b"in the way");
}

#[test]
fn without_curl_a_download_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("programs");
    fs::create_dir(&empty).unwrap();
    let output = with_path(folder.path(), &["--fetch", "vgg19"], Some(&empty));
    let words = ["curl is not installed", "impasto weights --add FILE"];
    refused(folder.path(), &output, &words);
}

/// A `curl` of one line of shell, to which the output file is `$file`.
#[cfg(unix)]
fn fetch_with(folder: &Path, line: &str) -> Output {
    use std::os::unix::fs::PermissionsExt;
    let programs = folder.join("programs");
    fs::create_dir_all(&programs).unwrap();
    let curl = programs.join("curl");
    let find = "while [ \"$1\" != --output ]; do shift; done; file=$2";
    fs::write(&curl, format!("#!/bin/sh\n{find}\n{line}\n")).unwrap();
    fs::set_permissions(&curl, fs::Permissions::from_mode(0o755)).unwrap();
    with_path(folder, &["--fetch", "vgg19"], Some(&programs))
}

#[cfg(unix)]
#[test]
fn a_download_that_fails_leaves_nothing_and_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let offline = "echo 'curl: (6) Could not resolve host' >&2; exit 6";
    refused(
        folder,
        &fetch_with(folder, offline),
        &[
            "Could not resolve host",
            "https://",
            "impasto weights --add FILE",
        ],
    );
    let full = "echo half > \"$file\"; echo 'curl: (23) Failure writing' >&2; exit 23";
    refused(
        folder,
        &fetch_with(folder, full),
        &["kept", "room", "IMPASTO_WEIGHTS"],
    );
    let wrong = "echo 'not the file' > \"$file\"";
    refused(
        folder,
        &fetch_with(folder, wrong),
        &[
            "vgg19-dcbb9e9d.pth",
            "damaged",
            "its name says dcbb9e9d",
            "download it again",
        ],
    );
}

#[cfg(unix)]
#[test]
fn a_folder_whose_name_is_no_text_is_listed() {
    use std::os::unix::ffi::OsStrExt;
    let output = Command::new(env!("CARGO_BIN_EXE_impasto"))
        .args(["weights", "--json"])
        .env(
            "IMPASTO_WEIGHTS",
            std::ffi::OsStr::from_bytes(b"no\xfftext"),
        )
        .output()
        .unwrap();
    assert_eq!(answer(&output)["vgg19"]["state"], "missing");
}

#[test]
fn adding_and_fetching_at_once_is_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["--add", "x", "--fetch", "vgg19"][..],
        &["--fetch", "resnet"],
    ] {
        assert_eq!(weights(folder.path(), arguments).status.code(), Some(2));
    }
}
