//! Both stages on the smallest case that shows they learn, and what they write.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use impasto_field::{EncodingConfig, HierarchicalConfig, SamplingConfig, Shading, VolumeConfig};
use impasto_kernels::Density;
use impasto_kernels::device::tested;
use impasto_model::config::StyleConfig;
use impasto_model::{
    Budget, Clock, Model, ModelFile, ModelPhoto, ModelScene, Quality, Stages, StyledAppearance,
    TrainConfig,
};
use impasto_paintings::{Family, Recipe, paint};
use impasto_scene::builtin::{BuiltinOptions, write_capture};
use impasto_scene::{Camera, LoadOptions, Scene, load, metrics};
use impasto_style::{Perceptual, StyleVae, picture};
use impasto_train::{
    Event, GeometryStage, Recovery, Refinement, StyleNetworks, StyleReport, StyleSet, StyleStage,
    TrainOptions, TrainSummary, TrainedGeometry, photo_rays, refit, train,
};

fn small() -> TrainConfig {
    let mut config = common::with_grids(6, 12, 128.0);
    let spec = config.field.occupancy_mut().unwrap();
    (spec.inner_step, spec.outer_steps) = (0.03, 32);
    (spec.inner_grid, spec.outer_grid) = (24, 24);
    config.geometry.samples = 20_000;
    config.geometry.rays = [256, 1024];
    config.style.patch = [32, 40];
    config.style.least_weight = 1e-2;
    config.style.lr_warmup_steps = 10;
    config.style.rate = 1e-3;
    config
}

/// The paper's architecture, much smaller.
fn small_paper() -> TrainConfig {
    let mut config = small();
    for volume in [&mut config.field.inner, &mut config.field.outer] {
        *volume = VolumeConfig {
            encoding: EncodingConfig::Frequency { bands: 9 },
            base: vec![48; 5],
            geo: vec![24],
            density: Density::Abs,
        };
    }
    config.field.latent = Some(8);
    config.field.sampling = SamplingConfig::Hierarchical(HierarchicalConfig {
        first: 12,
        more: 16,
        near: 0.05,
    });
    config.photo_app.hidden = vec![48, 24];
    config.photo_app.remap = true;
    config.geometry.network_rate = 5e-3;
    config.style_app.remap = true;
    config.style = StyleConfig {
        patch: config.style.patch,
        rate: 1e-3,
        lr_warmup_steps: 10,
        rays_at_once: 256,
        style_loss_start: 5,
        ..TrainConfig::paper().style
    };
    config
}

fn capture(photos: usize) -> (tempfile::TempDir, Scene) {
    let dir = tempfile::tempdir().unwrap();
    let options = BuiltinOptions {
        photos,
        width: 64,
        height: 48,
        ..BuiltinOptions::default()
    };
    write_capture(dir.path(), &options).unwrap();
    let scene = load(dir.path(), &LoadOptions::default()).unwrap();
    (dir, scene)
}

/// A model file of a geometry stage after `steps` steps.
fn reconstruct(scene: &Scene, config: &TrainConfig, steps: u64) -> ModelFile {
    let mut stage = GeometryStage::new(scene, config, 3, &tested());
    let mut clock = Clock::start(Budget::Steps(steps));
    while !clock.is_over() {
        stage.step(&clock);
        clock.steps += 1;
    }
    let TrainedGeometry {
        radiance,
        grids,
        features,
    } = stage.snapshot();
    ModelFile {
        config: config.clone(),
        scene: ModelScene {
            name: "test".into(),
            synthetic: true,
            normalisation: scene.normalisation,
            photos: Vec::new(),
        },
        quality: Quality::default(),
        seed: 3,
        radiance,
        grids,
        features,
        style: None,
        encoder: None,
        finished: None,
    }
}

