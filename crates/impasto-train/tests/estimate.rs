//! What training will take is told before it is tried.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use std::time::Duration;

use image::RgbImage;
use impasto_model::{Budget, TrainConfig};
use impasto_scene::builtin::{BuiltinOptions, cameras};
use impasto_scene::{Format, Normalisation, Photo, Scene, Split};
use impasto_train::estimate::{
    GIB, PAPER_STEPS, Rates, bytes_needed, estimate, measure_rates, shrink_to_fit,
};

/// A capture of grey photos.
fn scene(photos: usize, width: u32, height: u32) -> Scene {
    let options = BuiltinOptions {
        photos,
        width,
        height,
        ..BuiltinOptions::default()
    };
    let cameras = cameras(&options).into_iter().enumerate();
    let photo = |(index, camera)| Photo {
        name: format!("{index}.png"),
        path: "nowhere".into(),
        camera,
        split: Split::by_index(index),
        pixels: RgbImage::from_pixel(width, height, image::Rgb([128; 3])),
        mask: None,
    };
    Scene {
        name: "grey".into(),
        format: Format::Transforms,
        photos: cameras.map(photo).collect(),
        points: Vec::new(),
        normalisation: Normalisation {
            centre: glam::DVec3::ZERO,
            scale: 0.1,
        },
        synthetic: true,
        warnings: Vec::new(),
    }
}

#[test]
fn a_time_is_filled_with_steps_and_steps_take_their_time() {
    let scene = scene(4, 96, 96);
    let rates = Some(Rates {
        geometry: 10.0,
        style: 5.0,
    });
    let fast = TrainConfig::fast();
    let budget = Budget::Time(Duration::from_secs(600));
    let found = estimate(&scene, &fast, budget, rates);
    assert_eq!(found.seconds, Some(600.0));
    // The painter that the program holds need not learn: 5 % for held-out views, 2 % for checks, a quarter of a
    // minute for what is around places.
    assert_eq!(found.steps, Some([5430, 0]));
    let mut other = fast.clone();
    other.style.hyper_width = 65;
    let found = estimate(&scene, &other, budget, rates);
    // A fifth for the geometry stage, with that quarter of a minute; of the rest, 2 % are kept for checks.
    assert_eq!(found.steps, Some([1050, 2340]));
    assert_eq!(estimate(&scene, &fast, budget, None).steps, None);

    let paper = TrainConfig::paper();
    let found = estimate(&scene, &paper, Budget::Steps(PAPER_STEPS), rates);
    assert_eq!(found.steps, Some([250_000, 100_000]));
    assert_eq!(found.seconds, Some(25_000.0 + 20_000.0));
    let unmeasured = estimate(&scene, &paper, Budget::Steps(PAPER_STEPS), None);
    assert_eq!(unmeasured.seconds, None);
}

#[test]
fn memory_grows_with_pixels_and_shrinking_makes_it_fit() {
    let fast = TrainConfig::fast();
    let (small, large) = (scene(16, 100, 100), scene(16, 1600, 1200));
    let needed = |scene| bytes_needed(scene, &fast) as f64;
    // What 3,000 steps of fox at a quarter of its size peaked at, with photos of little weight.
    let small_gib = needed(&small) / GIB;
    assert!((small_gib - 0.49).abs() < 0.07, "{small_gib}");
    let more = needed(&large) - needed(&small);
    // 14 of 16 photos as floats, all of them as bytes.
    let pixels = 1600.0 * 1200.0;
    let least = pixels * (14.0 * 12.0 + 16.0 * 3.0);
    assert!((least..1.2 * least).contains(&more), "{more}");

    let fits = |bytes: f64| shrink_to_fit(&large, &fast, bytes as u64);
    assert_eq!(fits(needed(&large)), Some(1));
    assert_eq!(fits(needed(&small) + more / 3.9), Some(2));
    assert_eq!(fits(needed(&small) + more / 8.9), Some(3));
    assert_eq!(fits(1e8), None);
}

#[test]
fn rates_are_measured_whatever_the_photos_size() {
    for (width, height) in [(3, 2), (900, 60)] {
        let rates = measure_rates(&scene(9, width, height), &TrainConfig::fast()).unwrap();
        assert!(rates.geometry.is_finite() && rates.geometry > 0.0);
        assert!(rates.style.is_finite() && rates.style > 0.0);
    }
}
