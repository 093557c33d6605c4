//! What the metrics promise, tested on a painted plane that is rendered exactly: consistency alone
//! can be won by blur and by nothing at all, and its guards tell.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use crate::fidelity::{FidelityMetric, PaintingResult};
use crate::trajectory::{Trajectory, TrajectoryMetrics};
use glam::{DMat4, DVec2, DVec3};
use image::imageops::blur;
use image::{Rgb, RgbImage};
use impasto_scene::{Camera, Distortion, Intrinsics};
use impasto_style::Perceptual;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;
const FRAMES: usize = 9;
/// A point of the plane, and its normal: seen at a slant.
const POINT: DVec3 = DVec3::new(0.0, 0.0, 3.0);
const NORMAL: DVec3 = DVec3::new(0.3, -0.2, -1.0);

/// A path that moves sideways and turns.
fn path() -> Vec<Camera> {
    let camera = |frame: usize| {
        let along = frame as f64 / FRAMES as f64;
        let place = DVec3::new(0.4 * along, 0.1 * along, 0.05 * along);
        Camera {
            intrinsics: Intrinsics {
                width: WIDTH,
                height: HEIGHT,
                fl_x: 90.0,
                fl_y: 90.0,
                cx: 48.0,
                cy: 36.0,
                distortion: Distortion::default(),
            },
            camera_to_world: DMat4::from_translation(place)
                * DMat4::from_rotation_y(-0.1 * along)
                * DMat4::from_rotation_z(0.05 * along),
        }
    };
    (0..FRAMES).map(camera).collect()
}

/// Depth of every pixel, and where on the plane it lies.
fn met(camera: &Camera) -> Vec<(f32, DVec2)> {
    let meet = |i: u32| {
        let ray = camera.ray(f64::from(i % WIDTH) + 0.5, f64::from(i / WIDTH) + 0.5);
        let depth = (POINT - ray.origin).dot(NORMAL) / ray.direction.dot(NORMAL);
        (
            depth as f32,
            (ray.origin + ray.direction * depth).truncate(),
        )
    };
    (0..WIDTH * HEIGHT).map(meet).collect()
}

/// Frames of the plane in one paint (values in `[0, 1]`), with noise of their own.
fn shots(paint: fn(DVec2) -> [f64; 3], noise: f64) -> Vec<RgbImage> {
    let path = path();
    let shot = |(frame, camera): (usize, &Camera)| {
        let met = met(camera);
        RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
            let random = (x * 31 + y * 17 + frame as u32 * 101).wrapping_mul(2_654_435_761) >> 24;
            let off = noise * (f64::from(random) / 255.0 - 0.5);
            let (_, place) = met[(y * WIDTH + x) as usize];
            Rgb(paint(place).map(|v| (255.0 * (v + off)).round() as u8))
        })
    };
    path.iter().enumerate().map(shot).collect()
}

fn trajectory() -> Trajectory {
    let path = path();
    let depth = |camera| met(camera).into_iter().map(|(depth, _)| depth).collect();
    let depths: Vec<Vec<f32>> = path.iter().map(depth).collect();
    Trajectory::of_frames(&path, shots(photo, 0.0), &depths, None)
}

fn between(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * share)
}

/// The thing that is shown: broad soft shapes, from 0 to 1.
fn shapes(at: DVec2) -> f64 {
    0.5 + 0.25 * (3.0 * at.x).sin() + 0.25 * (4.0 * at.y + at.x).cos()
}

/// The painting's strokes, from 0 to 1.
fn strokes(at: DVec2) -> f64 {
    0.5 + 0.5 * (22.0 * at.x + 14.0 * at.y).sin()
}

fn photo(at: DVec2) -> [f64; 3] {
    between([0.25, 0.35, 0.6], [0.75, 0.8, 0.7], shapes(at))
}

fn stylised(at: DVec2) -> [f64; 3] {
    let share = 0.4 * shapes(at) + 0.6 * strokes(at);
    between([0.3, 0.1, 0.1], [0.9, 0.6, 0.2], share)
}

fn painting() -> RgbImage {
    RgbImage::from_fn(160, 160, |x, y| {
        let at = DVec2::new(f64::from(x), f64::from(y)) / 30.0;
        let colour = between([0.3, 0.1, 0.1], [0.9, 0.6, 0.2], strokes(at));
        Rgb(colour.map(|v| (255.0 * v) as u8))
    })
}

fn measured(trajectory: &Trajectory, vgg: &Perceptual, frames: &[RgbImage]) -> TrajectoryMetrics {
    trajectory.measure(frames, vgg).unwrap().unwrap()
}

#[test]
fn a_plane_rendered_exactly_agrees_to_rounding() {
    let (trajectory, vgg) = (trajectory(), Perceptual::vgg16().unwrap());
    let found = measured(&trajectory, &vgg, &trajectory.frames).exact;
    for range in found {
        // Two roundings to 8 bits are worth 1/6 of a squared step, interpolation about as much.
        let step = 100.0 / (255.0 * 255.0);
        assert!(range.e100 < 0.4 * step, "{range:?}");
        assert!(range.coverage > 0.7 && range.dropped == 0, "{range:?}");
    }
    // At both ranges, because the path turns and the plane is slanted.
    let noisy = [0.02, 0.05, 0.1].map(|n| measured(&trajectory, &vgg, &shots(photo, n)).exact);
    for range in 0..2 {
        let rising = [found, noisy[0], noisy[1], noisy[2]].map(|all| all[range].e100);
        assert!(rising.is_sorted_by(|a, b| a < b), "{rising:?}");
    }
}

#[test]
fn blur_and_emptiness_win_consistency_and_fail_its_guards() {
    let (trajectory, vgg) = (trajectory(), Perceptual::vgg16().unwrap());
    let paintings = [("strokes".to_owned(), painting())];
    let metric = FidelityMetric::new(&vgg, &paintings, &trajectory.frames[..2]).unwrap();
    let of = |frames: &[RgbImage]| -> (TrajectoryMetrics, PaintingResult) {
        let fidelity = metric.of_views(0, &frames[..2]).unwrap();
        (measured(&trajectory, &vgg, frames), fidelity)
    };
    let sharp = shots(stylised, 0.04);
    let blurred: Vec<_> = sharp.iter().map(|frame| blur(frame, 3.0)).collect();
    let flat = vec![RgbImage::from_pixel(WIDTH, HEIGHT, Rgb([153, 89, 38])); FRAMES];
    let [sharp, blurred, flat] = [of(&sharp), of(&blurred), of(&flat)];

    for range in 0..2 {
        let e100 = |found: &(TrajectoryMetrics, PaintingResult)| found.0.exact[range].e100;
        assert!(e100(&blurred) < e100(&sharp) && e100(&flat) < 1e-9);
    }
    // Sharpness sees both.
    let details = [&sharp, &blurred, &flat].map(|found| found.0.sharpness);
    assert!(
        details[0] > 1.0 && details[1] < 0.3 * details[0] && details[2] == 0.0,
        "{details:?}"
    );
    // So does the style.
    let gains = [&sharp, &blurred, &flat].map(|found| found.1.style_gain);
    assert!(
        gains[0] > 0.2 && gains[1..].iter().all(|gain| *gain < gains[0] - 0.1),
        "{gains:?}"
    );
}
