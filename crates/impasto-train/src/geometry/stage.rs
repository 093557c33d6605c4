//! Photos → field (PAPER §4).

use crate::budget::Clock;
#[cfg(feature = "gpu")]
use crate::budget::Looks;
use crate::checkpoint::{adam_entries, grid_entries, restore_adam, restored_grid};
use crate::config::{GeometryConfig, TrainConfig};
use crate::model_file::{Entry, ModelFile, Reader};
use crate::painted::add_gradients;
use crate::rays::{KnownSurface, PhotoRays, Targets, draw};
use burn::tensor::{Device, Tensor};
use glam::{DVec3, DVec4, Vec4Swizzles};
use impasto_field::{
    Appearance, AppearanceConfig, BranchWeights, Field, FieldWeights, Grids, Samples, Visible,
    contracted_distance, loss::Wanted, render::host,
};
#[cfg(feature = "gpu")]
use impasto_kernels::Volume;
use impasto_kernels::ops::AdamParam;
use impasto_scene::{Camera, Photo, Scene};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;
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
    /// The field, after the first field of a cascade.
    levels: Vec<Params>,
    /// While a GPU trains on its own, what there was before.
    grids: Grids,
    #[cfg(feature = "gpu")]
    resident: Option<Resident>,
    visible: Visible,
    rng: Pcg64,
    step: u64,
}

/// How many times as many rays a step a GPU gets: fewer do not keep it busy. A guess.
#[cfg(feature = "gpu")]
const GPU_RAYS: usize = 8;

/// A field that never leaves the GPU.
#[cfg(feature = "gpu")]
struct Resident {
    training: impasto_field::resident::ResidentTraining,
    looks: Looks,
    /// As of the last look.
    loss: f64,
}

#[cfg(feature = "gpu")]
impl Resident {
    /// `None` where the host has a part in every step.
    fn new(stage: &GeometryStage, device: &Device) -> Option<Self> {
        use impasto_field::resident::ResidentTraining;
        // More rays than may be looked at together are a matter for the host.
        if stage.rays_of(stage.config.samples * GPU_RAYS) > stage.config.rays_at_once {
            return None;
        }
        let app = &stage.levels[0].app_config;
        let grids = (&stage.grids, &stage.visible);
        let training = ResidentTraining::new(&stage.field, app, grids, device)?;
        Some(Self {
            training,
            looks: Looks::new(),
            loss: f64::NAN,
        })
    }
}

/// What a checkpoint keeps of the stage beside its tensors.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct GeometryProgress {
    rng: Pcg64,
    step: u64,
    /// Of each parameter.
    adam: Vec<u32>,
}

/// What one step did.
#[derive(Debug, Clone, Copy)]
pub struct StepReport {
    /// Mean squared error of the colours; on a GPU that of a step shortly before.
    pub loss: f64,
    /// Rays used.
    pub rays: usize,
}

/// Adam's view of everything the stage learns: encoding, base, geo of both volumes, app, and the
/// vector that they share.
struct Params {
    branches: [[AdamParam; 3]; 2],
    app: [AdamParam; 2],
    app_config: AppearanceConfig,
    latent: Option<AdamParam>,
}

impl Params {
    fn new(weights: FieldWeights, app: &Appearance) -> Self {
        let branch = |w: BranchWeights| [w.encoding, w.base, w.geo].map(AdamParam::new);
        Self {
            latent: weights.inner.latent.clone().map(AdamParam::new),
            branches: [branch(weights.inner), branch(weights.outer)],
            app: [&app.inner, &app.outer].map(|w| AdamParam::new(w.clone())),
            app_config: app.config.clone(),
        }
    }

    fn leaves(&self, leaf: impl Fn(&AdamParam) -> Tensor<1>) -> (FieldWeights, Appearance) {
        let weights = self.weights(&leaf);
        let app = Appearance {
            config: self.app_config.clone(),
            inner: leaf(&self.app[0]),
            outer: leaf(&self.app[1]),
            canvas: None,
            latent: self.app_config.latent.and(weights.inner.latent.clone()),
        };
        (weights, app)
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
            coarse: None,
        }
    }

    /// Every parameter, in the order of [`Self::all_mut`].
    fn all(&self) -> impl Iterator<Item = &AdamParam> {
        let branches = self.branches.iter().flatten();
        branches.chain(&self.app).chain(&self.latent)
    }

    /// Every parameter, and whether it is an encoding's table.
    fn all_mut(&mut self) -> impl Iterator<Item = (&mut AdamParam, bool)> {
        let branches = self.branches.iter_mut();
        let branches = branches.flat_map(|params| params.iter_mut().zip([true, false, false]));
        let rest = self.app.iter_mut().chain(&mut self.latent);
        branches.chain(rest.map(|param| (param, false)))
    }
}

