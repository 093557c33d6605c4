//! Photos → field (PAPER §4).

use crate::budget::Clock;
use crate::config::{GeometryConfig, TrainConfig};
use crate::rays::{KnownSurface, PhotoRays, Targets, draw};
use burn::tensor::{Device, Tensor};
use glam::{DVec3, DVec4, Vec4Swizzles};
use impasto_field::{
    Appearance, BranchWeights, Field, FieldWeights, Grids, Samples, Visible, contracted_distance,
    loss::Wanted, render::host,
};
use impasto_kernels::ops::AdamParam;
use impasto_scene::{Camera, Scene, Split};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::sync::Arc;

/// Share of a grid's cells looked at, at each update: of all, and of those that hold something.
const GRID_SHARES: [f32; 2] = [0.03, 0.2];
/// Density that grids start from: none is known better than any other.
const FIRST_DENSITY: f32 = 1.0;

/// A field in training.
pub struct GeometryStage {
    field: Field,
    config: GeometryConfig,
    photos: Vec<PhotoRays>,
    surfaces: Vec<KnownSurface>,
    params: Params,
    app: Appearance,
    grids: Grids,
    visible: Visible,
    rng: Pcg64,
    step: u64,
}

/// What one step did.
#[derive(Debug, Clone, Copy)]
pub struct StepReport {
    /// Mean squared error of the colours.
    pub loss: f64,
    /// Rays used.
    pub rays: usize,
}

/// Adam's view of everything the stage learns: encoding, base, geo of both volumes, app, and the
/// vector that they share.
struct Params {
    branches: [[AdamParam; 3]; 2],
    app: [AdamParam; 2],
    latent: Option<AdamParam>,
}

impl Params {
    fn new(weights: FieldWeights, app: &Appearance) -> Self {
        let branch = |w: BranchWeights| [w.encoding, w.base, w.geo].map(AdamParam::new);
        Self {
            latent: weights.inner.latent.clone().map(AdamParam::new),
            branches: [branch(weights.inner), branch(weights.outer)],
            app: [&app.inner, &app.outer].map(|w| AdamParam::new(w.clone())),
        }
    }

    fn weights(&self, leaf: impl Fn(&AdamParam) -> Tensor<1>) -> FieldWeights {
        let latent = self.latent.as_ref().map(&leaf);
        let branch = |p: &[AdamParam; 3]| BranchWeights {
            encoding: leaf(&p[0]),
            base: leaf(&p[1]),
            geo: leaf(&p[2]),
            latent: latent.clone(),
        };
        FieldWeights {
            inner: branch(&self.branches[0]),
            outer: branch(&self.branches[1]),
        }
    }
}

/// One Adam step, where the loss depended on the parameter at all.
fn descend_one(param: &mut AdamParam, grad: Option<Tensor<1>>, rate: f32, sparse: bool) {
    if let Some(grad) = grad {
        param.step(grad, rate, sparse);
    }
}

