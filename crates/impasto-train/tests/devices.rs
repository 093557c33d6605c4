//! A model is the same place on every device.

mod common;

use burn::tensor::Device;
use common::*;
use impasto_kernels::device::{is_cpu, tested};
use impasto_scene::Split;
use impasto_train::{Model, train};

/// Largest difference of a channel between devices, and the share of pixels that keep to it.
const DIFFERENCE: f32 = 2.0 / 255.0;
const SHARE: f64 = 0.999;

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
            let model = Model::load_on(&options.output, device).unwrap();
            let look = model.look(&model.inspiration(&painting).unwrap()).unwrap();
            let photos = &model.file.scene.photos;
            let photo = photos.iter().find(|p| p.split == Split::Test).unwrap();
            model.render(&photo.camera, &[&model.photo_look(), &look])
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
