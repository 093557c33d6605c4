//! Photos → field (PAPER §4).

use crate::geometry::photos::{KnownSurface, PhotoRays, TargetRays, draw, photo_rays};
use crate::geometry::surfaces::{known_surfaces, measure_from_surfaces, seen_by_any};
use crate::optimizer::{Adam, Rate, add_gradients};
#[cfg(feature = "gpu")]
use crate::readback::ReadbackSchedule;
use burn::tensor::{Device, Tensor};
use impasto_field::training::RayTargets;
use impasto_field::{
    Appearance, Field, FieldWeights, OccupancyGrids, RadianceField, Samples, VisibleCells, host,
};
use impasto_kernels::{DensityGrid, OccupancySpec};
use impasto_model::config::GeometryConfig;
use impasto_model::tensors::{Entry, TensorReader};
use impasto_model::{Clock, ModelFile, TrainConfig};
use impasto_scene::{Camera, Photo, Scene};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Share of a grid's cells queried, at each update: of all, and of those that hold something.
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
    levels: Vec<Adam<RadianceField>>,
    /// Where samples go by density grids.
    occupancy: Option<Occupancy>,
    #[cfg(feature = "gpu")]
    gpu: Option<OnGpu>,
    rng: Pcg64,
    step: u64,
}

struct Occupancy {
    /// While a GPU trains on its own, what there was before.
    grids: OccupancyGrids,
    visible: VisibleCells,
}

impl Occupancy {
    fn new(spec: &OccupancySpec, cameras: &[Camera]) -> Self {
        let visible = VisibleCells::new(spec, |point| seen_by_any(cameras, point));
        Self {
            grids: OccupancyGrids::uniform(spec, FIRST_DENSITY).only(&visible),
            visible,
        }
    }
}

/// What the geometry stage leaves.
#[derive(Debug, Clone)]
pub struct TrainedGeometry {
    /// The field, with the colours of the photos.
    pub radiance: RadianceField,
    /// Density grids, where samples go by those.
    pub grids: Option<OccupancyGrids>,
}

/// How many times as many rays a step a GPU gets: fewer do not keep it busy. A guess.
#[cfg(feature = "gpu")]
const GPU_RAYS: usize = 8;

/// A field that never leaves the GPU.
#[cfg(feature = "gpu")]
struct OnGpu {
    training: impasto_field::gpu_training::GpuTraining,
    readback: ReadbackSchedule,
    /// As last read back.
    loss: f64,
}

#[cfg(feature = "gpu")]
impl OnGpu {
    /// `None` where the host has a part in every step.
    fn new(stage: &GeometryStage, device: &Device) -> Option<Self> {
        use impasto_field::gpu_training::GpuTraining;
        // More rays than may be evaluated together are a matter for the host.
        if stage.rays_of(stage.config.samples * GPU_RAYS) > stage.config.rays_at_once {
            return None;
        }
        let Occupancy { grids, visible } = stage.occupancy.as_ref()?;
        let app = stage.levels[0].values().app.config;
        let training = GpuTraining::new(&stage.field, &app, grids, visible, device)?;
        Some(Self {
            training,
            readback: ReadbackSchedule::new(),
            loss: f64::NAN,
        })
    }
}

/// What a checkpoint keeps of the stage beside its tensors.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct GeometryProgress {
    rng: Pcg64,
    step: u64,
    /// Adam's steps of each parameter, level by level.
    adam: Vec<Vec<u32>>,
}

