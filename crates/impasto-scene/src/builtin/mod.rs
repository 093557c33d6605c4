//! The built-in scene: a synthetic square with an equestrian statue, rendered by code.
//!
//! Near content (statue, plinth, paving), middle (benches, lamps, walls, trees), far (houses) and
//! infinitely far (hills, sky) stand all around, in metres, z up, the statue over the origin. A
//! colour is a pure function of the ray and the pixel's size, so every camera sees the same place,
//! and depth is exact.

mod anatomy;
mod builder;
mod bvh;
mod facade;
mod ground;
mod materials;
mod noise;
mod place;
mod sky;
mod solids;
mod statue;
mod surface;
mod surroundings;
#[cfg(test)]
mod tests;
mod trace;
mod write;

use std::f64::consts::TAU;

use glam::{DMat3, DMat4, DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;

use crate::camera::{Camera, Intrinsics, Ray};
use crate::paths::pinhole::pinhole;
use trace::{World, world};
pub use write::{WriteCaptureError, write_capture};

/// Size of the built-in capture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BuiltinOptions {
    /// Number of photos, at least 1.
    pub photos: usize,
    /// Photo width in pixels, at least 1.
    pub width: u32,
    /// Photo height in pixels, at least 1.
    pub height: u32,
    /// Horizontal field of view in radians, within (0, π).
    pub field_of_view: f64,
}

impl Default for BuiltinOptions {
    fn default() -> Self {
        Self {
            photos: 40,
            width: 384,
            height: 288,
            field_of_view: 60f64.to_radians(),
        }
    }
}

/// A rendered photo of the built-in scene.
#[derive(Debug, Clone)]
pub struct BuiltinView {
    /// Where it was taken; metres.
    pub camera: Camera,
    /// Colours as stored (sRGB).
    pub pixels: RgbImage,
    /// Depth along the camera's axis at pixel centres in metres, row-major `height × width`;
    /// `f32::INFINITY` where the sky or the hills are seen.
    pub depth: Vec<f32>,
}

/// The capture's cameras: one walk around the statue, mostly at eye height, with varied heights
/// and distances and a hand's jitter of the aim. Always the same for the same options.
pub fn cameras(options: &BuiltinOptions) -> Vec<Camera> {
    let (width, height) = (options.width.max(1), options.height.max(1));
    let focal = f64::from(width) * 0.5 / (options.field_of_view * 0.5).tan();
    let intrinsics = pinhole(focal, (width, height));
    (0..options.photos)
        .map(|index| on_walk(intrinsics, index, options.photos))
        .collect()
}

fn on_walk(intrinsics: Intrinsics, index: usize, photos: usize) -> Camera {
    let jitter = |k: i32| f64::from(noise::draw(1234, index as i32 * 8 + k)) * 2.0 - 1.0;
    let angle = (index as f64 + 0.22 * jitter(0)) / photos as f64 * TAU;
    let radius = 6.3 + 0.6 * (3.0 * angle + 0.6).sin() + 0.35 * jitter(1);
    let height = 1.75 + 0.45 * (2.0 * angle + 1.0).sin() + 0.3 * jitter(2);
    let eye = DVec3::new(radius * angle.cos(), radius * angle.sin(), height);
    let aim = DVec3::new(0.22 * jitter(3), 0.22 * jitter(4), 2.15 + 0.12 * jitter(5));
    Camera {
        intrinsics,
        camera_to_world: looking_at(eye, aim),
    }
}

/// Camera-to-world with x right, y down, z towards `aim`; world z is up.
fn looking_at(eye: DVec3, aim: DVec3) -> DMat4 {
    let forward = (aim - eye).normalize_or_zero();
    let right = forward.cross(DVec3::Z).normalize_or_zero();
    DMat4::from_mat3_translation(DMat3::from_cols(right, forward.cross(right), forward), eye)
}

/// Renders the scene through any camera whose world is the scene's own frame (metres, z up).
///
/// Lens distortion is followed ray by ray. Runs on all of rayon's threads.
pub fn render(camera: &Camera) -> BuiltinView {
    let (width, height) = camera.intrinsics.size();
    let world = world();
    let (colours, depth): (Vec<[u8; 3]>, _) = pixels(camera, |x, y| pixel(world, camera, x, y))
        .into_iter()
        .unzip();
    let colour = |x, y| image::Rgb(colours[y as usize * width as usize + x as usize]);
    BuiltinView {
        camera: *camera,
        pixels: RgbImage::from_fn(width, height, colour),
        depth,
    }
}

