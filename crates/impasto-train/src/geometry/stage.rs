//! Photos → field (PAPER §4).

use crate::geometry::calibration::Calibration;
use crate::geometry::photos::{KnownSurface, PhotoRays, draw, photo_rays};
use crate::geometry::surfaces::{known_surfaces, seen_by_any};
use crate::optimizer::{Adam, Rate};
use crate::readback::ReadbackSchedule;
use burn::tensor::{Device, Tensor};
use impasto_field::training::{BatchSize, FieldTraining, LossWeights, TargetRays};
use impasto_field::{
    Appearance, DistilledFeatures, Field, FieldWeights, OccupancyGrids, RadianceField, RayBatch,
    Renderer, host,
};
use impasto_kernels::{DensityGrid, Sparse};
use impasto_model::config::GeometryConfig;
use impasto_model::tensors::{Entry, TensorReader};
use impasto_model::{Clock, ModelFile, TrainConfig};
use impasto_scene::inspect::surface_distance;
use impasto_scene::{Camera, Photo, Scene};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Rates of a stage that goes on with other pictures end at this part of their start, at least.
const REFIT_FINAL_RATE: f32 = 0.1;

/// A field in training.
pub struct GeometryStage {
    training: FieldTraining,
    config: GeometryConfig,
    photos: Vec<PhotoRays>,
    calibration: Option<Calibration>,
    surfaces: Vec<KnownSurface>,
    /// Distance from a camera, scene units, from which on its rays teach all that they see.
    learned_from: f32,
    /// The field, after the first field of a cascade.
    levels: Vec<Adam<RadianceField>>,
    readback: ReadbackSchedule,
    /// Mean squared error of colours, as last read back.
    error: f64,
    rng: Pcg64,
    step: u64,
}

/// What the geometry stage leaves.
#[derive(Debug, Clone)]
pub struct TrainedGeometry {
    /// The field, with the colours of the photos.
    pub radiance: RadianceField,
    /// Density grids, where samples go by those.
    pub grids: Option<OccupancyGrids>,
    /// What is around places, once that was distilled.
    pub features: Option<DistilledFeatures>,
}

