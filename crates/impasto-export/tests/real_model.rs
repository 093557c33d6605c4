//! Splats of a trained model, drawn by another program's rules, against the model's own pictures.
//!
//! `IMPASTO_EXPORT_MODEL=model IMPASTO_EXPORT_STYLE=painting.jpg`; skipped without.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![allow(clippy::print_stdout, reason = "figures, and why a test was skipped")]

#[allow(dead_code, reason = "the other test looks closer at files")]
mod independent;

use std::path::Path;
use std::time::Instant;

use impasto_export::{ViewSelection, Views, Watch, export_splats};
use impasto_model::{Model, Stop, StyleLayer};
use impasto_scene::{Split, read_rgb};
use independent::{Ply, in_capture, psnr, rasterise, save};

#[test]
fn a_models_splats_give_its_own_pictures_back() {
    let Some(model) = std::env::var_os("IMPASTO_EXPORT_MODEL") else {
        println!("skipped: IMPASTO_EXPORT_MODEL names no trained model");
        return;
    };
    let model = Model::load(Path::new(&model)).unwrap();
    let mut looks = vec![("photo", Vec::new())];
    if let Some(style) = std::env::var_os("IMPASTO_EXPORT_STYLE") {
        let painting = read_rgb(Path::new(&style)).unwrap();
        let look = model.appearance(&model.embedding(&painting).unwrap());
        looks.push(("styled", vec![StyleLayer::plain(look.unwrap())]));
    }
    for (name, coats) in looks {
        check(&model, name, &coats);
    }
}

fn check(model: &Model, name: &str, coats: &[StyleLayer]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("splats.ply");
    let (start, stop) = (Instant::now(), Stop::default());
    let mut watch = Watch {
        progress: &mut |_, _| {},
        stop: &stop,
    };
    let views = Views::of_model(model, coats, &ViewSelection::default(), &mut watch).unwrap();
    let rendered = start.elapsed().as_secs_f64();
    let exported = export_splats(&views, &path, &mut watch).unwrap();
    println!(
        "{name}: {exported:?}, rendered in {rendered:.1} s, all in {:.1} s",
        start.elapsed().as_secs_f64()
    );
    let ply = Ply::read(&path);
    let scene = &model.file.scene;
    let (train, test) = (scene.cameras(Split::Train), scene.cameras(Split::Test));
    let mut least = f64::INFINITY;
    let picked = [train.first(), train.get(train.len() / 2), test.first()];
    for (i, camera) in picked.into_iter().flatten().enumerate() {
        let wanted = model.render_layers(camera, &[coats], 1).pixels.remove(0);
        let found = rasterise(&ply, &in_capture(camera, &scene.normalisation));
        let found_psnr = psnr(&found, &wanted);
        println!("{name}: view {i}: {found_psnr:.2} dB");
        if i < 2 {
            least = least.min(found_psnr);
        }
        if let Some(folder) = std::env::var_os("IMPASTO_TEST_PICTURES") {
            let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
            let path = Path::new(&folder).join(format!("{name}_{i}.png"));
            save(&[wanted, found].concat(), width, 2 * height, &path);
        }
    }
    assert!(least >= 18.0, "{name}: {least:.2} dB from a training view");
}