#[test]
fn geometry_stage_learns_one_photo_by_heart() {
    // Two photos: the first is held out, the second is the one to learn.
    let (_dir, scene) = capture(2);
    let model = Model::from_file(reconstruct(&scene, &small(), 150));
    let (_, photo) = scene.train().next().unwrap();
    let view = model.render(&photo.camera, &[&model.photo_appearance()]);
    let psnr = metrics::psnr(&view.pixels[0], &picture(&photo.pixels));
    assert!(
        psnr > 24.0,
        "one photo learned by heart comes out at {psnr:.1} dB"
    );
    assert!(
        view.depth.iter().all(|d| *d > 0.0),
        "every ray meets something"
    );
}

#[test]
fn a_model_is_refitted_to_other_pictures_of_its_views() {
    let (_dir, scene) = capture(3);
    for config in [small(), small_paper()] {
        let mut file = reconstruct(&scene, &config, 60);
        let photos = scene.photos.iter().map(|photo| ModelPhoto {
            name: photo.name.clone(),
            split: photo.split,
            camera: photo.camera,
        });
        file.scene.photos = photos.collect();
        let model = Model::from_file(file);
        // Half as large as the photos, and of one colour.
        let colour = [200, 40, 90];
        let picture = image::RgbImage::from_pixel(32, 24, image::Rgb(colour));
        let refitted = refit(&model, vec![picture.clone(); 2], Budget::Steps(120));
        let refitted = refitted.unwrap();
        let camera = scene.photos[1].camera;
        let off = |model: &Model| {
            let view = model.render(&camera, &[&model.photo_appearance()]);
            let pixels = view.pixels[0].iter().zip(colour.into_iter().cycle());
            let off = pixels.map(|(v, c)| (v - f32::from(c) / 255.0).abs());
            off.sum::<f32>() / view.pixels[0].len() as f32
        };
        let (before, after) = (off(&model), off(&refitted));
        assert!(before > 0.15 && after < 0.05, "{before} {after}");
        assert!(!refitted.has_style());
        assert!(refit(&model, vec![picture; 1], Budget::Steps(1)).is_none());
    }
}

/// Losses of a style stage on one generated painting.
fn paint_one(config: &TrainConfig, steps: u64) -> Vec<StyleReport> {
    let (_dir, scene) = capture(2);
    let file = reconstruct(&scene, config, 120);
    let (vgg, vae) = (Perceptual::vgg16().unwrap(), StyleVae::shipped().unwrap());
    let side = config.style.pictures.side;
    let painting = paint(&Recipe::nth_of(Family::ALL[1], 5), side, side);
    let styles = StyleSet::of_pictures(
        &vgg,
        &[painting],
        config.style.patch,
        &config.style.pictures,
    )
    .unwrap();
    let geometry = TrainedGeometry {
        radiance: file.radiance,
        grids: file.grids,
        features: file.features,
    };
    let mut stage = StyleStage::new(
        config,
        geometry,
        photo_rays(scene.train().map(|(_, p)| p)),
        StyleNetworks {
            vgg,
            vae,
            first: None,
        },
        styles,
        1,
        &tested(),
    );
    let mut clock = Clock::start(Budget::Steps(steps));
    let mut reports = Vec::new();
    while !clock.is_over() {
        reports.push(stage.step(&clock).unwrap());
        clock.steps += 1;
    }
    reports
}

fn mean(reports: &[StyleReport], get: fn(&StyleReport) -> f64) -> f64 {
    reports.iter().map(get).sum::<f64>() / reports.len() as f64
}

#[test]
fn style_stage_learns_one_painting_by_heart() {
    let mut config = small();
    for shading in [Shading::Samples, config.style.shading] {
        config.style.shading = shading;
        let reports = paint_one(&config, 80);
        // The preset's loss is of distances, not of their squares.
        let style = |part: &[StyleReport]| mean(part, |r| r.style.unwrap().powi(2));
        let (first, last) = (style(&reports[..5]), style(&reports[70..]));
        assert!(
            last < 0.5 * first,
            "{shading:?}: squared style loss went from {first:.3} to {last:.3}"
        );
    }
}

