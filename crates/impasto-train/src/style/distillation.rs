//! What VGG-16 sees in renders of a scene and which way its surfaces face, distilled into a field:
//! [`DistilledFeatures`].

use crate::optimizer::{Adam, Rate};
use burn::tensor::{Device, Tensor};
use glam::Vec3;
use impasto_field::encoding::matrix;
use impasto_field::{DistilledFeatures, GBufferOptions, Parameters, SurfacePoints, host};
use impasto_kernels::Sparse;
use impasto_model::{CameraRays, Model};
use impasto_scene::{Camera, Split};
use impasto_style::{Descriptor, StyleError};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::time::{Duration, Instant};

const _: () = assert!(Descriptor::LEN == DistilledFeatures::LEN);

/// Most views that are looked at.
const VIEWS: usize = 24;
/// Their shorter side: strokes are as wide as a few pixels of it.
const SIDE: u32 = 192;
/// In smaller ones the network sees nothing.
const LEAST_SIDE: usize = 8;
/// Pixels of each that are learned from.
const PIXELS: usize = 12_000;
/// Points that less light comes from say little.
const LEAST_WEIGHT: f32 = 0.05;
/// Points of one update.
const BATCH: usize = 4096;
/// Learning rates of the table and of the linear layer, which fall to a part of them.
const RATES: [f32; 2] = [2e-2, 5e-3];
const FINAL_RATE: f32 = 0.05;

/// How much is done.
#[derive(Debug, Clone, Copy)]
pub struct DistillationBudget {
    /// Most updates.
    pub steps: u64,
    /// Time for all of it, of which up to half goes into looking at views.
    pub time: Option<Duration>,
}

/// Points of surfaces and what is seen there.
#[derive(Default)]
struct Points {
    places: Vec<f32>,
    /// What is learned of each: descriptor and normal.
    wanted: Vec<f32>,
    weights: Vec<f32>,
}

/// Distils a model's scene; `None` where its appearances are not painted, or nothing is seen.
///
/// # Errors
/// If an asset is damaged.
pub fn distil(
    model: &Model,
    budget: DistillationBudget,
    seed: u64,
) -> Result<Option<DistilledFeatures>, StyleError> {
    let Some(paint) = model.file.config.style.shading.paint() else {
        return Ok(None);
    };
    let started = Instant::now();
    let mut rng = Pcg64::seed_from_u64(seed ^ 0x64_69_73_74);
    let points = seen(model, budget.time.map(|time| started + time / 2))?;
    if points.weights.is_empty() {
        return Ok(None);
    }
    let device = model.renderer().device();
    let mut adam = Adam::new(&DistilledFeatures::init(paint.distilled, &mut rng, &device));
    for step in 0..budget.steps {
        let spent = started.elapsed();
        let progress = budget
            .time
            .map(|time| spent.as_secs_f32() / time.as_secs_f32());
        let progress = progress
            .unwrap_or_default()
            .max(step as f32 / budget.steps as f32);
        if progress >= 1.0 {
            break;
        }
        descend(
            &mut adam,
            &points,
            FINAL_RATE.powf(progress),
            &device,
            &mut rng,
        );
    }
    Ok(Some(adam.values()))
}

/// One update on random points.
fn descend(
    adam: &mut Adam<DistilledFeatures>,
    points: &Points,
    fade: f32,
    device: &Device,
    rng: &mut Pcg64,
) {
    let mut batch = Points::default();
    for _ in 0..BATCH {
        let at = rng.random_range(0..points.weights.len());
        let width = DistilledFeatures::NUMBERS;
        batch.places.extend(&points.places[3 * at..][..3]);
        batch.wanted.extend(&points.wanted[width * at..][..width]);
        batch.weights.push(points.weights[at]);
    }
    let tracked = device.clone().autodiff();
    let rows = |numbers, width| matrix(numbers, width, &tracked);
    let leaves = adam.leaves();
    let wanted = rows(batch.wanted, DistilledFeatures::NUMBERS);
    let off = leaves.at(rows(batch.places, 3)) - wanted;
    let loss: Tensor<1> = (off.square() * rows(batch.weights, 1)).mean();
    let mut gradients = loss.backward();
    let named = leaves.named().into_iter();
    let gradients: Vec<_> = named
        .map(|(_, leaf)| leaf.grad_remove(&mut gradients))
        .collect();
    // Adam works in place only on what nobody else holds.
    drop(leaves);
    adam.step(gradients, |name| {
        let table = name.ends_with("encoding");
        Rate {
            rate: fade * if table { RATES[0] } else { RATES[1] },
            sparse: table.then_some(Sparse { decay: 0.0 }),
        }
    });
}

/// Looks at some of the training views.
fn seen(model: &Model, deadline: Option<Instant>) -> Result<Points, StyleError> {
    let descriptor = Descriptor::shipped()?;
    let cameras = model.file.scene.cameras(Split::Train);
    let step = cameras.len().div_ceil(VIEWS).max(1);
    let mut points = Points::default();
    for camera in cameras.iter().step_by(step) {
        if deadline.is_some_and(|end| Instant::now() > end) && !points.weights.is_empty() {
            break;
        }
        look(model, &smaller(camera), &descriptor, &mut points)?;
    }
    Ok(points)
}

