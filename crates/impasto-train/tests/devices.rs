//! A model is the same place on every device.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use burn::tensor::Device;
use common::*;
use impasto_kernels::device::{is_cpu, tested};
use impasto_model::{Budget, Clock, Model};
use impasto_scene::builtin::{BuiltinOptions, write_capture};
use impasto_scene::{LoadOptions, Split, load};
use impasto_train::{GeometryStage, train};

/// Largest difference of a channel between devices, and the share of pixels that keep to it.
const DIFFERENCE: f32 = 2.0 / 255.0;
const SHARE: f64 = 0.999;

/// The loss of the last step but a few, of a geometry stage on one photo.
fn last_loss(device: &Device) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let options = BuiltinOptions {
        photos: 2,
        width: 64,
        height: 48,
        ..BuiltinOptions::default()
    };
    write_capture(dir.path(), &options).unwrap();
    let scene = load(dir.path(), &LoadOptions::default()).unwrap();
    let mut config = small();
    // As many on every device.
    config.geometry.rays = [128, 128];
    let mut stage = GeometryStage::new(&scene, &config, 3, device);
    // The losses of one step in sixteen, or more, come back from a GPU.
    let mut clock = Clock::start(Budget::Steps(97));
    let mut losses = Vec::new();
    while !clock.is_over() {
        losses.push(stage.step(&clock).loss);
        clock.steps += 1;
    }
    let late = [64, 80, 96].map(|step| losses[step]);
    assert!(losses[0] > 4.0 * late[2], "{losses:?}");
    late.iter().sum::<f64>() / 3.0
}

#[test]
fn a_device_learns_a_place_as_the_cpu_does() {
    if is_cpu(&tested()) {
        eprintln!("skipped: IMPASTO_DEVICE names no other device than the CPU");
        return;
    }
    let [cpu, other] = [Device::flex(), tested()].map(|device| last_loss(&device));
    // Grids are looked at in other random places.
    assert!((other / cpu).ln().abs() < 0.4, "{other} instead of {cpu}");
}

#[test]
fn a_model_looks_alike_on_every_device() {
    if is_cpu(&tested()) {
        eprintln!("skipped: IMPASTO_DEVICE names no other device than the CPU");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    for trained_on in [Device::flex(), tested()] {
        let options = impasto_train::TrainOptions {
            device: trained_on,
            ..run(dir.path())
        };
        train(&options, &mut |_| ()).unwrap();
        let painting = image::open(dir.path().join("styles/a.png"))
            .unwrap()
            .to_rgb8();
        let views = [Device::flex(), tested()].map(|device| {
            let model = Model::load_on(&options.output, &device).unwrap();
            let look = model
                .appearance(&model.embedding(&painting).unwrap())
                .unwrap();
            let photos = &model.file.scene.photos;
            let photo = photos.iter().find(|p| p.split == Split::Test).unwrap();
            model.render(&photo.camera, &[&model.photo_appearance(), &look])
        });
        let [one, other] = &views;
        for (what, (one, other)) in ["photo", "painting"]
            .iter()
            .zip(one.pixels.iter().zip(&other.pixels))
        {
            let pixels = one.chunks_exact(3).zip(other.chunks_exact(3));
            let alike =
                pixels.filter(|(a, b)| a.iter().zip(*b).all(|(a, b)| (a - b).abs() <= DIFFERENCE));
            let share = alike.count() as f64 / (one.len() / 3) as f64;
            assert!(share >= SHARE, "{what}: {share:.4} of the pixels are alike");
        }
    }
}