/// Depth of a camera's view without its colours: what [`render`] says, many times faster.
///
/// `height × width`, metres along the camera's axis at pixel centres; `f32::INFINITY` for sky and
/// hills, whose colour depends on the ray's direction alone. Runs on all of rayon's threads.
pub fn depth(camera: &Camera) -> Vec<f32> {
    let world = world();
    pixels(camera, |x, y| {
        let aim = Aim::new(camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
        aim.depth(world.meet(aim.origin, aim.direction).1)
    })
}

/// What `of` says of each pixel, row by row.
fn pixels<T: Send>(camera: &Camera, of: impl Fn(u32, u32) -> T + Sync) -> Vec<T> {
    let (width, height) = camera.intrinsics.size();
    let row = |y| (0..width).map(|x| of(x, y)).collect::<Vec<T>>();
    let rows: Vec<Vec<T>> = (0..height).into_par_iter().map(row).collect();
    rows.into_iter().flatten().collect()
}

/// How far a pose may be from the one that it was written from: a rounding error.
const SAME_POSE: f64 = 1e-6;

/// Whether these poses, in order and in metres, are those of a built-in capture of as many photos:
/// what tells a model of this scene from one of another synthetic scene. Any lens will do.
pub fn is_capture(poses: &[DMat4]) -> bool {
    let options = BuiltinOptions {
        photos: poses.len(),
        ..BuiltinOptions::default()
    };
    let ours = cameras(&options);
    let mut pairs = ours.iter().zip(poses);
    !poses.is_empty() && pairs.all(|(a, b)| a.camera_to_world.abs_diff_eq(*b, SAME_POSE))
}

/// Offsets from a pixel's centre of the samples that every pixel takes beside the centre.
const CORNERS: [(f64, f64); 4] = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
/// The rest of the 3 × 3 grid, taken where the others differ.
const EDGES: [(f64, f64); 4] = [(0.0, -1.0), (-1.0, 0.0), (1.0, 0.0), (0.0, 1.0)];
/// Largest difference of stored colour between samples that needs no more of them.
const SMOOTH: f32 = 0.05;

/// Colour and centre depth of one pixel.
fn pixel(world: &World, camera: &Camera, x: u32, y: u32) -> ([u8; 3], f32) {
    let (middle_x, middle_y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
    let (centre, depth) = sample(world, camera, middle_x, middle_y);
    let beside =
        |(dx, dy): (f64, f64)| sample(world, camera, middle_x + dx / 3.0, middle_y + dy / 3.0).0;
    let (mut low, mut high, mut sum) = (centre, centre, centre);
    for colour in CORNERS.map(beside) {
        (low, high, sum) = (low.min(colour), high.max(colour), sum + colour);
    }
    let mut count = 5.0;
    if (high - low).max_element() > SMOOTH {
        sum += EDGES.map(beside).into_iter().sum::<Vec3>();
        count = 9.0;
    }
    let stored = sum / count * 255.0;
    (
        [stored.x, stored.y, stored.z].map(|v| v.round() as u8),
        depth,
    )
}

/// Stored colour and depth along the axis through an image position.
fn sample(world: &World, camera: &Camera, x: f64, y: f64) -> (Vec3, f32) {
    let aim = Aim::new(camera, x, y);
    let pixel = 1.0 / (camera.intrinsics.fl_x * aim.length);
    let (colour, t) = world.radiance(aim.origin, aim.direction, pixel as f32);
    (sky::encode(colour), aim.depth(t))
}

/// A unit ray through an image position.
struct Aim {
    origin: Vec3,
    direction: Vec3,
    /// Distance along the ray over depth along the camera's axis.
    length: f64,
}

impl Aim {
    fn new(camera: &Camera, x: f64, y: f64) -> Self {
        let Ray { origin, direction } = camera.ray(x, y);
        let length = direction.length();
        Self {
            origin: origin.as_vec3(),
            direction: (direction / length).as_vec3(),
            length,
        }
    }

    /// Depth along the camera's axis of what is `t` away.
    fn depth(&self, t: f32) -> f32 {
        t / self.length as f32
    }
}
