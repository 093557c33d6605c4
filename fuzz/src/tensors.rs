//! Small valid inputs of the targets that need the tensor library.

use std::path::Path;

use impasto_model::{Device, ModelFile, ModelPhoto, ModelScene, Quality, TrainConfig};
use impasto_scene::{LoadOptions, load};
use impasto_style::{StyleCode, StyleInput, write_f16};
use impasto_train::{GeometryStage, TrainedGeometry};
use serde_json::json;

use crate::scene::Target;

/// Target, name and bytes of every input; `scratch` is for files under way.
pub fn seeds(scratch: &Path) -> Vec<(&'static str, &'static str, Vec<u8>)> {
    // The shipped encoder has 15 MB; this one ends before its layers.
    let numbers = StyleInput::Relu4_1.numbers();
    let vae: [(&str, &[f32]); 3] = [
        ("mean", &vec![0.5; numbers]),
        ("scale", &vec![1.0; numbers]),
        ("gain", &[1.0; StyleCode::LEN]),
    ];
    let vae = write_f16(&vae).expect("a safetensors file");
    let config = small();
    let as_json = |config: &TrainConfig| serde_json::to_vec(config).expect("JSON");
    let toml = toml::to_string(&config).expect("TOML");
    vec![
        ("style_vae", "numbers", vae),
        ("config", "json", as_json(&config)),
        ("config", "paper", as_json(&TrainConfig::paper())),
        ("config", "toml", toml.into_bytes()),
        ("model", "geometry", model(&config, scratch)),
        ("coats", "all", COATS.into()),
        ("study", "one", STUDY.into()),
    ]
}

const COATS: &str = r#"{"coats": [
{"paintings": [{"painting": "a.jpg", "weight": 0.5}, {"painting": "random:42"}], "strength": 0.8,
"keep": "luminance", "mask": {"shape": {"sphere": {"centre": [0, 0, 0.2], "radius": 0.4}}, "inverted": true}},
{"paintings": [{"painting": "b"}], "keep": "palette", "mask": {"shape": "near"}},
{"paintings": [{"painting": "b"}], "mask": {"shape": {"box": {"min": [0, 0, 0], "max": [1, 1, 1]}}}},
{"paintings": [{"painting": "b"}], "mask": {"shape": {"depth": {"from": 0.2, "to": 0.4}}}},
{"paintings": [{"painting": "b"}], "mask": {"shape": {"surface": {"point": [0, 0, 1], "tolerance": 0.1}}}}]}"#;

const STUDY: &str = r#"{"schema": 1, "study": "s", "synthetic": true, "seed": 1, "frames": 8, "size": [64, 48],
"quality": 80, "rate": 12, "questions": [
{"id": "q1", "painting": "p", "a": "impasto", "b": "adain"},
{"id": "q2", "painting": "p", "a": "photo", "b": "adain"}]}
---
{"schema": 1, "study": "s", "participant": "one", "answers": [
{"question": "q1", "match": {"choice": "a", "seconds": 2.5}, "flicker": {"choice": "neither", "seconds": 3.5}},
{"question": "q2", "match": {"choice": "b", "seconds": 2.5}, "flicker": {"choice": "b", "seconds": 3.5}}]}"#;

/// The fast preset with a field of a few hundred numbers.
fn small() -> TrainConfig {
    let mut config = serde_json::to_value(TrainConfig::fast()).expect("JSON");
    for volume in ["inner", "outer"] {
        let volume = &mut config["field"][volume];
        volume["base"] = json!([2]);
        volume["encoding"] = json!({ "hash_grid": {
            "levels": 1, "features": 1, "log2_entries": 4, "coarsest": 1.0, "finest": 1.0,
        }});
    }
    let sampling = &mut config["field"]["sampling"]["occupancy"];
    sampling["inner_grid"] = json!(2);
    sampling["outer_grid"] = json!(2);
    config["photo_app"]["hidden"] = json!([2]);
    config["photo_app"]["view_bands"] = json!(1);
    serde_json::from_value(config).expect("settings")
}

/// A model file whose geometry stage has just begun.
fn model(config: &TrainConfig, scratch: &Path) -> Vec<u8> {
    // Its capture is in a folder that is called like its file.
    let _written = Target::named("transforms", scratch);
    let folder = scratch.join("transforms.json");
    let scene = load(&folder, &LoadOptions::default()).expect("a capture");
    let stage = GeometryStage::new(&scene, config, 1, &Device::default());
    let TrainedGeometry {
        radiance,
        grids,
        features,
    } = stage.snapshot();
    let photos = scene.photos.iter().map(|photo| ModelPhoto {
        name: photo.name.clone(),
        camera: photo.camera,
        split: photo.split,
    });
    let file = ModelFile {
        config: config.clone(),
        scene: ModelScene {
            name: "seed".into(),
            synthetic: true,
            normalisation: scene.normalisation,
            photos: photos.collect(),
        },
        quality: Quality::default(),
        seed: 1,
        radiance,
        grids,
        features,
        style: None,
        encoder: None,
        finished: None,
    };
    let path = file.save(scratch).expect("the scratch folder is writable");
    std::fs::read(path).expect("it was written")
}