#[test]
fn a_cascade_learns_one_painting_by_heart() {
    let reports = paint_one(&small_paper(), 60);
    let style = |part: &[StyleReport]| mean(part, |r| r.style.unwrap());
    let (first, last) = (style(&reports[..5]), style(&reports[50..]));
    assert!(
        last < 0.6 * first,
        "style loss went from {first:.3} to {last:.3}"
    );
    let total = |r: &StyleReport| r.loss - r.content.unwrap();
    let weight = f64::from(small_paper().style.style_weight);
    assert!(
        total(&reports[4]) < 1.0 && total(&reports[5]) > 0.9 * weight * reports[5].style.unwrap(),
        "the style loss joins after five updates"
    );
}

#[test]
fn a_patch_painted_in_turns_is_the_same_patch() {
    for mut config in [small(), small_paper()] {
        let losses = [usize::MAX, 256].map(|turn| {
            config.style.rays_at_once = turn;
            paint_one(&config, 4)
                .iter()
                .map(|r| r.loss)
                .collect::<Vec<_>>()
        });
        for (one, other) in losses[0].iter().zip(&losses[1]) {
            assert!((one / other - 1.0).abs() < 1e-3, "{losses:?}");
        }
    }
}

#[test]
fn a_step_in_several_turns_is_the_same_step() {
    let (_dir, scene) = capture(3);
    for mut config in [small(), small_paper()] {
        config.geometry.samples = 1000;
        config.geometry.rays = [150, 150];
        let clock = Clock::start(Budget::Steps(9));
        let losses = [150, 64].map(|turn| {
            config.geometry.rays_at_once = turn;
            let mut stage = GeometryStage::new(&scene, &config, 3, &tested());
            [(); 3].map(|()| stage.step(&clock).loss)
        });
        for (one, other) in losses[0].iter().zip(losses[1]) {
            assert!((one / other - 1.0).abs() < 1e-3, "{losses:?}");
        }
    }
}

#[test]
fn a_cascade_learns_one_photo_by_heart() {
    let (_dir, scene) = capture(2);
    let model = Model::from_file(reconstruct(&scene, &small_paper(), 250));
    let (_, photo) = scene.train().next().unwrap();
    let view = model.render(&photo.camera, &[&model.photo_appearance()]);
    let psnr = metrics::psnr(&view.pixels[0], &picture(&photo.pixels));
    assert!(psnr > 20.0, "{psnr:.1} dB");
}

#[test]
fn a_run_writes_a_model_that_renders_the_same_when_read_back() {
    let mut config = small();
    config.style.generated = 4;
    write_and_read(config);
}

#[test]
fn a_run_of_the_papers_architecture_does_too() {
    write_and_read(small_paper());
}

/// A run of both stages on a capture, into the folder `model` of it.
fn run(dir: &tempfile::TempDir, config: TrainConfig, sink: &mut dyn FnMut(&Event)) -> TrainSummary {
    let options = TrainOptions {
        scene: dir.path().to_owned(),
        output: dir.path().join("model"),
        styles: None,
        encoder: None,
        cache: None,
        stages: Stages::All,
        config,
        budget: Budget::Steps(30),
        load: LoadOptions::default(),
        seed: 1,
        device: tested(),
        recovery: Recovery::default(),
    };
    train(&options, sink).unwrap()
}

