//! What a perceptual network sees around places, distilled.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use common::{run, small};
use impasto_field::encoding::matrix;
use impasto_field::{DistilledFeatures, GBufferOptions, Shading, host};
use impasto_model::{Budget, CameraRays, Model, Stages};
use impasto_scene::Split;
use impasto_scene::builtin::{BuiltinOptions, write_capture};
use impasto_style::Descriptor;
use impasto_train::{DistillationBudget, TrainOptions, distil, train};

fn trained(dir: &std::path::Path, steps: u64) -> Model {
    let options = TrainOptions {
        config: small(),
        budget: Budget::Steps(steps),
        stages: Stages::Geometry,
        ..run(dir)
    };
    let capture = BuiltinOptions {
        photos: 12,
        width: 64,
        height: 48,
        ..BuiltinOptions::default()
    };
    write_capture(&options.scene, &capture).unwrap();
    let summary = train(&options, &mut |_| ()).unwrap();
    Model::load(&summary.model).unwrap()
}

/// Part of the variance of what the network sees in a training view that the model's features say.
fn explained(model: &Model) -> f32 {
    let features = model.file.features.as_ref().unwrap();
    let camera = model.file.scene.cameras(Split::Train)[0];
    let rays = CameraRays::new(&camera, None);
    let (width, height) = rays.size();
    let config = model.file.config.style_appearance();
    let options = GBufferOptions {
        config: &config,
        photo: Some(model.file.photo_app()),
        seed: None,
        least_weight: 0.0,
        rays_at_once: Some(width * height),
    };
    let buffers = model.renderer().gbuffer(&rays.all(), &options);
    let photo = buffers.photo.clone().unwrap().slice_dim(1, 0..3);
    let seen = Descriptor::shipped().unwrap();
    let seen = seen
        .of(&host(photo.clamp(0.0, 1.0)), height, width)
        .unwrap();
    let points = buffers.fine()[0].surface_points();
    let known = host(features.at(matrix(points.places.clone(), 3, &model.renderer().device())));
    // Of each pixel, by where its light comes from.
    let mut found = vec![0.0; seen.len()];
    for (i, (ray, weight)) in points.rays.iter().zip(&points.weights).enumerate() {
        let own = &known[DistilledFeatures::NUMBERS * i..][..Descriptor::LEN];
        let pixel = found[Descriptor::LEN * ray..].iter_mut();
        pixel.zip(own).for_each(|(f, k)| *f += weight * k);
    }
    let (mut off, mut all) = (0.0, 0.0);
    for number in 0..Descriptor::LEN {
        let column = |rows: &[f32]| -> Vec<f32> {
            let rows = rows.chunks_exact(Descriptor::LEN);
            rows.map(|row| row[number]).collect()
        };
        let (seen, found) = (column(&seen), column(&found));
        let mean = seen.iter().sum::<f32>() / seen.len() as f32;
        all += seen.iter().map(|s| (s - mean).powi(2)).sum::<f32>();
        let pairs = seen.iter().zip(&found);
        off += pairs.map(|(s, f)| (s - f).powi(2)).sum::<f32>();
    }
    1.0 - off / all
}

#[test]
fn places_know_what_the_network_sees_around_them() {
    let dir = tempfile::tempdir().unwrap();
    let model = trained(dir.path(), 250);
    let explained = explained(&model);
    assert!(explained > 0.5, "{explained} of the variance");
}

#[test]
fn nothing_is_distilled_where_nothing_is_painted() {
    let dir = tempfile::tempdir().unwrap();
    let budget = DistillationBudget {
        steps: 1,
        time: None,
    };
    let mut model = trained(dir.path(), 2);
    assert!(distil(&model, budget, 1).unwrap().is_some());
    model.file.config.style.shading = Shading::Samples;
    assert!(distil(&model, budget, 1).unwrap().is_none());
}
