//! Layers of paint on a trained scene.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use common::{run, small};
use image::{Rgb, RgbImage};
use impasto_model::{
    Budget, ColorStatistics, LayerSettings, MaskShape, MaskSpec, Model, StyleLayer, StyleLayers,
};
use impasto_scene::{Camera, Split};
use impasto_train::{TrainOptions, train};
use std::sync::LazyLock;

/// One model for all tests: enough steps that surfaces stand and appearances differ.
static MODEL: LazyLock<Model> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let options = TrainOptions {
        budget: Budget::Steps(120),
        ..run_of(dir.path())
    };
    let summary = train(&options, &mut |_| ()).unwrap();
    Model::load(&summary.model).unwrap()
});

#[test]
fn strokes_have_a_size_and_a_strength() {
    let paint = |spec: &str| painted(&[layer(&fire(), spec)]);
    let plain = paint("");
    let same = paint(r#", "stroke_size": 1, "stroke_strength": 1"#);
    assert_eq!(plain, same);
    let large = paint(r#", "stroke_size": 2"#);
    assert!(mean_apart(&plain, &large) > 1e-3);
    // Without strokes there is only the scene in the painting's colours, whatever their size.
    let bare = paint(r#", "stroke_strength": 0"#);
    let bare_large = paint(r#", "stroke_strength": 0, "stroke_size": 2"#);
    assert_eq!(bare, bare_large);
    let half = paint(r#", "stroke_strength": 0.5"#);
    assert!(mean_apart(&bare, &half) < mean_apart(&bare, &plain));
    assert!(mean_apart(&bare, &photo()) > 0.02, "it has other colours");
}

fn run_of(dir: &std::path::Path) -> TrainOptions {
    TrainOptions {
        config: small(),
        ..run(dir)
    }
}

fn camera() -> Camera {
    MODEL.file.scene.cameras(Split::Train)[0].resized(40, 30)
}

/// A painting of stripes in two colours.
fn painting(one: [u8; 3], other: [u8; 3]) -> RgbImage {
    RgbImage::from_fn(96, 96, |x, y| {
        Rgb(if (x / 7 + y / 13) % 2 == 0 {
            one
        } else {
            other
        })
    })
}

fn fire() -> RgbImage {
    painting([230, 60, 20], [250, 200, 60])
}

fn layer(painting: &RgbImage, spec: &str) -> StyleLayer {
    let json = format!(r#"{{"coats": [{{"paintings": [{{"painting": "one"}}] {spec}}}]}}"#);
    let layers: StyleLayers = serde_json::from_str(&json).unwrap();
    layers.check().unwrap();
    let embedding = MODEL.embedding(painting).unwrap();
    MODEL.layer(&layers.coats[0], &[(embedding, 1.0)]).unwrap()
}

fn painted(layers: &[StyleLayer]) -> Vec<f32> {
    MODEL.shade(&MODEL.gbuffer(&camera()), layers)
}

fn photo() -> Vec<f32> {
    MODEL
        .render(&camera(), &[&MODEL.photo_appearance()])
        .pixels
        .remove(0)
}

fn apart(a: &[f32], b: &[f32]) -> f32 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max)
}

fn mean_apart(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32
}

#[test]
fn a_gbuffer_is_painted_as_a_whole_view_is_rendered() {
    let appearance = MODEL
        .appearance(&MODEL.embedding(&fire()).unwrap())
        .unwrap();
    let rendered = MODEL.render(&camera(), &[&appearance]);
    let view = MODEL.gbuffer(&camera());
    let found = MODEL.shade(&view, &[StyleLayer::plain(appearance)]);
    assert!(apart(&found, &rendered.pixels[0]) < 1e-5);
    assert_eq!(view.depth, rendered.depth);
    assert!(apart(&painted(&[]), &photo()) < 1e-6);
    assert!(view.bytes() > 40 * 30 * 4 * 10);
    // In parts, as progressive pictures are.
    let [upper, lower] =
        [(0, 11), (11, 19)].map(|(from, count)| MODEL.gbuffer(&camera().rows(from, count)));
    assert_eq!((upper.height, lower.height), (11, 19));
    let parts = [upper, lower].map(|part| MODEL.shade(&part, &[])).concat();
    assert!(apart(&parts, &photo()) < 1e-6);
}

#[test]
fn layers_rendered_from_one_pass_are_those_of_a_gbuffer() {
    let full = [layer(&fire(), "")];
    let thin = [layer(
        &fire(),
        r#", "strength": 0.4, "mask": {"shape": "near"}"#,
    )];
    let two = [
        layer(&painting([20, 40, 120], [90, 160, 220]), ""),
        layer(
            &fire(),
            r#", "keep": "luminance", "mask": {"shape": "far"}"#,
        ),
    ];
    let lists: [&[StyleLayer]; 4] = [&full, &[], &thin, &two];
    let all = MODEL.render_layers(&camera(), &lists, 1);
    for (list, pixels) in lists.iter().zip(&all.pixels) {
        assert!(apart(pixels, &painted(list)) < 1e-5);
    }
    // Without the photo's appearance among them.
    let one = MODEL.render_layers(&camera(), &lists[..1], 2);
    assert_eq!((one.width, one.pixels[0].len()), (40, 40 * 30 * 3));
}

#[test]
fn strength_goes_from_the_photo_to_the_paint() {
    let at = |strength: f32| painted(&[layer(&fire(), &format!(r#", "strength": {strength}"#))]);
    let (photo, paint) = (photo(), at(1.0));
    assert!(apart(&at(0.0), &photo) < 1e-6);
    assert!(mean_apart(&photo, &paint) > 0.05);
    let left = [0.0, 0.25, 0.5, 0.75, 1.0].map(|strength| mean_apart(&at(strength), &paint));
    assert!(left.windows(2).all(|pair| pair[1] < pair[0]), "{left:?}");
}

#[test]
fn a_mix_lies_between_its_paintings() {
    let (one, other) = (fire(), painting([20, 40, 120], [90, 160, 220]));
    let embeddings = [&one, &other].map(|p| MODEL.embedding(p).unwrap());
    let json = r#"{"coats": [{"paintings": [{"painting": "a"}, {"painting": "b"}]}]}"#;
    let spec = serde_json::from_str::<StyleLayers>(json)
        .unwrap()
        .coats
        .remove(0);
    let of = |weights: [f32; 2]| {
        let all: Vec<_> = embeddings.iter().cloned().zip(weights).collect();
        let pixels = painted(&[MODEL.layer(&spec, &all).unwrap()]);
        [0, 1, 2].map(|c| pixels.iter().skip(c).step_by(3).sum::<f32>() / (40.0 * 30.0))
    };
    let (first, both, second) = (of([1.0, 0.0]), of([0.5, 0.5]), of([0.0, 1.0]));
    // Fire is redder, water is bluer.
    assert!(
        first[0] > both[0] && both[0] > second[0],
        "{first:?} {both:?} {second:?}"
    );
    assert!(
        first[2] < both[2] && both[2] < second[2],
        "{first:?} {both:?} {second:?}"
    );
}

#[test]
fn outside_of_a_mask_nothing_changes() {
    let view = MODEL.gbuffer(&camera());
    let point = view.point(20, 15).unwrap();
    let mask = format!(r#""shape": {{"sphere": {{"centre": {point:?}, "radius": 0.15}}}}"#);
    let photo = photo();
    let inside = |x: usize, y: usize| {
        view.point(x, y).is_some_and(|p| {
            let square: f32 = p.iter().zip(point).map(|(a, b)| (a - b).powi(2)).sum();
            square.sqrt() < 0.15
        })
    };
    for inverted in [false, true] {
        let found = painted(&[layer(
            &fire(),
            &format!(r#", "mask": {{{mask}, "inverted": {inverted}}}"#),
        )]);
        let (mut kept, mut changed) = (0, 0);
        for pixel in 0..40 * 30 {
            let own = 3 * pixel..3 * pixel + 3;
            if inside(pixel % 40, pixel / 40) == inverted {
                // Exactly where the edge is not feathered, which is inside.
                if !inverted {
                    assert_eq!(found[own.clone()], photo[own.clone()]);
                }
                kept += 1;
            } else if apart(&found[own.clone()], &photo[own]) > 0.02 {
                changed += 1;
            }
        }
        assert!(kept > 20 && changed > 20, "{kept} {changed}");
    }
}

#[test]
fn kept_colours_are_the_scenes() {
    let photo = photo();
    let chroma = |pixels: &[f32]| -> Vec<f32> {
        pixels
            .chunks_exact(3)
            .flat_map(|p| [p[0] - p[1], p[2] - p[1]])
            .collect()
    };
    let lightness = |pixels: &[f32]| -> Vec<f32> {
        pixels
            .chunks_exact(3)
            .map(|p| 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2])
            .collect()
    };
    let paint = painted(&[layer(&fire(), "")]);
    let relit = painted(&[layer(&fire(), r#", "keep": "luminance""#)]);
    assert!(apart(&lightness(&relit), &lightness(&paint)) < 1e-4);
    let far = |pixels: &[f32]| mean_apart(&chroma(pixels), &chroma(&photo));
    assert!(
        far(&relit) < 0.3 * far(&paint),
        "{} {}",
        far(&relit),
        far(&paint)
    );

    let moved = painted(&[layer(&fire(), r#", "keep": "palette""#)]);
    let off = |pixels: &[f32]| {
        let mean = |pixels: &[f32], c: usize| {
            pixels.iter().skip(c).step_by(3).sum::<f32>() / (pixels.len() / 3) as f32
        };
        (0..3)
            .map(|c| (mean(pixels, c) - mean(&photo, c)).abs())
            .sum::<f32>()
    };
    assert!(
        off(&moved) < 0.4 * off(&paint),
        "{} {}",
        off(&moved),
        off(&paint)
    );
    let palette = |pixels: &[f32]| ColorStatistics::of(pixels.chunks_exact(3));
    assert_ne!(palette(&moved), palette(&paint));
}

#[test]
fn a_clicked_surface_is_painted_in_every_view_and_nothing_far_from_it() {
    let view = MODEL.gbuffer(&camera());
    let point = view.point(20, 25).unwrap();
    let surface = format!(r#"{{"surface": {{"point": {point:?}, "tolerance": 0.08}}}}"#);
    let layers = [layer(
        &fire(),
        &format!(r#", "mask": {{"shape": {surface}}}"#),
    )];
    let photo = photo();
    let found = painted(&layers);
    let share = |found: &[f32], photo: &[f32]| {
        let pixels = found.chunks_exact(3).zip(photo.chunks_exact(3));
        pixels.filter(|(a, b)| apart(a, b) > 0.02).count() as f32 / (photo.len() / 3) as f32
    };
    let own = share(&found, &photo);
    assert!((0.02..0.98).contains(&own), "{own}");
    let at = 3 * (25 * 40 + 20);
    assert!(apart(&found[at..at + 3], &photo[at..at + 3]) > 0.02);

    let other = MODEL.file.scene.cameras(Split::Train)[1].resized(40, 30);
    let seen = MODEL.gbuffer(&other);
    let elsewhere = share(&MODEL.shade(&seen, &layers), &seen.photo);
    assert!(elsewhere > 0.02, "{elsewhere}");

    let nowhere = MaskSpec {
        shape: MaskShape::Surface {
            point: [0.0, -0.99, 0.0],
            tolerance: 0.1,
        },
        inverted: false,
    };
    let appearance = MODEL
        .appearance(&MODEL.embedding(&fire()).unwrap())
        .unwrap();
    let error = MODEL
        .layer_of(
            appearance,
            &LayerSettings {
                mask: Some(nowhere),
                ..LayerSettings::default()
            },
        )
        .unwrap_err();
    assert!(
        error.to_string().contains("no surface at (0, -0.99, 0)"),
        "{error}"
    );
}
