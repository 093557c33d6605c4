//! One cloud of oriented points from many views.

use glam::Vec3;
use rayon::prelude::*;

use crate::ExportError;
use crate::surface::{Sample, agree, samples, tolerance};
use crate::views::{Pinhole, PosedView, Views, Watch, share};

/// A point of this spacing, in pixels, hides the need for others up to this far away: a square
/// lattice's farthest places are 0.71 away.
const COVERED: f32 = 0.75;
/// A point that is this many times coarser than what a view shows gives way to finer ones.
const TOO_COARSE: f32 = 2.0;
/// Smallest cosine between a normal and the ray: what is viewed more slantingly than this has its
/// points no longer than this says.
pub(crate) const LEAST_COSINE: f32 = 0.3;
/// Spacing of points on the sky, in pixels: it has little detail.
const SKY_SPACING: f32 = 3.0;
/// Other views contradict a point if what they show is this many tolerances behind it.
const CLEARLY: f32 = 2.0;

/// A point of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surfel {
    /// In scene space.
    pub position: Vec3,
    /// Outwards, of length 1.
    pub normal: Vec3,
    /// Mean of the views.
    pub colour: Vec3,
    /// Distance to its neighbours.
    pub spacing: f32,
    /// Direction of length 1 to the camera that shows it best.
    pub toward: Vec3,
    /// How many times as far neighbours are in the direction in which the surface runs away from
    /// that camera; at least 1.
    pub stretch: f32,
    /// Whether it is part of the sky.
    pub sky: bool,
    weight: f32,
}

/// What is wanted of a cloud.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CloudOptions {
    /// Distance between points, in pixels of the views.
    pub spacing: f32,
    /// Also what has no certain normal, and the sky.
    pub everything: bool,
}

/// Merges the views' surfaces: a point that a view shows again becomes the mean of both, what is
/// new is added, and what most views see through is left out.
pub(crate) fn cloud(
    views: &Views,
    options: &CloudOptions,
    part: [f64; 2],
    watch: &mut Watch<'_>,
) -> Result<Vec<Surfel>, ExportError> {
    let sampled: Vec<Vec<Sample>> = views.posed.iter().map(samples).collect();
    let mut surfels = Vec::new();
    let count = views.len();
    for (i, (view, samples)) in views.posed.iter().zip(&sampled).enumerate() {
        watch.at("points", share(part, i, count))?;
        merge(&mut surfels, view, samples, options);
    }
    let cameras = || views.posed.iter().map(|view| &view.camera).zip(&sampled);
    let kept = surfels.par_iter().filter(|s| is_supported(s, cameras()));
    let surfels: Vec<Surfel> = kept.copied().collect();
    if surfels.iter().all(|surfel| surfel.sky) {
        return Err(ExportError::NoSurfaces { views: count });
    }
    Ok(surfels)
}

fn merge(surfels: &mut Vec<Surfel>, view: &PosedView, samples: &[Sample], options: &CloudOptions) {
    let mut merger = ViewMerger {
        view,
        samples,
        covered: vec![false; samples.len()],
        spacing: options.spacing,
    };
    surfels.retain_mut(|surfel| merger.absorb(surfel));
    let lattice = |step: usize| {
        let width = view.camera.width;
        let on = move |at: usize| at % step == step / 2;
        (0..samples.len()).filter(move |i| on(i % width) && on(i / width))
    };
    let step = options.spacing.round().max(1.0) as usize;
    let sky_step = (SKY_SPACING * options.spacing).round() as usize;
    // A lattice first; then what it leaves out, which is thin or lies between two depths.
    let sky = lattice(sky_step).filter(|i| samples[*i].sky);
    for i in sky.chain(lattice(step)).chain(0..samples.len()) {
        let sample = &samples[i];
        let wanted = options.everything || (!sample.sky && sample.normal != Vec3::ZERO);
        if wanted && !merger.covered[i] {
            surfels.push(merger.add(i));
        }
    }
}

/// One view while points are merged with it.
struct ViewMerger<'a> {
    view: &'a PosedView,
    samples: &'a [Sample],
    covered: Vec<bool>,
    spacing: f32,
}

