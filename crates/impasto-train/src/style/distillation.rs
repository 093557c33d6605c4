//! What VGG-16 sees in renders of a scene, distilled into a field: [`DistilledFeatures`].

use crate::optimizer::{Adam, Rate};
use burn::tensor::{Device, Tensor};
use impasto_field::encoding::matrix;
use impasto_field::{DistilledFeatures, GBufferOptions, Parameters, host};
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
    descriptors: Vec<f32>,
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
        let width = Descriptor::LEN;
        batch.places.extend(&points.places[3 * at..][..3]);
        batch
            .descriptors
            .extend(&points.descriptors[width * at..][..width]);
        batch.weights.push(points.weights[at]);
    }
    let tracked = device.clone().autodiff();
    let rows = |numbers, width| matrix(numbers, width, &tracked);
    let leaves = adam.leaves();
    let off = leaves.at(rows(batch.places, 3)) - rows(batch.descriptors, Descriptor::LEN);
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
    let mut first = 0;
    for part in buffers.fine() {
        let found = part.surface_points();
        for (i, (ray, weight)) in found.rays.iter().zip(&found.weights).enumerate() {
            let pixel = first + ray;
            if *weight >= LEAST_WEIGHT && kept(pixel) {
                let own = &descriptors[pixel * Descriptor::LEN..][..Descriptor::LEN];
                points.places.extend(&found.places[3 * i..][..3]);
                points.descriptors.extend(own);
                points.weights.push(*weight);
            }
        }
        first += part.rays();
    }
    Ok(())
}
