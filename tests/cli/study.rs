//! `impasto study`: a page is made, answered, and the answers counted.

use std::fs;
use std::path::Path;

use impasto_style::write_f16;
use serde_json::{Value, json};

use super::{impasto, json_of, refused, text};

/// Channels of the encoder's convolutions from the picture inwards, by level, as `wct` expects them.
const LEVELS: [&[(&str, usize)]; 4] = [
    &[("conv11", 24)],
    &[("conv11", 16), ("conv12", 16), ("conv21", 32)],
    &[
        ("conv11", 16),
        ("conv12", 16),
        ("conv21", 32),
        ("conv22", 32),
        ("conv31", 64),
    ],
    &[
        ("conv11", 16),
        ("conv12", 16),
        ("conv21", 32),
        ("conv22", 32),
        ("conv31", 64),
        ("conv32", 64),
        ("conv33", 64),
        ("conv34", 64),
        ("conv41", 128),
    ],
];

/// A safetensors file with networks of the right form that have learned nothing.
fn write_untrained_wct(path: &Path) {
    let mut tensors: Vec<(String, usize)> = Vec::new();
    for (level, convolutions) in LEVELS.iter().enumerate() {
        let level = level + 1;
        tensors.push((format!("enc{level}.conv0.weight"), 9));
        tensors.push((format!("enc{level}.conv0.bias"), 3));
        let mut inputs = 3;
        for (name, outputs) in *convolutions {
            for (part, biases) in [("enc", *outputs), ("dec", inputs)] {
                tensors.push((format!("{part}{level}.{name}.weight"), inputs * outputs * 9));
                tensors.push((format!("{part}{level}.{name}.bias"), biases));
            }
            inputs = *outputs;
        }
    }
    let value = |i: u32| (i.wrapping_mul(2_654_435_761) >> 16) as f32 / 655_360.0 - 0.045;
    let tensors: Vec<(String, Vec<f32>)> = tensors
        .into_iter()
        .map(|(name, count)| (name, (0..count as u32).map(value).collect()))
        .collect();
    let named: Vec<(&str, &[f32])> = tensors
        .iter()
        .map(|(n, v)| (n.as_str(), v.as_slice()))
        .collect();
    fs::write(path, write_f16(&named).unwrap()).unwrap();
}

/// What a participant with the key would send who always prefers Impasto, and finds the unstylised
/// render unlike the painting.
fn devoted_answers(key: &Value, participant: &str) -> Value {
    let answers = key["questions"].as_array().unwrap().iter().map(|question| {
        let wrong = if question["a"] == "photo" { "a" } else { "b" };
        let ours = if question["a"] == "impasto" { "a" } else { "b" };
        let is_catch = question["a"] == "photo" || question["b"] == "photo";
        let choice = match (is_catch, wrong) {
            (true, "a") => "b",
            (true, _) => "a",
            _ => ours,
        };
        json!({
            "question": question["id"],
            "match": {"choice": choice, "seconds": 2.5},
            "flicker": {"choice": "neither", "seconds": 4.0},
        })
    });
    let answers: Vec<Value> = answers.collect();
    json!({"schema": 1, "study": key["study"], "participant": participant, "answers": answers})
}

/// On the model and the paintings of another test.
pub fn is_made_and_counted(folder: &Path) {
    write_untrained_wct(&folder.join("wct.safetensors"));
    let key = is_made(folder);
    is_counted(folder, &key);
    refuses_what_it_cannot_use(folder);
}

/// The key of the study `asked`.
fn is_made(folder: &Path) -> Value {
    let make = "study make model --styles paintings --against wct --wct-weights wct.safetensors";
    let made = json_of(folder, &format!("{make} --frames 3 --seed 5 -o asked"));
    assert_eq!(
        (&made["questions"], &made["synthetic"]),
        (&json!(5), &json!(true))
    );
    let page = fs::read_to_string(folder.join("asked/study.html")).unwrap();
    assert_eq!(made["bytes"], json!(page.len()));
    let key: Value =
        serde_json::from_slice(&fs::read(folder.join("asked/key.json")).unwrap()).unwrap();
    assert!(page.contains(key["study"].as_str().unwrap()));
    assert_eq!(page.matches("data:image/jpeg").count(), 5 * (1 + 2 * 3));
    assert!(!page.contains("red.png"), "the page names a painting");
    refused(
        folder,
        &format!("{make} -o asked"),
        &["key.json", "another folder"],
    );
    // The same seed makes the same study.
    json_of(folder, &format!("{make} --frames 3 --seed 5 -o again"));
    assert!(fs::read_to_string(folder.join("again/study.html")).unwrap() == page);
    key
}

fn is_counted(folder: &Path, key: &Value) {
    for (file, participant) in [("x", "x"), ("y", "y"), ("copy", "x")] {
        let answers = devoted_answers(key, participant).to_string();
        fs::write(folder.join(format!("{file}.json")), answers).unwrap();
    }
    fs::write(folder.join("broken.json"), b"\xff{").unwrap();
    let files = "x.json y.json copy.json broken.json";
    let summary = json_of(folder, &format!("study summary asked {files}"));
    assert_eq!(
        (&summary["participants"], &summary["left_out"]),
        (&json!(2), &json!(0))
    );
    let aside: Vec<&Value> = summary["set_aside"]
        .as_array()
        .unwrap()
        .iter()
        .map(|a| &a["file"])
        .collect();
    assert_eq!(aside, ["copy.json", "broken.json"]);
    for method in ["wct", "wct_temporal"] {
        let found = &summary["methods"][method];
        assert_eq!(
            (&found["match"]["share"], &found["match"]["impasto"]),
            (&json!(1.0), &json!(4))
        );
        assert_eq!(
            (&found["flicker"]["share"], &found["flicker"]["neither"]),
            (&json!(0.5), &json!(4))
        );
    }
    assert_eq!(summary["mean"]["match"]["share"], json!(1.0));
    let said = impasto(folder, "study summary asked x.json copy.json");
    let (result, notes) = (text(&said.stdout), text(&said.stderr));
    assert!(
        result.contains("100.0 % prefer Impasto (2 to 0") && result.contains("there is only one"),
        "{result}"
    );
    assert!(
        notes.contains("copy.json is of the same participant as x.json"),
        "{notes}"
    );
}

fn refuses_what_it_cannot_use(folder: &Path) {
    refused(
        folder,
        "study summary asked broken.json",
        &["broken.json", "no file of answers"],
    );
    refused(
        folder,
        "study summary asked none.json",
        &["none.json", "cannot be read"],
    );
    refused(
        folder,
        "study summary model x.json",
        &["key.json", "cannot be read"],
    );
    refused(
        folder,
        "study make model --styles empty --against wct --wct-weights wct.safetensors -o b",
        &["nothing to ask"],
    );
}