impl ViewMerger<'_> {
    /// Merges a point with what the view shows of it; `false` if it gives way to that.
    fn absorb(&mut self, surfel: &mut Surfel) -> bool {
        let camera = &self.view.camera;
        let Some((x, y, depth)) = camera.pixel(surfel.position) else {
            return true;
        };
        let index = y * camera.width + x;
        let sample = &self.samples[index];
        let ray = surfel.position - camera.centre;
        if !agree(depth, sample.depth) || surfel.normal.dot(ray) > 0.0 {
            return true;
        }
        let footprint = camera.footprint(depth);
        let own = self.spacing * footprint * if sample.sky { SKY_SPACING } else { 1.0 };
        if surfel.spacing > TOO_COARSE * own {
            return sample.normal == Vec3::ZERO;
        }
        let cosine = cosine(surfel.normal, ray);
        let weight = weight(cosine, footprint);
        let sum = surfel.weight + weight;
        let part = weight / sum;
        // Only along the ray: across it points stay as far apart as they are.
        surfel.position += ray * (part * (sample.depth / depth - 1.0));
        surfel.colour += (self.view.colours[index] - surfel.colour) * part;
        if sample.normal != Vec3::ZERO {
            let normal = surfel.normal + (sample.normal - surfel.normal) * part;
            surfel.normal = normal.normalize_or(surfel.normal);
        }
        surfel.weight = sum;
        let stretch = 1.0 / cosine;
        if own * stretch < surfel.spacing * surfel.stretch {
            (surfel.toward, surfel.stretch) = (-ray.normalize_or_zero(), stretch);
        }
        self.cover([x, y], depth, surfel.spacing / footprint);
        true
    }

    /// The point that a pixel shows.
    fn add(&mut self, index: usize) -> Surfel {
        let camera = &self.view.camera;
        let (x, y) = (index % camera.width, index / camera.width);
        let sample = self.samples[index];
        let position = camera.point(x, y, sample.depth);
        let ray = position - camera.centre;
        let normal = match sample.normal {
            Vec3::ZERO => -ray.normalize_or(Vec3::Z),
            normal => normal,
        };
        let footprint = camera.footprint(sample.depth);
        let pixels = self.spacing * if sample.sky { SKY_SPACING } else { 1.0 };
        self.cover([x, y], sample.depth, pixels);
        let cosine = cosine(normal, ray);
        Surfel {
            position,
            normal,
            colour: self.view.colours[index],
            spacing: pixels * footprint,
            toward: -ray.normalize_or_zero(),
            stretch: 1.0 / cosine,
            sky: sample.sky,
            weight: weight(cosine, footprint),
        }
    }

    /// Marks what a point of a spacing, in pixels, shows.
    fn cover(&mut self, [x, y]: [usize; 2], depth: f32, pixels: f32) {
        let radius = COVERED * pixels.max(1.0);
        let reach = radius as usize;
        let camera = &self.view.camera;
        for v in y.saturating_sub(reach)..=(y + reach).min(camera.height - 1) {
            for u in x.saturating_sub(reach)..=(x + reach).min(camera.width - 1) {
                let (dx, dy) = (u.abs_diff(x) as f32, v.abs_diff(y) as f32);
                let index = v * camera.width + u;
                if dx * dx + dy * dy <= radius * radius && agree(depth, self.samples[index].depth) {
                    self.covered[index] = true;
                }
            }
        }
    }
}

fn cosine(normal: Vec3, ray: Vec3) -> f32 {
    (-normal.dot(ray.normalize_or_zero())).clamp(LEAST_COSINE, 1.0)
}

/// What is seen from near and face to face counts most.
fn weight(cosine: f32, footprint: f32) -> f32 {
    (cosine / footprint.max(1e-9)).powi(2)
}

/// Whether at least as many views show a point as see what is clearly behind it.
fn is_supported<'a>(
    surfel: &Surfel,
    views: impl Iterator<Item = (&'a Pinhole, &'a Vec<Sample>)>,
) -> bool {
    let (mut shown, mut through) = (0, 0);
    for (camera, samples) in views {
        let Some((x, y, depth)) = camera.pixel(surfel.position) else {
            continue;
        };
        let around = (y.saturating_sub(1)..=(y + 1).min(camera.height - 1)).flat_map(|v| {
            let columns = x.saturating_sub(1)..=(x + 1).min(camera.width - 1);
            columns.map(move |u| samples[v * camera.width + u].depth)
        });
        // The nearest of its neighbours: the point may be thin.
        let nearest = around.fold(f32::INFINITY, f32::min);
        if agree(depth, samples[y * camera.width + x].depth) {
            shown += 1;
        } else if nearest - depth > CLEARLY * tolerance(depth) {
            through += 1;
        }
    }
    shown >= through
}
