//! Encoders of styles: the shipped one on real paintings, and those that users train.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test may panic")]

mod common;

use impasto_kernels::device::tested;
use impasto_model::{Model, ModelFile, Stages, painting_statistics};
use impasto_paintings::{Recipe, paint};
use impasto_style::{Network, Perceptual, StyleInput, StyleVae};
use impasto_train::{EncoderOptions, Event, check_encoder, read_encoder, train, train_encoder};
use std::path::Path;

#[test]
fn the_shipped_encoder_rebuilds_paintings_that_it_never_saw() {
    let heldout = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/data/styles/heldout"
    );
    if !Path::new(heldout).is_dir() {
        println!("skipped: there are no real paintings at {heldout}");
        return;
    }
    let vae = StyleVae::shipped().unwrap();
    let check = check_encoder(
        &vae,
        heldout.as_ref(),
        EncoderOptions::SIDE,
        None,
        &mut |_| (),
    )
    .unwrap();
    assert_eq!(check.unreadable, 0);
    assert!(check.explained >= 0.9, "{check:?}");
}

/// An encoder of hardly any training, in a file.
fn trained(dir: &Path) -> std::path::PathBuf {
    common::hang(
        &dir.join("paintings"),
        &["a.png", "b.png", "c.png", "d/e.png"],
    );
    let options = EncoderOptions {
        styles: dir.join("paintings"),
        heldout: None,
        steps: 2,
        generated: 2,
        network: Network::Vgg16,
        input: StyleInput::Relu4_1,
        side: EncoderOptions::SIDE,
        seed: 1,
        cache: None,
    };
    let mut steps = Vec::new();
    let (vae, summary) = train_encoder(&options, &mut |event| {
        if let Event::EncoderStep { step, .. } = event {
            steps.push(*step);
        }
    })
    .unwrap();
    assert_eq!(steps.last(), Some(&2));
    assert_eq!(summary.heldout.paintings, 1, "every 8th, the first");
    assert_eq!(summary.vectors, 3 * 14 + 2);
    assert!(summary.explained_of_training > 0.9, "{summary:?}");
    let file = dir.join("encoder.safetensors");
    std::fs::write(&file, vae.to_bytes().unwrap()).unwrap();
    file
}

#[test]
fn a_model_carries_the_encoder_that_it_was_trained_with() {
    let dir = tempfile::tempdir().unwrap();
    let mut options = common::run(dir.path());
    options.encoder = Some(trained(dir.path()));
    train(&options, &mut |_| ()).unwrap();
    let model = Model::load(&options.output).unwrap();
    let own = read_encoder(options.encoder.as_ref().unwrap()).unwrap();

    let painting = paint(&Recipe::random(3), 64, 64);
    let vgg = Perceptual::vgg16().unwrap();
    let pictures = &model.file.config.style.pictures;
    let statistics = painting_statistics(&vgg, &painting, pictures).unwrap();
    let code = model.embedding(&painting).unwrap().code;
    assert_eq!(code, own.encode(&statistics));
    assert_ne!(code, StyleVae::shipped().unwrap().encode(&statistics));

    // The style stage alone follows its own run: with the shipped encoder nothing is stored.
    options.encoder = None;
    options.stages = Stages::Style;
    train(&options, &mut |_| ()).unwrap();
    let file = ModelFile::load(&options.output, &tested()).unwrap();
    assert!(file.encoder.is_none() && file.style.is_some());
}

#[test]
fn an_encoder_that_is_none_is_refused_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let mut options = common::run(dir.path());
    for name in ["none.safetensors", "scene/transforms.json"] {
        options.encoder = Some(dir.path().join(name));
        let message = train(&options, &mut |_| ()).unwrap_err().to_string();
        assert!(message.contains(name), "{message}");
        assert!(!options.output.exists());
    }
}
