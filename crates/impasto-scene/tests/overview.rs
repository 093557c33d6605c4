//! The picture of a capture shows its cameras and points where they are.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::f64::consts::TAU;

use common::{ring, shared};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use impasto_scene::overview::picture;
use impasto_scene::{Format, LoadOptions, Normalisation, Photo, Scene, SparsePoint, Split, load};

/// Eight cameras around the origin, the first held out, in scene space.
fn scene() -> Scene {
    let photo = |(index, mut camera): (usize, impasto_scene::Camera)| {
        // Not round, so that one direction is the widest.
        let centre = camera.centre() * DVec3::new(0.3, 0.3, 0.25);
        camera.camera_to_world.w_axis = centre.extend(1.0);
        Photo {
            name: format!("{index}.png"),
            path: "nowhere".into(),
            camera,
            split: Split::by_index(index),
            pixels: RgbImage::new(60, 40),
            mask: None,
        }
    };
    Scene {
        name: "ring".into(),
        format: Format::Transforms,
        photos: ring(8, TAU, DVec3::ZERO)
            .into_iter()
            .enumerate()
            .map(photo)
            .collect(),
        points: Vec::new(),
        normalisation: Normalisation::IDENTITY,
        synthetic: true,
        warnings: Vec::new(),
    }
}

fn green(position: DVec3) -> SparsePoint {
    SparsePoint {
        position,
        colour: [0, 200, 0],
        seen_by: Vec::new(),
        error: -1.0,
    }
}

/// Places of the pixels of one panel (0 or 1) that `wanted` accepts, in its own coordinates.
fn places(picture: &RgbImage, panel: u32, wanted: impl Fn([i16; 3]) -> bool) -> Vec<DVec2> {
    let pixels = picture.enumerate_pixels();
    pixels
        .filter(|(x, _, pixel)| x / 600 == panel && wanted(pixel.0.map(i16::from)))
        .map(|(x, y, _)| DVec2::new(f64::from(x % 600), f64::from(y)))
        .collect()
}

fn is_blue([r, _, b]: [i16; 3]) -> bool {
    b - r > 120
}

fn is_orange([r, _, b]: [i16; 3]) -> bool {
    r - b > 120
}

fn is_green([r, g, b]: [i16; 3]) -> bool {
    g - r > 120 && g - b > 120
}

fn mean(places: &[DVec2]) -> DVec2 {
    assert!(!places.is_empty(), "nothing of this colour");
    places.iter().sum::<DVec2>() / places.len() as f64
}

fn height(places: &[DVec2]) -> f64 {
    let rows = || places.iter().map(|at| at.y);
    rows().fold(0.0, f64::max) - rows().fold(f64::INFINITY, f64::min)
}

#[test]
fn cameras_stand_around_in_one_view_and_in_a_row_in_the_other() {
    let drawn = picture(&scene());
    assert_eq!(drawn.dimensions(), (1200, 600));
    let (above, beside) = (places(&drawn, 0, is_blue), places(&drawn, 1, is_blue));
    assert!(height(&above) > 450.0 && height(&beside) < 150.0);
    let held_out = mean(&places(&drawn, 0, is_orange));
    let radius = held_out.distance(DVec2::splat(300.0));
    assert!((180.0..300.0).contains(&radius), "{held_out}");
}

#[test]
fn the_held_out_camera_is_drawn_where_it_stands() {
    let mut moved = scene();
    let before = mean(&places(&picture(&moved), 0, is_orange));
    moved.photos.swap(0, 4);
    moved.photos[0].split = Split::Train;
    moved.photos[4].split = Split::Test;
    let after = mean(&places(&picture(&moved), 0, is_orange));
    assert!(
        before.distance(after) < 1.0,
        "the same camera under another number"
    );
    moved.photos[4].split = Split::Train;
    moved.photos[2].split = Split::Test;
    let other = mean(&places(&picture(&moved), 0, is_orange));
    assert!(
        before.distance(other) > 200.0,
        "a quarter of the circle away"
    );
}

#[test]
fn points_lie_between_their_cameras_and_strays_do_not_shrink_the_rest() {
    let mut with_points = scene();
    with_points.points = (0..60)
        .map(|i| green(DVec3::new(0.002, 0.0, 0.001) * f64::from(i - 30)))
        .collect();
    let drawn = picture(&with_points);
    for panel in [0, 1] {
        let at = mean(&places(&drawn, panel, is_green));
        assert!(at.distance(DVec2::splat(300.0)) < 110.0, "{at}");
    }
    with_points.points.push(green(DVec3::new(40.0, -90.0, 7.0)));
    let strayed = picture(&with_points);
    let cameras = |picture: &RgbImage| height(&places(picture, 0, is_blue));
    assert!((cameras(&strayed) - cameras(&drawn)).abs() < 2.0);
}

#[test]
fn odd_captures_have_a_picture() {
    let mut one_line = scene();
    for (i, photo) in one_line.photos.iter_mut().enumerate() {
        photo.camera.camera_to_world.w_axis = DVec3::new(0.1 * i as f64, 0.0, 0.0).extend(1.0);
    }
    one_line.points = vec![green(DVec3::splat(1e12)), green(DVec3::splat(f64::NAN))];
    let drawn = picture(&one_line);
    assert!(!places(&drawn, 0, is_blue).is_empty());
    let mut none = scene();
    none.photos.clear();
    assert!(picture(&none).pixels().all(|p| *p == Rgb([250, 249, 246])));
}

#[test]
fn a_real_capture_fills_its_picture() {
    let Some(path) = shared("data/scenes/sakharov_statue") else {
        return;
    };
    let options = LoadOptions {
        downscale: 16,
        ..LoadOptions::default()
    };
    let drawn = picture(&load(&path, &options).unwrap());
    assert!(height(&places(&drawn, 0, is_blue)) > 250.0);
    assert!(!places(&drawn, 0, is_orange).is_empty());
}