/// Leaves in the order of [`Params::all_mut`].
fn in_order<'a>(weights: &'a FieldWeights, app: &'a Appearance) -> Vec<&'a Tensor<1>> {
    let branches = [&weights.inner, &weights.outer].into_iter();
    branches
        .flat_map(|w| [&w.encoding, &w.base, &w.geo])
        .chain([&app.inner, &app.outer])
        .chain(&weights.inner.latent)
        .collect()
}

impl GeometryStage {
    /// Prepares a scene's training photos.
    pub fn new(scene: &Scene, config: &TrainConfig, seed: u64, device: &Device) -> Self {
        let photos: Vec<&Photo> = scene.train().map(|(_, photo)| photo).collect();
        let mut stage = Self::of_photos(&photos, config, seed, device);
        stage.surfaces = known_surfaces(scene);
        stage
    }

    /// Continues from what a model has learned, on these photos of its place.
    pub(crate) fn continued(file: &ModelFile, photos: &[&Photo], device: &Device) -> Self {
        let mut stage = Self::of_photos(photos, &file.config, file.seed, device);
        let mut weights = file.weights.clone();
        let coarse = weights.coarse.take();
        let fine = stage.levels.len() - 1;
        stage.levels[fine] = Params::new(weights, &file.photo_app);
        if let (Some(coarse), [first, _]) = (coarse, &mut stage.levels[..]) {
            // A model does not keep what colours its first field had in training.
            let (_, app) = first.leaves(AdamParam::value);
            *first = Params::new(*coarse, &app);
        }
        stage.grids = file.grids.clone();
        #[cfg(feature = "gpu")]
        {
            stage.resident = Resident::new(&stage, device);
        }
        stage
    }