/// What one step did.
#[derive(Debug, Clone, Copy)]
pub struct StepReport {
    /// Mean squared error of the colours; on a GPU that of a step shortly before.
    pub loss: f64,
    /// Rays used.
    pub rays: usize,
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
        let mut radiance = file.radiance.clone();
        let coarse = radiance.weights.coarse.take();
        let fine = stage.levels.len() - 1;
        stage.levels[fine] = Adam::new(&radiance);
        if let Some(coarse) = coarse {
            // A model does not keep what colours its first field had in training.
            let app = stage.levels[0].values().app;
            stage.levels[0] = Adam::new(&RadianceField::new(*coarse, app));
        }
        if let (Some(occupancy), Some(grids)) = (&mut stage.occupancy, &file.grids) {
            occupancy.grids = grids.clone();
        }
        stage.open_gpu(device);
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
        let mut level = |weights: FieldWeights| {
            let app = config.photo_appearance();
            let app = Appearance::init(app, field.features(), &mut rng, device);
            Adam::new(&RadianceField::new(weights, app))
        };
        let coarse = weights.coarse.take().map(|coarse| level(*coarse));
        let levels = coarse.into_iter().chain([level(weights)]).collect();
        let cameras: Vec<Camera> = photos.iter().map(|photo| photo.camera).collect();
        let spec = config.field.occupancy();
        let mut stage = Self {
            levels,
            occupancy: spec.map(|spec| Occupancy::new(spec, &cameras)),
            #[cfg(feature = "gpu")]
            gpu: None,
            config: config.geometry.clone(),
            photos: photo_rays(photos.iter().copied()),
            surfaces: Vec::new(),
            field,
            rng,
            step: 0,
        };
        stage.open_gpu(device);
        stage
    }

    /// Lets a GPU train on its own, where there is one that can.
    #[cfg_attr(
        not(feature = "gpu"),
        allow(clippy::unused_self, reason = "there is no GPU")
    )]
    fn open_gpu(&mut self, _device: &Device) {
        #[cfg(feature = "gpu")]
        {
            self.gpu = OnGpu::new(self, _device);
        }
    }

    /// The field's sizes.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Current weights, grids and photo appearance.
    pub fn snapshot(&self) -> TrainedGeometry {
        let mut levels = self.levels.iter().rev().map(Adam::values);
        let Some(mut radiance) = levels.next() else {
            unreachable!("there is always a field to train");
        };
        radiance.weights.coarse = levels.next().map(|coarse| Box::new(coarse.weights));
        TrainedGeometry {
            radiance,
            grids: self.current_grids(),
        }
    }

    /// All that [`Self::restore`] needs to go on as if nothing had been.
    pub(crate) fn progress(&self) -> (GeometryProgress, Vec<Entry>) {
        let (mut adam, mut entries) = (Vec::new(), Vec::new());
        for (level, params) in self.levels.iter().enumerate() {
            let (steps, own) = params.entries(&format!("{level}."));
            adam.push(steps);
            entries.extend(own);
        }
        if let Some(grids) = self.current_grids() {
            entries.extend(grid_entries("inner", grids.inner()));
            entries.extend(grid_entries("outer", grids.outer()));
        }
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
        from: &TensorReader<'_>,
    ) -> Result<(), String> {
        for (level, params) in self.levels.iter_mut().enumerate() {
            let steps = progress.adam.get(level).map_or(&[][..], Vec::as_slice);
            params.restore(&format!("{level}."), steps, from)?;
        }
        if let Some(Occupancy { grids, .. }) = &mut self.occupancy {
            let inner = restored_grid("inner", grids.inner(), from)?;
            let outer = restored_grid("outer", grids.outer(), from)?;
            *grids = OccupancyGrids::new(inner, outer);
        }
        self.rng = progress.rng.clone();
        self.step = progress.step;
        self.open_gpu(from.device);
        Ok(())
    }

    fn current_grids(&self) -> Option<OccupancyGrids> {
        #[cfg(feature = "gpu")]
        if let Some(grids) = self.gpu.as_ref().and_then(|gpu| gpu.training.grids()) {
            return Some(grids);
        }
        self.occupancy
            .as_ref()
            .map(|occupancy| occupancy.grids.clone())
    }

    /// One optimiser step.
    pub fn step(&mut self, clock: &Clock) -> StepReport {
        let progress = clock.progress() as f32;
        #[cfg(feature = "gpu")]
        if let Some(mut gpu) = self.gpu.take() {
            let report = self.gpu_step(&mut gpu, progress);
            self.gpu = Some(gpu);
            return report;
        }
        let due = self.step.is_multiple_of(self.config.grid_every);
        if let (Some(occupancy), true) = (&mut self.occupancy, due) {
            let weights = self.levels[0].values().weights;
            let Occupancy { grids, visible } = occupancy;
            grids.update(&self.field, &weights, visible, GRID_SHARES, &mut self.rng);
        }
        let targets = self.drawn(self.config.samples);
        let rays = targets.rays.len();
        let seed = self.rng.random();
        let grids = self.occupancy.as_ref().map(|occupancy| &occupancy.grids);
        let mut samples = self.field.sample(&targets.rays, grids, Some(seed));
        let mut loss = 0.0;
        for level in 0..self.levels.len() {
            let last = level + 1 == self.levels.len();
            let depths = (!last).then(|| Arc::clone(&samples.layout));
            measure_from_surfaces(&mut samples, &targets);
            let found = self.descend(level, &samples, &targets, progress);
            loss = found.error;
            let densities = found.densities.concat();
            if let Some(Occupancy { grids, .. }) = &mut self.occupancy {
                grids.observe(&samples, &densities);
            }
            if let Some(depths) = depths {
                samples.layout = depths;
                let rays = &targets.rays;
                samples = self.field.resample(rays, samples, &densities, Some(seed));
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
    fn drawn(&mut self, samples: usize) -> TargetRays {
        let rays = self.rays_of(samples);
        let known = if self.surfaces.is_empty() {
            0
        } else {
            (rays as f32 * self.config.surface_share) as usize
        };
        draw(
            &self.photos,
            rays - known,
            &self.surfaces,
            known,
            &mut self.rng,
        )
    }

    /// [`Self::step`] of which nothing comes back from the device, but now and then the loss.
    #[cfg(feature = "gpu")]
    fn gpu_step(&mut self, gpu: &mut OnGpu, progress: f32) -> StepReport {
        use impasto_field::Parameters;
        if self.step.is_multiple_of(self.config.grid_every) {
            let weights = self.levels[0].values().weights;
            let seed = self.rng.random();
            gpu.training.update_grids(&weights, GRID_SHARES, seed);
        }
        let targets = self.drawn(self.config.samples * GPU_RAYS);
        let rays = targets.rays.len();
        let wanted = self.wanted(&targets, 0..rays, progress);
        let seed = self.rng.random();
        let level = self.levels[0].values();
        let distances = &targets.distances;
        let descent = gpu
            .training
            .descend(&level, &targets.rays, distances, wanted, seed);
        // Adam works in place only on what nobody else holds.
        drop(level);
        let gradients = descent.gradients.named().into_iter();
        self.descend_along(0, gradients.map(|(_, gradient)| Some(gradient)), progress);
        if gpu.readback.due()
            && let [_, error] = host(descent.loss)[..]
        {
            gpu.loss = f64::from(error);
            gpu.readback.done();
        }
        self.step += 1;
        StepReport {
            loss: gpu.loss,
            rays,
        }
    }

    /// Adam's step of one level.
    fn descend(
        &mut self,
        level: usize,
        samples: &Samples,
        targets: &TargetRays,
        progress: f32,
    ) -> Found {
        let leaves = self.levels[level].leaves();
        let mut gradients: Vec<Option<Tensor<1>>> = Vec::new();
        let mut found = Found::default();
        let all = targets.rays.len();
        for start in (0..all).step_by(self.config.rays_at_once) {
            let rays = start..(start + self.config.rays_at_once).min(all);
            let share = rays.len() as f32 / all as f32;
            let part = if rays.len() == all {
                Cow::Borrowed(samples)
            } else {
                Cow::Owned(samples.of_rays(rays.clone()))
            };
            let wanted = self.wanted(targets, rays, progress);
            let loss = self.field.loss(&leaves, &part, wanted);
            found.add(&host(loss.clone().inner()), part.inner.len(), share);
            let loss = loss.slice_dim(0, 0..1);
            let loss = if share < 1.0 { loss * share } else { loss };
            add_gradients(&mut gradients, &leaves, loss.backward());
        }
        // Adam works in place only on what nobody else holds.
        drop(leaves);
        self.descend_along(level, gradients, progress);
        found
    }

    /// Adam's step of one level along gradients in the order of its parameters.
    fn descend_along(
        &mut self,
        level: usize,
        gradients: impl IntoIterator<Item = Option<Tensor<1>>>,
        progress: f32,
    ) {
        let config = &self.config;
        let fade = config.final_rate.powf(progress);
        self.levels[level].step(gradients, |name| {
            let sparse = name.ends_with(".encoding");
            let rate = if sparse {
                config.grid_rate
            } else {
                config.network_rate
            };
            Rate {
                rate: rate * fade,
                sparse,
            }
        });
    }

    /// What some of a step's rays should look like.
    fn wanted(&self, targets: &TargetRays, rays: Range<usize>, progress: f32) -> RayTargets {
        let all = targets.rays.len() as f32;
        let known = targets.distances.iter().flatten().count().max(1) as f32;
        RayTargets {
            colours: targets.colours[rays.start * 3..rays.end * 3].to_vec(),
            // Too early, the distortion measure freezes whatever haze there is.
            distortion: self.config.distortion * (progress * 10.0).min(1.0),
            depth: self.config.surface * (1.0 - progress).powi(2) * all / known,
        }
    }
}

/// What a level's step found.
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

/// A grid with what was observed of it.
fn grid_entries(name: &str, grid: &DensityGrid) -> Vec<Entry> {
    let observed = grid.observed();
    let levels = Entry::levels(format!("{name}.grid"), grid);
    let observed =
        (!observed.is_empty()).then(|| Entry::floats(format!("{name}.observed"), observed));
    [levels].into_iter().chain(observed).collect()
}

/// What [`grid_entries`] has kept of a grid like this one.
fn restored_grid(
    name: &str,
    like: &DensityGrid,
    from: &TensorReader<'_>,
) -> Result<DensityGrid, String> {
    let grid = from.grid(&format!("{name}.grid"))?;
    if grid.cells() != like.cells() {
        return Err(format!("holds a grid \"{name}\" of another size"));
    }
    let observed = format!("{name}.observed");
    if !from.has(&observed) {
        return Ok(grid);
    }
    let numbers = from.numbers(&observed, like.cells())?;
    grid.with_observed(numbers)
        .ok_or_else(|| format!("holds \"{observed}\", which are no opacities"))
}