impl GeometryStage {
    /// Prepares a scene's training photos.
    pub fn new(scene: &Scene, config: &TrainConfig, seed: u64, device: &Device) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let field = Field::new(config.field.clone());
        let weights = field.init(&mut rng, device);
        let app = Appearance::init(config.photo_app.clone(), field.features(), &mut rng, device);
        let cameras = scene.cameras(Split::Train);
        let visible = field.visible(|point| seen_by_any(&cameras, point));
        Self {
            params: Params::new(weights, &app),
            app,
            grids: field.grids(FIRST_DENSITY, Some(&visible)),
            visible,
            config: config.geometry.clone(),
            photos: crate::rays::photo_rays(scene.train().map(|(_, p)| p)),
            surfaces: known_surfaces(scene),
            field,
            rng,
            step: 0,
        }
    }

    /// The field's sizes.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Current weights, grids and photo appearance.
    pub fn snapshot(&self) -> (FieldWeights, Grids, Appearance) {
        let (weights, app) = self.leaves(AdamParam::value);
        (weights, self.grids.clone(), app)
    }

    fn leaves(&self, leaf: impl Fn(&AdamParam) -> Tensor<1>) -> (FieldWeights, Appearance) {
        let weights = self.params.weights(&leaf);
        let app = Appearance {
            inner: leaf(&self.params.app[0]),
            outer: leaf(&self.params.app[1]),
            latent: self.app.config.latent.and(weights.inner.latent.clone()),
            ..self.app.clone()
        };
        (weights, app)
    }

    /// One optimiser step.
    pub fn step(&mut self, clock: &Clock) -> StepReport {
        let progress = clock.progress() as f32;
        if self.step.is_multiple_of(self.config.grid_every) {
            let weights = self.params.weights(AdamParam::value);
            self.field.update_grids(
                &mut self.grids,
                &weights,
                &self.visible,
                GRID_SHARES,
                &mut self.rng,
            );
        }
        let [fewest, most] = self.config.rays;
        let per_ray = self.field.config.sampling.samples.max(1);
        let rays = (self.config.samples / per_ray).clamp(fewest, most);
        let known = if self.surfaces.is_empty() {
            0
        } else {
            (rays as f32 * self.config.surface_share) as usize
        };
        let targets = draw(
            &self.photos,
            &self.surfaces,
            (rays - known, known),
            &mut self.rng,
        );
        let seed = self.rng.random();
        let mut samples = self.field.sample(&targets.rays, &self.grids, Some(seed));
        measure_from_surfaces(&mut samples, &targets);
        let fade = self.config.final_rate.powf(progress);
        let loss = self.descend(&samples, &targets, fade, progress);
        self.step += 1;
        StepReport { loss, rays }
    }

    fn descend(&mut self, samples: &Samples, targets: &Targets, fade: f32, progress: f32) -> f64 {
        let (weights, app) = self.leaves(AdamParam::tracked);
        let rays = targets.rays.len() as f32;
        let known = targets.distances.iter().flatten().count().max(1) as f32;
        let wanted = Wanted {
            colours: targets.colours.clone(),
            // Too early, the distortion measure freezes whatever haze there is.
            distortion: self.config.distortion * (progress * 10.0).min(1.0),
            depth: self.config.surface * (1.0 - progress).powi(2) * rays / known,
        };
        let loss = self.field.loss(&weights, &app, samples, wanted);
        let numbers = host(loss.clone().inner());
        let (&[_, error], densities) = numbers.split_at(2) else {
            unreachable!("two numbers come before the densities");
        };
        self.grids.observe(samples, densities);
        let mut gradients = loss.slice_dim(0, 0..1).backward();
        let mut taken = |leaf: &Tensor<1>| leaf.grad_remove(&mut gradients);
        let fields = [&weights.inner, &weights.outer];
        let fields = fields.map(|w| [&w.encoding, &w.base, &w.geo].map(&mut taken));
        let apps = [&app.inner, &app.outer].map(&mut taken);
        let latent = weights.inner.latent.as_ref().and_then(&mut taken);
        // Adam works in place only on what nobody else holds.
        drop((weights, app));
        let (grids, networks) = (
            self.config.grid_rate * fade,
            self.config.network_rate * fade,
        );
        for (params, grads) in self.params.branches.iter_mut().zip(fields) {
            for (i, (param, grad)) in params.iter_mut().zip(grads).enumerate() {
                descend_one(param, grad, if i == 0 { grids } else { networks }, i == 0);
            }
        }
        for (param, grad) in self.params.app.iter_mut().zip(apps) {
            descend_one(param, grad, networks, false);
        }
        if let Some(param) = &mut self.params.latent {
            descend_one(param, latent, networks, false);
        }
        f64::from(error)
    }
}

/// Replaces the samples' depths by their distance from the surface that is known on their ray, or
/// by zero: the composite's expected depth becomes the expected distance from that surface.
fn measure_from_surfaces(samples: &mut Samples, targets: &Targets) {
    let layout = Arc::make_mut(&mut samples.layout);
    layout.depths.fill(0.0);
    for (span, distance) in layout.rays.iter().zip(&targets.distances) {
        let Some(distance) = distance else { continue };
        let surface = contracted_distance(*distance);
        for i in span.inner.clone().chain(span.outer.clone()) {
            layout.depths[i] = (layout.distances[i] - surface).abs();
        }
    }
}

/// Whether a point, given as `(x', y', z', 1/r)`-like homogeneous coordinates, is in any view.
fn seen_by_any(cameras: &[Camera], point: [f32; 4]) -> bool {
    let p = DVec4::from(point.map(f64::from));
    // Towards infinity the direction is all that counts.
    let position: DVec3 = p.xyz() / p.w.max(1e-4);
    cameras.iter().any(|camera| {
        camera.project(position).is_some_and(|(pixel, _)| {
            let k = &camera.intrinsics;
            // A margin of a tenth of the image: cells are larger than their centres.
            let margin = 0.1 * f64::from(k.width.max(k.height));
            pixel.x > -margin
                && pixel.y > -margin
                && pixel.x < f64::from(k.width) + margin
                && pixel.y < f64::from(k.height) + margin
        })
    })
}

/// Sparse points as pixels of the training photos with known distance. Points that fewer than
/// three photos agree on, or that reproject badly, are not trusted.
fn known_surfaces(scene: &Scene) -> Vec<KnownSurface> {
    let mut index = vec![None; scene.photos.len()];
    for (position, (i, _)) in scene.train().enumerate() {
        index[i] = Some(position);
    }
    let mut surfaces = Vec::new();
    for point in scene.points.iter().filter(|p| p.error < 2.0) {
        // Held-out photos must not vouch for a point either.
        let witnesses = point.seen_by.iter().filter(|s| index[s.photo].is_some());
        if witnesses.count() < 3 {
            continue;
        }
        for seen in &point.seen_by {
            let Some(photo) = index[seen.photo] else {
                continue;
            };
            let camera = &scene.photos[seen.photo].camera;
            let k = &camera.intrinsics;
            let (x, y) = (seen.pixel.x.floor(), seen.pixel.y.floor());
            if x >= 0.0 && y >= 0.0 && x < f64::from(k.width) && y < f64::from(k.height) {
                surfaces.push(KnownSurface {
                    photo,
                    pixel: y as usize * k.width as usize + x as usize,
                    distance: point.position.distance(camera.centre()) as f32,
                });
            }
        }
    }
    surfaces
}