    /// Prepares photos of which no surfaces are known.
    pub(crate) fn of_photos(
        photos: &[&Photo],
        config: &TrainConfig,
        seed: u64,
        device: &Device,
    ) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let field = Field::new(config.field.clone());
        let mut weights = field.init(&mut rng, device);
        let mut params = |weights: FieldWeights| {
            let app = config.photo_app.clone();
            let app = Appearance::init(app, field.features(), &mut rng, device);
            Params::new(weights, &app)
        };
        let coarse = weights.coarse.take().map(|coarse| params(*coarse));
        let levels = coarse.into_iter().chain([params(weights)]).collect();
        let cameras: Vec<Camera> = photos.iter().map(|photo| photo.camera).collect();
        let visible = field.visible(|point| seen_by_any(&cameras, point));
        let stage = Self {
            levels,
            grids: field.grids(FIRST_DENSITY, Some(&visible)),
            #[cfg(feature = "gpu")]
            resident: None,
            visible,
            config: config.geometry.clone(),
            photos: crate::rays::photo_rays(photos.iter().copied()),
            surfaces: Vec::new(),
            field,
            rng,
            step: 0,
        };
        #[cfg(feature = "gpu")]
        let stage = Self {
            resident: Resident::new(&stage, device),
            ..stage
        };
        stage
    }

    /// The field's sizes.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Current weights, grids and photo appearance.
    pub fn snapshot(&self) -> (FieldWeights, Grids, Appearance) {
        let mut levels = self.levels.iter().rev();
        let fine = levels.next().map(|level| level.leaves(AdamParam::value));
        let Some((mut weights, app)) = fine else {
            unreachable!("there is always a field to train");
        };
        let coarse = levels.next().map(|level| level.weights(AdamParam::value));
        weights.coarse = coarse.map(Box::new);
        (weights, self.current_grids(), app)
    }

    /// All that [`Self::restore`] needs to go on as if nothing had been.
    pub(crate) fn progress(&self) -> (GeometryProgress, Vec<Entry>) {
        let (adam, mut entries) = adam_entries(self.levels.iter().flat_map(Params::all));
        let grids = self.current_grids();
        entries.extend(grid_entries("inner", grids.inner()));
        entries.extend(grid_entries("outer", grids.outer()));
        let progress = GeometryProgress {
            rng: self.rng.clone(),
            step: self.step,
            adam,
        };
        (progress, entries)
    }

    /// Goes on where a stage of the same scene and settings was.
    pub(crate) fn restore(
        &mut self,
        progress: &GeometryProgress,
        from: &Reader<'_>,
    ) -> Result<(), String> {
        let params = self.levels.iter_mut().flat_map(Params::all_mut);
        restore_adam(params.map(|(param, _)| param), &progress.adam, from)?;
        let inner = restored_grid("inner", self.grids.inner(), from)?;
        let outer = restored_grid("outer", self.grids.outer(), from)?;
        self.grids = Grids::new(inner, outer);
        self.rng = progress.rng.clone();
        self.step = progress.step;
        #[cfg(feature = "gpu")]
        {
            self.resident = Resident::new(self, from.device);
        }
        Ok(())
    }

    fn current_grids(&self) -> Grids {
        #[cfg(feature = "gpu")]
        if let Some(grids) = self.resident.as_ref().and_then(|r| r.training.grids()) {
            return grids;
        }
        self.grids.clone()
    }

    /// One optimiser step.
    pub fn step(&mut self, clock: &Clock) -> StepReport {
        let progress = clock.progress() as f32;
        #[cfg(feature = "gpu")]
        if let Some(mut resident) = self.resident.take() {
            let report = self.resident_step(&mut resident, progress);
            self.resident = Some(resident);
            return report;
        }
        if self.guided() && self.step.is_multiple_of(self.config.grid_every) {
            let weights = self.levels[0].weights(AdamParam::value);
            self.field.update_grids(
                &mut self.grids,
                &weights,
                &self.visible,
                GRID_SHARES,
                &mut self.rng,
            );
        }
        let targets = self.drawn(self.config.samples);
        let rays = targets.rays.len();
        let seed = self.rng.random();
        let mut samples = self.field.sample(&targets.rays, &self.grids, Some(seed));
        let mut loss = 0.0;
        for level in 0..self.levels.len() {
            let last = level + 1 == self.levels.len();
            let depths = (!last).then(|| Arc::clone(&samples.layout));
            measure_from_surfaces(&mut samples, &targets);
            let found = self.descend(level, &samples, &targets, progress);
            loss = found.error;
            let densities = found.densities.concat();
            if self.guided() {
                self.grids.observe(&samples, &densities);
            }
            if let Some(depths) = depths {
                samples.layout = depths;
                let rays = &targets.rays;
                samples = self.field.refine(rays, samples, &densities, Some(seed));
            }
        }
        self.step += 1;
        StepReport { loss, rays }
    }

    /// Rays that have about so many samples.
    fn rays_of(&self, samples: usize) -> usize {
        let [fewest, most] = self.config.rays;
        let per_ray = self.field.config.samples().max(1);
        (samples / per_ray).clamp(fewest, most)
    }

    /// Rays for about so many samples, some of them to known surfaces.
    fn drawn(&mut self, samples: usize) -> Targets {
        let rays = self.rays_of(samples);
        let known = if self.surfaces.is_empty() {
            0
        } else {
            (rays as f32 * self.config.surface_share) as usize
        };
        let counts = (rays - known, known);
        draw(&self.photos, &self.surfaces, counts, &mut self.rng)
    }

    /// [`Self::step`] of which nothing comes back from the device, but now and then the loss.
    #[cfg(feature = "gpu")]
    fn resident_step(&mut self, resident: &mut Resident, progress: f32) -> StepReport {
        if self.step.is_multiple_of(self.config.grid_every) {
            let weights = self.levels[0].weights(AdamParam::value);
            let seed = self.rng.random();
            resident.training.update_grids(&weights, GRID_SHARES, seed);
        }
        let targets = self.drawn(self.config.samples * GPU_RAYS);
        let rays = targets.rays.len();
        let wanted = self.wanted(&targets, 0..rays, progress);
        let (weights, app) = self.levels[0].leaves(AdamParam::value);
        let seed = self.rng.random();
        let lit = (&targets.rays, &targets.distances[..]);
        let descent = resident
            .training
            .descend((&weights, &app), lit, wanted, seed);
        // Adam works in place only on what nobody else holds.
        drop((weights, app));
        let [inner, outer] = descent.gradients.map(Volume::into_array);
        let ([table, base, geo, app], [far_table, far_base, far_geo, far_app]) = (inner, outer);
        let near = [table, base, geo].into_iter();
        let gradients = near.chain([far_table, far_base, far_geo, app, far_app]);
        self.descend_along(0, gradients.map(Some), progress);
        if resident.looks.due()
            && let [_, error] = host(descent.loss)[..]
        {
            resident.loss = f64::from(error);
            resident.looks.done();
        }
        self.step += 1;
        StepReport {
            loss: resident.loss,
            rays,
        }
    }

    /// Whether density grids say where samples are.
    fn guided(&self) -> bool {
        self.field.config.cascade.is_none()
    }

    /// Adam's step of one level.
    fn descend(
        &mut self,
        level: usize,
        samples: &Samples,
        targets: &Targets,
        progress: f32,
    ) -> Found {
        let (weights, app) = self.levels[level].leaves(AdamParam::tracked);
        let leaves = in_order(&weights, &app);
        let mut gradients: Vec<Option<Tensor<1>>> = vec![None; leaves.len()];
        let mut found = Found::default();
        let all = targets.rays.len();
        for start in (0..all).step_by(self.config.rays_at_once) {
            let rays = start..(start + self.config.rays_at_once).min(all);
            let share = rays.len() as f32 / all as f32;
            let part = match rays.len() == all {
                true => Cow::Borrowed(samples),
                false => Cow::Owned(samples.of_rays(rays.clone())),
            };
            let wanted = self.wanted(targets, rays, progress);
            let loss = self.field.loss(&weights, &app, &part, wanted);
            found.add(&host(loss.clone().inner()), part.inner.len(), share);
            let loss = loss.slice_dim(0, 0..1);
            let loss = if share < 1.0 { loss * share } else { loss };
            add_gradients(&mut gradients, &leaves, loss.backward());
        }
        // Adam works in place only on what nobody else holds.
        drop((weights, app));
        self.descend_along(level, gradients.into_iter(), progress);
        found
    }

    /// Adam's step of one level along gradients in the order of [`Params::all_mut`].
    fn descend_along(
        &mut self,
        level: usize,
        gradients: impl Iterator<Item = Option<Tensor<1>>>,
        progress: f32,
    ) {
        let fade = self.config.final_rate.powf(progress);
        for ((param, table), grad) in self.levels[level].all_mut().zip(gradients) {
            let rate = match table {
                true => self.config.grid_rate,
                false => self.config.network_rate,
            };
            // Not every loss depends on every parameter.
            if let Some(grad) = grad {
                param.step(grad, rate * fade, table);
            }
        }
    }

    /// What some of a step's rays should look like.
    fn wanted(&self, targets: &Targets, rays: Range<usize>, progress: f32) -> Wanted {
        let all = targets.rays.len() as f32;
        let known = targets.distances.iter().flatten().count().max(1) as f32;
        Wanted {
            colours: targets.colours[rays.start * 3..rays.end * 3].to_vec(),
            // Too early, the distortion measure freezes whatever haze there is.
            distortion: self.config.distortion * (progress * 10.0).min(1.0),
            depth: self.config.surface * (1.0 - progress).powi(2) * all / known,
        }
    }
}

/// What a level's step saw.
#[derive(Default)]
struct Found {
    /// Mean squared error of colours.
    error: f64,
    /// Densities of both volumes' samples.
    densities: [Vec<f32>; 2],
}

impl Found {
    /// Adds the loss of some rays, `share` of all, of which the first `inner` densities belong to
    /// the inner volume.
    fn add(&mut self, loss: &[f32], inner: usize, share: f32) {
        self.error += f64::from(loss[1] * share);
        let (near, far) = loss[2..].split_at(inner);
        self.densities[0].extend(near);
        self.densities[1].extend(far);
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
                let pixel = y as usize * k.width as usize + x as usize;
                if !scene.photos[seen.photo].is_used(pixel) {
                    continue;
                }
                surfaces.push(KnownSurface {
                    photo,
                    pixel,
                    distance: point.position.distance(camera.centre()) as f32,
                });
            }
        }
    }
    surfaces
}