/// What a checkpoint keeps of the stage beside its tensors.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct GeometryProgress {
    rng: Pcg64,
    step: u64,
    /// Adam's steps of each parameter, level by level.
    adam: Vec<Vec<u32>>,
    calibration: Option<Calibration>,
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
        stage.learned_from = config.geometry.learned_from * surface_distance(scene) as f32;
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
        if let Some(grids) = &file.grids {
            stage.training.set_grids(grids.clone(), device);
        }
        // The pictures are new, but their cameras are known and their colours meant; and what the
        // model has learned keeps specks away.
        stage.calibration = None;
        stage.config.grid_decay = 0.0;
        // All colours may have to change, in what is often a short time.
        stage.config.final_rate = stage.config.final_rate.max(REFIT_FINAL_RATE);
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
        let sees = |point| seen_by_any(&cameras, point);
        let geometry = &config.geometry;
        let batch = BatchSize {
            samples: geometry.samples,
            rays: geometry.rays,
            rays_at_once: geometry.rays_at_once,
        };
        let app = config.photo_appearance();
        Self {
            levels,
            training: FieldTraining::new(field, &app, sees, batch, device),
            config: geometry.clone(),
            calibration: geometry
                .calibration
                .map(|c| Calibration::new(c, photos.len())),
            photos: photo_rays(photos.iter().copied()),
            surfaces: Vec::new(),
            learned_from: 0.0,
            readback: ReadbackSchedule::new(),
            error: f64::NAN,
            rng,
            step: 0,
        }
    }

    /// The field's sizes.
    pub fn field(&self) -> &Field {
        self.training.field()
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
            grids: self.training.grids(),
            features: None,
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
        if let Some(grids) = self.training.grids() {
            entries.extend(grid_entries("inner", grids.inner()));
            entries.extend(grid_entries("outer", grids.outer()));
        }
        let progress = GeometryProgress {
            rng: self.rng.clone(),
            step: self.step,
            adam,
            calibration: self.calibration.clone(),
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
        if let Some(grids) = self.training.grids() {
            let inner = restored_grid("inner", grids.inner(), from)?;
            let outer = restored_grid("outer", grids.outer(), from)?;
            let grids = OccupancyGrids::new(inner, outer);
            self.training.set_grids(grids, from.device);
        }
        if let Some(calibration) = &progress.calibration {
            calibration.apply(&mut self.photos);
        }
        self.calibration.clone_from(&progress.calibration);
        self.rng = progress.rng.clone();
        self.step = progress.step;
        Ok(())
    }

    /// One optimiser step.
    pub fn step(&mut self, clock: &Clock) -> StepReport {
        let progress = clock.progress() as f32;
        if self.step.is_multiple_of(self.config.grid_every) {
            let weights = self.levels[0].values().weights;
            self.training.update_grids(&weights, &mut self.rng);
        }
        self.calibrate(progress);
        let targets = self.drawn();
        let rays = targets.rays.len();
        let weights = self.loss_weights(&targets, progress);
        let seed = self.rng.random();
        let levels: Vec<RadianceField> = self.levels.iter().map(Adam::values).collect();
        let found = self.training.descend(&levels, &targets, weights, seed);
        // Adam works in place only on what nobody else holds.
        drop(levels);
        self.adam(found.gradients, progress);
        if self.training.on_host() || self.readback.due() {
            self.error = host(found.error).first().map_or(f64::NAN, |e| (*e).into());
            self.readback.done();
        }
        self.step += 1;
        StepReport {
            loss: self.error,
            rays,
        }
    }

    /// Compares a photo with the field, where one is due.
    fn calibrate(&mut self, progress: f32) {
        let (Some(mut calibration), Some(level)) = (
            self.calibration
                .take_if(|c| c.takes_turn(self.step, progress)),
            self.levels.last(),
        ) else {
            return;
        };
        let RadianceField { weights, app } = level.values();
        let field = self.training.field().clone();
        let renderer = Renderer::open(
            field,
            weights,
            self.training.grids(),
            app.clone(),
            &app.config,
        );
        let render = |rays: &RayBatch| renderer.render(rays, &[&app]);
        calibration.visit(&mut self.photos, &render, progress, &mut self.rng);
        self.calibration = Some(calibration);
    }

    /// The training cameras that have moved, by number of their photo.
    pub fn cameras(&self) -> impl Iterator<Item = (usize, Camera)> {
        self.calibration.iter().flat_map(Calibration::cameras)
    }

    /// A step's rays, some of them to known surfaces.
    fn drawn(&mut self) -> TargetRays {
        let rays = self.training.rays_of_step();
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

    /// Adam's step of all levels.
    fn adam(&mut self, gradients: Vec<Vec<Option<Tensor<1>>>>, progress: f32) {
        let config = &self.config;
        let fade = config.final_rate.powf(progress);
        let decay = config.grid_decay / self.photos.len().max(1) as f32 * fading(progress);
        for (level, gradients) in self.levels.iter_mut().zip(gradients) {
            level.step(gradients, |name| {
                let table = name.ends_with(".encoding");
                let rate = if table {
                    config.grid_rate
                } else {
                    config.network_rate
                };
                Rate {
                    rate: rate * fade,
                    sparse: table.then_some(Sparse { decay }),
                }
            });
        }
    }

    fn loss_weights(&self, targets: &TargetRays, progress: f32) -> LossWeights {
        let all = targets.rays.len() as f32;
        let known = targets.distances.iter().flatten().count().max(1) as f32;
        LossWeights {
            // Too early, the distortion measure freezes whatever haze there is.
            distortion: self.config.distortion * (progress * 10.0).min(1.0),
            learned_from: self.learned_from,
            // Of the rays that have a surface, not of all.
            surface: self.config.surface * fading(progress) * all / known,
        }
    }
}

/// What helps at the start and is in the way of detail at the end.
fn fading(progress: f32) -> f32 {
    (1.0 - progress).powi(2)
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