fn write_and_read(config: TrainConfig) {
    let (dir, scene) = capture(9);
    let output = dir.path().join("model");
    let mut stages = Vec::new();
    let summary = run(&dir, config, &mut |event| {
        if let Event::Validation { psnr, .. } = event {
            stages.push(*psnr);
        }
    });
    assert_eq!(stages, [summary.quality.psnr]);
    assert!(summary.synthetic && summary.quality.psnr.is_finite());
    let [one, two] = [(); 2].map(|()| Model::load(&output).unwrap());
    let camera = &scene.photos[0].camera;
    let painting = paint(&Recipe::nth_of(Family::ALL[2], 3), 64, 64);
    let [one, two] = [&one, &two].map(|m| {
        let look = m.appearance(&m.embedding(&painting).unwrap()).unwrap();
        m.render(camera, &[&m.photo_appearance(), &look]).pixels
    });
    assert_eq!(one, two);
    assert!(!one[0].iter().any(|v| v.is_nan()));
    let log = std::fs::read_to_string(output.join("log.jsonl")).unwrap();
    assert!(
        log.lines()
            .all(|l| serde_json::from_str::<serde_json::Value>(l).is_ok())
    );
    assert!(log.contains("\"done\""));
    let bytes = std::fs::read(output.join("model.safetensors")).unwrap();
    for cut in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(output.join("model.safetensors"), &bytes[..cut]).unwrap();
        assert!(
            Model::load(&output).is_err(),
            "a file cut at {cut} must be refused"
        );
    }
}

#[test]
fn the_same_seed_gives_the_same_field() {
    let (_dir, scene) = capture(3);
    let [one, two] = [(); 2].map(|()| {
        let file = reconstruct(&scene, &small(), 12);
        file.radiance
            .weights
            .inner
            .base
            .try_into_vec_as::<f32>()
            .unwrap()
    });
    assert_eq!(one, two);
}

/// Style distance of a view to a painting, by statistics of the whole.
fn apart(
    model: &Model,
    look: &StyledAppearance,
    (camera, painting): (&Camera, &image::RgbImage),
) -> f64 {
    let vgg = Perceptual::vgg16().unwrap();
    let view = model.render(camera, &[look]).image(0);
    let statistics = |image: &image::RgbImage| {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let features = vgg.features(&picture(image), height, width);
        features.unwrap().statistics
    };
    f64::from(statistics(&view).distance(&statistics(painting)))
}

#[test]
fn a_refined_look_is_nearer_to_its_painting() {
    for config in [small(), small_paper()] {
        let (dir, scene) = capture(9);
        let output = dir.path().join("model");
        let mut config = config;
        config.style.generated = 4;
        // About as large as the views, so that what patches are compared with is what is measured here.
        config.style.pictures.side = 64;
        run(&dir, config, &mut |_| ());
        let model = Model::load(&output).unwrap();
        let painting = paint(&Recipe::nth_of(Family::ALL[1], 5), 64, 64);
        let seen = (&scene.photos[0].camera, &painting);
        let predicted = model
            .appearance(&model.embedding(&painting).unwrap())
            .unwrap();
        let refined = || {
            let mut shares = Vec::new();
            let mut refinement = Refinement::new(&model).unwrap().unwrap();
            let look =
                refinement.appearance(&[(&painting, 2.0)], Budget::Steps(180), &mut |share| {
                    shares.push(share);
                });
            assert_eq!((shares.len(), shares.last()), (180, Some(&1.0)));
            look.unwrap().unwrap()
        };
        let look = refined();
        let [before, after] = [&predicted, &look].map(|look| apart(&model, look, seen));
        assert!(after < 0.8 * before, "{before} {after}");
        let pixels = |look: &StyledAppearance| model.render(seen.0, &[look]).pixels;
        assert_eq!(pixels(&look), pixels(&refined()), "the same every time");

        let mut refinement = Refinement::new(&model).unwrap().unwrap();
        let weightless = refinement.appearance(&[(&painting, 0.0)], Budget::Steps(1), &mut |_| ());
        assert!(weightless.unwrap().is_none());
        let mut plain = ModelFile::load(&output, &tested()).unwrap();
        plain.style = None;
        let plain = Model::from_file(plain);
        assert!(Refinement::new(&plain).unwrap().is_none());
    }
}
