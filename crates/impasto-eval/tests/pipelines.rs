//! A whole evaluation of a tiny model, with a method that paints everything in one colour.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use image::{Rgb, RgbImage};
use impasto_eval::methods::{Stylizer, Transfer};
use impasto_eval::strokes::MOST_VIEWS;
use impasto_eval::{EvalOptions, Evaluation, Reconstruct, evaluate};
use impasto_field::EncodingConfig;
use impasto_kernels::HashGridSpec;
use impasto_kernels::device::tested;
use impasto_model::{Budget, Model, Stages, TrainConfig};
use impasto_scene::builtin::{BuiltinOptions, write_capture};
use impasto_scene::paths::orbit;
use impasto_scene::{Camera, Split};
use impasto_train::{Recovery, TrainOptions, train};

struct Whitewash;

impl Stylizer for Whitewash {
    fn name(&self) -> &'static str {
        "whitewash"
    }

    fn transfer<'a>(&'a self, _: &RgbImage) -> Transfer<'a> {
        Box::new(|picture| {
            let (width, height) = picture.dimensions();
            RgbImage::from_pixel(width, height, Rgb([235, 230, 215]))
        })
    }
}

/// A model of the built-in scene that has had a few steps of each stage.
fn tiny_model() -> Model {
    let dir = tempfile::tempdir().unwrap();
    let capture = BuiltinOptions {
        photos: 6,
        width: 48,
        height: 40,
        ..BuiltinOptions::default()
    };
    write_capture(&dir.path().join("scene"), &capture).unwrap();
    let styles = dir.path().join("styles");
    std::fs::create_dir(&styles).unwrap();
    painting(120).1.save(styles.join("one.png")).unwrap();
    let mut config = TrainConfig::fast();
    for volume in [&mut config.field.inner, &mut config.field.outer] {
        volume.encoding = EncodingConfig::HashGrid(HashGridSpec {
            levels: 4,
            features: 4,
            log2_entries: 10,
            coarsest: 8.0,
            finest: 64.0,
        });
    }
    let spec = config.field.occupancy_mut().unwrap();
    (spec.inner_grid, spec.outer_grid) = (16, 16);
    config.geometry.samples = 5000;
    config.geometry.rays = [128, 512];
    config.style.patch = [32, 40];
    // Views of 40 rows say nothing of strokes at 256.
    config.style.pictures.side = 160;
    config.style.generated = 3;
    let options = TrainOptions {
        scene: dir.path().join("scene"),
        output: dir.path().join("model"),
        styles: Some(styles),
        encoder: None,
        cache: None,
        stages: Stages::All,
        config,
        budget: Budget::Steps(120),
        load: impasto_scene::LoadOptions::default(),
        seed: 1,
        device: tested(),
        recovery: Recovery::default(),
    };
    train(&options, &mut |_| ()).unwrap();
    Model::load(&options.output).unwrap()
}

fn painting(shade: u8) -> (String, RgbImage) {
    let picture = RgbImage::from_fn(64, 64, |x, y| {
        Rgb([shade, (x * 3) as u8, ((x ^ y) * 4) as u8])
    });
    (format!("painting of {shade}"), picture)
}

#[test]
fn a_place_is_reconstructed_from_its_stylised_views() {
    let model = tiny_model();
    let train = model.file.scene.cameras(Split::Train);
    let path: Vec<Camera> = orbit(&train, 600, (48, 40)).unwrap()[..9].to_vec();
    let options = EvalOptions {
        paintings: &[painting(200), painting(60)],
        path: &path,
        supersampling: 2,
        record: None,
        against: &[&Whitewash],
        refine: Some(Budget::Steps(40)),
        reconstruct: Some(Reconstruct {
            budget: Budget::Steps(400),
            paintings: 1,
        }),
    };
    let mut ticks = 0;
    let found = evaluate(&model, &options, &mut || ticks += 1).unwrap();
    // Views and walk unstylised, of both paintings together as predicted and refined, of each by the
    // other method, and of the one that was reconstructed.
    let views = found.methods["photo"].fidelity.views;
    let pairs = options.paintings.len() * views.min(MOST_VIEWS);
    let wanted = 6 * (views + path.len()) + pairs;
    assert_eq!((ticks, options.pictures(&model)), (wanted, wanted));
    reconstruction_is_whitewashed(&found);
    let gain = |name: &str| found.methods[name].fidelity.style_gain;
    let (predicted, refined) = (gain("impasto"), gain("impasto_refined"));
    // Looks of their own. That they come nearer is `a_refined_look_is_nearer_to_its_painting`'s: views of 40 rows
    // are too small for it.
    let both = [predicted, refined];
    assert!(predicted != refined, "{predicted}");
    assert!(both.iter().all(|gain| *gain > 0.4), "{both:?}");
    depth_is_known(&found);
    let photo = found.methods["photo"].over_photo.unwrap();
    assert!(
        photo.short == 1.0 && photo.long == 1.0,
        "{:?}",
        found.methods["photo"]
    );

    let without = EvalOptions {
        path: &[],
        refine: None,
        reconstruct: None,
        ..options
    };
    let found = evaluate(&model, &without, &mut || ()).unwrap();
    for left_out in ["whitewash_reconstructed", "impasto_refined"] {
        assert!(!found.methods.contains_key(left_out));
    }
    assert!(found.reconstructed.is_none() && found.depth_error.is_none());
    assert!(found.methods["photo"].true_depth.is_none());
}

/// What was learned from views of one colour is of that colour: as like the painting as the method's
/// own pictures, as smooth, and with nothing left of the place.
fn reconstruction_is_whitewashed(found: &Evaluation) {
    let of = |name: &str| &found.methods[name];
    let [before, pictures, place] = ["photo", "whitewash", "whitewash_reconstructed"].map(of);
    assert_eq!(place.fidelity.paintings.len(), 1);
    let loss = |result: &impasto_eval::MethodResult| result.fidelity.paintings[0].style_loss;
    let distance = (loss(place) - loss(pictures)).abs();
    assert!(
        distance < 0.2 * (loss(before) - loss(pictures)).abs(),
        "{distance}"
    );
    assert!(place.sharpness.unwrap() < 0.1, "{:?}", place.sharpness);
    assert!(found.reconstructed.unwrap().contains("renders"));
}

/// The model is of the built-in scene, so every method is measured by true depth as well.
fn depth_is_known(found: &Evaluation) {
    assert!(found.depth_error.unwrap() > 0.0);
    for (name, result) in &found.methods {
        let (truth, exact) = (result.true_depth.unwrap(), result.consistency.unwrap());
        let (by_truth, by_model) = (truth.consistency.short, exact.short);
        assert!(by_truth.pairs > 0, "{name}");
        let difference = by_truth.e100 - by_model.e100;
        assert_eq!(truth.difference.short, difference, "{name}");
    }
}