/// With a shorter side of [`SIDE`] pixels, if it is longer.
fn smaller(camera: &Camera) -> Camera {
    let k = &camera.intrinsics;
    let share = (f64::from(SIDE) / f64::from(k.width.min(k.height))).min(1.0);
    let [width, height] = [k.width, k.height].map(|side| (f64::from(side) * share).round() as u32);
    camera.resized(width, height)
}

/// Adds what one view shows.
fn look(
    model: &Model,
    camera: &Camera,
    descriptor: &Descriptor,
    points: &mut Points,
) -> Result<(), StyleError> {
    let rays = CameraRays::new(camera, None);
    let (width, height) = rays.size();
    if width.min(height) < LEAST_SIDE {
        return Ok(());
    }
    let config = model.file.config.style_appearance();
    let options = GBufferOptions {
        config: &config,
        photo: Some(model.file.photo_app()),
        seed: None,
        least_weight: 0.0,
        rays_at_once: None,
    };
    let buffers = model.renderer().gbuffer(&rays.all(), &options);
    let Some(photo) = &buffers.photo else {
        return Ok(());
    };
    let image = host(photo.clone().slice_dim(1, 0..3).clamp(0.0, 1.0));
    let descriptors = descriptor.of(&image, height, width)?;
    // The golden ratio: no rows or columns are left out.
    let share = PIXELS as f32 / (width * height) as f32;
    let kept = |pixel: usize| (pixel as f64 * 0.618_033_988_75).fract() < f64::from(share);
    let found: Vec<_> = buffers
        .fine()
        .iter()
        .map(|part| (part.rays(), part.surface_points()))
        .collect();
    let normals = normals(&surface(&found, width * height), width);
    let mut first = 0;
    for (rays, found) in &found {
        for (i, (ray, weight)) in found.rays.iter().zip(&found.weights).enumerate() {
            let pixel = first + ray;
            if *weight >= LEAST_WEIGHT && kept(pixel) {
                let own = &descriptors[pixel * Descriptor::LEN..][..Descriptor::LEN];
                points.places.extend(&found.places[3 * i..][..3]);
                points.wanted.extend(own);
                points.wanted.extend(normals[pixel]);
                points.weights.push(*weight);
            }
        }
        first += rays;
    }
    Ok(())
}

/// Of each pixel the place that most of its light comes from, in contracted space.
fn surface(parts: &[(usize, SurfacePoints)], pixels: usize) -> Vec<[f32; 3]> {
    let mut places = vec![[0.0; 3]; pixels];
    let mut most = vec![0.0; pixels];
    let mut first = 0;
    for (rays, found) in parts {
        let (all, _) = found.places.as_chunks::<3>();
        for ((place, ray), weight) in all.iter().zip(&found.rays).zip(&found.weights) {
            let pixel = first + ray;
            if *weight > most[pixel] {
                (places[pixel], most[pixel]) = (*place, *weight);
            }
        }
        first += rays;
    }
    places
}

/// Pixels between the places that a slope is taken over: depth is rough.
const SLOPE: usize = 2;

/// Which way surfaces face, towards the camera or away from it as rows and columns have it, the same in all
/// views: from the shorter of the differences to either side, since the longer may lead over an edge. Zeros
/// where there is no slope.
fn normals(places: &[[f32; 3]], width: usize) -> Vec<[f32; 3]> {
    let height = places.len() / width;
    let place = |x: usize, y: usize| Vec3::from_array(places[y * width + x]);
    let shorter = |here: Vec3, before: Vec3, after: Vec3| {
        let (back, on) = (here - before, after - here);
        match back.length_squared() < on.length_squared() {
            true => back,
            false => on,
        }
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let normal = pixels.map(|(x, y)| {
        let inside = |at: usize, length: usize| at.clamp(SLOPE, length - 1 - SLOPE);
        let (x, y) = (inside(x, width), inside(y, height));
        let here = place(x, y);
        let across = shorter(here, place(x - SLOPE, y), place(x + SLOPE, y));
        let down = shorter(here, place(x, y - SLOPE), place(x, y + SLOPE));
        across.cross(down).normalize_or_zero().to_array()
    });
    normal.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two walls, one before the other, each turned its own way.
    #[test]
    fn normals_hold_up_to_edges() {
        const WIDTH: usize = 24;
        let wall = |slope: [f32; 2], depth: f32, x: f32, y: f32| {
            [x, y, depth + slope[0] * x + slope[1] * y]
        };
        let pixels = (0..16 * WIDTH).map(|i| (i % WIDTH, i / WIDTH));
        let place = |(x, y): (usize, usize)| {
            let at = (x as f32 * 0.01, y as f32 * 0.01);
            match x < 10 {
                true => wall([0.5, 0.0], 1.0, at.0, at.1),
                false => wall([0.0, -0.3], 2.0, at.0, at.1),
            }
        };
        let places: Vec<_> = pixels.clone().map(place).collect();
        let found = normals(&places, WIDTH);
        for ((x, y), normal) in pixels.zip(found) {
            let wanted = match x < 10 {
                true => Vec3::new(-0.5, 0.0, 1.0),
                false => Vec3::new(0.0, 0.3, 1.0),
            };
            let off = Vec3::from_array(normal) - wanted.normalize_or_zero();
            assert!(off.length() < 1e-3, "{x}, {y}: {normal:?}");
        }
    }

    #[test]
    fn one_place_has_no_normal() {
        let found = normals(&[[0.1, 0.2, 0.3]; 64], 8);
        assert!(found.iter().all(|normal| *normal == [0.0; 3]));
    }
}
