//! The stages of a run one after the other, with checkpoints in between.

use crate::TrainError;
use crate::event::{Event, Stage};
use crate::geometry::{GeometryStage, TrainedGeometry, photo_rays};
use crate::paintings::{CROPS, StyleSet, StyleSources};
use crate::progress::Progress;
use crate::run::checkpoint::{self, Checkpoint, Position, StageProgress};
use crate::run::log::Log;
use crate::run::options::TrainOptions;
use crate::run::validation;
use crate::style::{DistillationBudget, StyleNetworks, StyleStage, distil};
use impasto_model::tensors::{Entry, TensorReader};
use impasto_model::{
    Budget, Clock, Model, ModelFile, ModelPhoto, ModelScene, Quality, RunIdentity, Stages,
    Stopwatch, StyleEmbedding, StyleModel, TrainConfig, TrainingRecord,
};
use impasto_scene::file::write_atomic;
use impasto_scene::{PictureFolder, Scene, Split};
use impasto_style::{Perceptual, StyleVae};
use std::time::{Duration, Instant};

/// Pictures generated when there are no paintings at all.
const GENERATED_ALONE: usize = 400;
/// Part of a time budget kept for the checks after the last stage.
const RESERVE: f64 = 0.02;
/// At least this much of it, unless that is more than a quarter.
const LEAST_RESERVE: Duration = Duration::from_secs(2);
/// Most of the style stage's time that statistics of crops and generated pictures may take.
const PREPARATION: f64 = 0.12;
/// Most of a time budget that comparing held-out views may take.
const COMPARISON: f64 = 0.05;

/// Part of a time budget for distilling features, at most this long.
const DISTILLATION: f64 = 0.08;
const LONGEST_DISTILLATION: Duration = Duration::from_secs(15);
/// Updates that distilling features is done after.
const DISTILLATION_STEPS: u64 = 600;

/// When the two stages of a time budget end: after the last, some of it is kept for checks.
pub(crate) fn end_of_stages(total: Duration, geometry_share: f64) -> [Duration; 2] {
    let reserve = total.mul_f64(RESERVE).max(LEAST_RESERVE).min(total / 4);
    [total.mul_f64(geometry_share), total.saturating_sub(reserve)]
}

/// When a geometry stage ends that no other follows: held-out views are compared after it.
pub(crate) fn end_of_geometry_alone(total: Duration) -> Duration {
    let [_, end] = end_of_stages(total, 1.0);
    end.saturating_sub(total.mul_f64(COMPARISON))
}

/// How long distilling features takes of a time budget.
pub(crate) fn distillation_time(config: &TrainConfig, total: Duration) -> Duration {
    match config.style.shading.paint() {
        Some(_) => total.mul_f64(DISTILLATION).min(LONGEST_DISTILLATION),
        None => Duration::ZERO,
    }
}

/// A run at work.
pub(crate) struct Run<'a> {
    pub(crate) options: &'a TrainOptions,
    pub(crate) identity: RunIdentity,
    pub(crate) scene: Scene,
    pub(crate) watch: Stopwatch,
    /// When the last checkpoint was written.
    pub(crate) saved: Instant,
    pub(crate) log: Log<'a>,
    pub(crate) paintings: Option<PictureFolder>,
    pub(crate) encoder: Option<StyleVae>,
    /// The shipped painter, if it is made for this run's codes and sizes.
    pub(crate) painter: Option<StyleModel>,
    /// Whether there is a style stage.
    pub(crate) learns_style: bool,
    /// Files of the style folder that are no pictures.
    pub(crate) unreadable: usize,
    /// What is continued, until the stage that it is in has taken it over.
    pub(crate) earlier: Option<Earlier>,
}

/// A run that was interrupted.
pub(crate) struct Earlier(Checkpoint);

impl Earlier {
    pub(crate) fn new(checkpoint: Checkpoint) -> Self {
        Self(checkpoint)
    }
}

/// Where in a run a stage is.
struct Place {
    stage: Stage,
    /// Time of the run when it began.
    began: Duration,
    /// Steps of the geometry stage, where that is over.
    geometry_steps: u64,
}

/// A stage, as far as its loop goes.
trait Steps {
    /// One optimiser step: total, content and style loss, and rays used.
    fn step(&mut self, clock: &Clock) -> Result<([Option<f64>; 3], usize), TrainError>;

    /// What a checkpoint keeps.
    fn progress(&self) -> (StageProgress, Vec<Entry>);

    /// Goes on from what a checkpoint has kept.
    fn restore(&mut self, progress: &StageProgress, from: &TensorReader<'_>) -> Result<(), String>;
}

/// What a checkpoint says where another stage's memory is found than the one that it names.
fn other_stage() -> Result<(), String> {
    Err("is of another stage".into())
}

impl Steps for GeometryStage {
    fn step(&mut self, clock: &Clock) -> Result<([Option<f64>; 3], usize), TrainError> {
        let report = Self::step(self, clock);
        Ok(([Some(report.loss), None, None], report.rays))
    }

    fn progress(&self) -> (StageProgress, Vec<Entry>) {
        let (progress, entries) = Self::progress(self);
        (StageProgress::Geometry(progress), entries)
    }

    fn restore(&mut self, progress: &StageProgress, from: &TensorReader<'_>) -> Result<(), String> {
        match progress {
            StageProgress::Geometry(progress) => Self::restore(self, progress, from),
            StageProgress::Style(_) => other_stage(),
        }
    }
}

impl Steps for StyleStage {
    fn step(&mut self, clock: &Clock) -> Result<([Option<f64>; 3], usize), TrainError> {
        let report = Self::step(self, clock)?;
        let losses = [Some(report.loss), report.content, report.style];
        Ok((losses, report.rays))
    }

    fn progress(&self) -> (StageProgress, Vec<Entry>) {
        let (progress, entries) = Self::progress(self);
        (StageProgress::Style(progress), entries)
    }

    fn restore(&mut self, progress: &StageProgress, from: &TensorReader<'_>) -> Result<(), String> {
        match progress {
            StageProgress::Style(progress) => Self::restore(self, progress, from),
            StageProgress::Geometry(_) => other_stage(),
        }
    }
}

impl Run<'_> {
    /// Everything that is left to do; the model and the time that all of it took.
    pub(crate) fn all(
        &mut self,
        trained: Option<ModelFile>,
    ) -> Result<(ModelFile, Duration), TrainError> {
        let at_style = self.earlier.as_ref().map(|e| &e.0.position);
        let at_style = at_style.filter(|p| p.stage.stage() == Stage::Style);
        let (mut file, geometry_steps) = match (trained, at_style.map(|p| p.geometry_steps)) {
            (Some(file), steps) => (file, steps.unwrap_or_default()),
            (None, Some(steps)) => (self.geometry_model()?, steps),
            (None, None) => self.geometry()?,
        };
        let style_steps = match self.learns_style {
            false => 0,
            true => self.style(&mut file, geometry_steps)?,
        };
        let folder = self.paintings.as_ref();
        // Unreadable entries of the listing were never among the files.
        let found = folder.map_or(0, |f| f.files.len() + f.unreadable.len());
        file.finished = Some(TrainingRecord {
            identity: self.identity.clone(),
            budget: self.options.budget,
            geometry_steps,
            style_steps,
            paintings: found.saturating_sub(self.unreadable),
            unreadable_paintings: self.unreadable,
        });
        self.save(&file)?;
        Checkpoint::remove(&self.options.output)?;
        let seconds = self.watch.elapsed();
        self.log.event(&Event::Done {
            seconds: seconds.as_secs_f64(),
        });
        Ok((file, seconds))
    }

    /// The model that the interrupted run has left between its stages.
    fn geometry_model(&self) -> Result<ModelFile, TrainError> {
        Ok(ModelFile::load(&self.options.output, &self.options.device)?)
    }

    /// A stage begins, after as many steps of geometry.
    fn started(&mut self, stage: Stage, geometry_steps: u64) -> Place {
        let began = self.watch.elapsed();
        let (seconds, steps) = match self.stage_budget(stage, began) {
            Budget::Time(time) => (Some(time.as_secs_f64()), None),
            Budget::Steps(steps) => (None, Some(steps)),
        };
        self.log.event(&Event::StageStarted {
            stage,
            seconds,
            steps,
        });
        Place {
            stage,
            began,
            geometry_steps,
        }
    }

    /// The budget of a stage that began at some time of the run.
    fn stage_budget(&self, stage: Stage, began: Duration) -> Budget {
        let share = self.options.config.geometry_share;
        let only = self.options.stages != Stages::All || !self.learns_style;
        let total = match (self.options.budget, stage) {
            (Budget::Steps(_), _) if only => return self.options.budget,
            (Budget::Steps(_), Stage::Geometry) => return self.options.budget.share(share),
            (Budget::Steps(_), Stage::Style) => return self.options.budget.share(1.0 - share),
            (Budget::Time(total), _) => total,
        };
        let [geometry, style] = end_of_stages(total, share);
        let end = match stage {
            Stage::Geometry if only => end_of_geometry_alone(total),
            Stage::Geometry => geometry,
            Stage::Style => style,
        };
        let end = match stage {
            Stage::Geometry => end.saturating_sub(distillation_time(&self.options.config, total)),
            Stage::Style => end,
        };
        let left = end.saturating_sub(began);
        Budget::Time(left.max(Duration::from_millis(100)))
    }

    /// Distils what is around places, unless the model knows it.
    fn distil(&self, file: &mut ModelFile) -> Result<(), TrainError> {
        let known = file.features.as_ref().map(|features| &features.spec);
        let paint = file.config.style.shading.paint();
        if known == paint.map(|paint| &paint.distilled) {
            return Ok(());
        }
        let budget = match self.options.budget {
            Budget::Time(total) => DistillationBudget {
                steps: DISTILLATION_STEPS,
                time: Some(distillation_time(&self.options.config, total)),
            },
            Budget::Steps(steps) => DistillationBudget {
                steps: steps.min(DISTILLATION_STEPS),
                time: None,
            },
        };
        let model = Model::from_file(file.clone());
        file.features = distil(&model, budget, self.options.seed)?;
        Ok(())
    }

    fn geometry(&mut self) -> Result<(ModelFile, u64), TrainError> {
        let options = self.options;
        let config = &options.config;
        let mut stage = GeometryStage::new(&self.scene, config, options.seed, &options.device);
        let place = self.started(Stage::Geometry, 0);
        let steps = self.steps_of(&mut stage, place)?;
        let moved: Vec<_> = stage.cameras().collect();
        let photos = self.scene.photos.iter_mut();
        let mut training: Vec<_> = photos.filter(|p| p.split == Split::Train).collect();
        for (photo, camera) in &moved {
            training[*photo].camera = *camera;
        }
        let TrainedGeometry {
            radiance,
            grids,
            features,
        } = stage.snapshot();
        drop(stage);
        let mut file = ModelFile {
            config: config.clone(),
            scene: model_scene(&self.scene),
            quality: Quality::default(),
            seed: options.seed,
            radiance,
            grids,
            features,
            style: self.painter.clone(),
            encoder: None,
            finished: None,
        };
        self.distil(&mut file)?;
        let model = Model::from_file(file.clone());
        let limit = match options.budget {
            Budget::Time(time) => time.mul_f64(COMPARISON),
            Budget::Steps(_) => Duration::MAX,
        };
        let (quality, preview) =
            validation::validate(&model, &self.scene, !moved.is_empty(), limit);
        file.quality = quality;
        self.log.event(&Event::Validation {
            step: steps,
            psnr: quality.psnr,
            ssim: quality.ssim,
            views: quality.views,
        });
        if let Some(preview) = preview {
            self.preview("geometry.png", &preview)?;
        }
        if self.learns_style {
            self.save(&file)?;
        }
        Ok((file, steps))
    }

    /// Steps until the stage's budget is used up, from where an interrupted run was in it.
    fn steps_of(&mut self, stage: &mut dyn Steps, mut place: Place) -> Result<u64, TrainError> {
        let options = self.options;
        let (mut stepping, mut steps, mut reported) = Default::default();
        if let Some(Earlier(checkpoint)) = self.earlier.take() {
            let at = &checkpoint.position;
            checkpoint.restore(&options.device, |from| stage.restore(&at.stage, from))?;
            (stepping, steps, reported) = (at.stepping, at.steps, at.reported);
            place.began = at.began;
            self.watch = Stopwatch::after(at.ran);
            self.log.event(&Event::Resumed {
                stage: place.stage,
                step: at.steps,
                seconds: at.ran.as_secs_f64(),
            });
        }
        let budget = self.stage_budget(place.stage, place.began);
        let mut clock = Clock::resumed(budget, stepping, steps);
        let mut progress = Progress::new(place.stage, reported);
        while !clock.is_over() {
            if options.recovery.stop.is_requested() {
                self.checkpoint(&place, &clock, &progress, stage)?;
                return Err(TrainError::Stopped {
                    folder: options.output.clone(),
                    stage: place.stage,
                    steps: clock.steps,
                });
            }
            let (losses, rays) = stage.step(&clock)?;
            clock.steps += 1;
            if let Some(event) = progress.step(&clock, losses, rays) {
                self.log.event(&event);
            }
            // What follows the geometry stage takes long, and must not cost it its last steps.
            let over = place.stage == Stage::Geometry && clock.is_over();
            if (over || self.saved.elapsed() >= options.recovery.every)
                && let Err(error) = self.checkpoint(&place, &clock, &progress, stage)
            {
                let message = format!("{error}; the run goes on without this checkpoint");
                self.log.event(&Event::Warning { message });
            }
        }
        Ok(clock.steps)
    }

    fn checkpoint(
        &mut self,
        place: &Place,
        clock: &Clock,
        progress: &Progress,
        stage: &dyn Steps,
    ) -> Result<(), TrainError> {
        let (memory, tensors) = stage.progress();
        let position = Position {
            version: checkpoint::VERSION,
            identity: self.identity.clone(),
            budget: self.options.budget,
            ran: self.watch.elapsed(),
            began: place.began,
            steps: clock.steps,
            stepping: clock.elapsed(),
            geometry_steps: place.geometry_steps,
            reported: progress.reported,
            stage: memory,
        };
        let saved = position.save(&self.options.output, tensors);
        // Also after a failure: a full disk must not be tried after every step.
        self.saved = Instant::now();
        self.log.event(&Event::Checkpoint { path: saved? });
        Ok(())
    }

    fn preview(&mut self, name: &str, picture: &image::RgbImage) -> Result<(), TrainError> {
        let path = self.options.output.join("previews").join(name);
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|e| TrainError::write(&path, &e))?;
        write_atomic(&path, bytes.get_ref()).map_err(|e| TrainError::write(&path, &e))?;
        self.log.event(&Event::Preview { path });
        Ok(())
    }

    fn save(&mut self, file: &ModelFile) -> Result<(), TrainError> {
        let path = file.save(&self.options.output)?;
        self.log.event(&Event::Checkpoint { path });
        Ok(())
    }

    fn style(&mut self, file: &mut ModelFile, geometry_steps: u64) -> Result<u64, TrainError> {
        // The field stays as it was trained; only what concerns styles is taken from this run.
        file.config.style = self.options.config.style.clone();
        file.config.style_app = self.options.config.style_app.clone();
        file.encoder = self.encoder.clone();
        self.distil(file)?;
        let (vgg, vae) = (file.config.style.perceptual.load()?, file.encoder()?);
        let mut place = self.started(Stage::Style, geometry_steps);
        let whole = self.stage_budget(Stage::Style, place.began);
        let styles = self.gathered(file, &vgg, whole)?;
        let shown: Vec<_> = (0..styles.len())
            .step_by(styles.len().div_ceil(4).max(1))
            .map(|index| styles.style(&vae, index, None))
            .map(|style| StyleEmbedding {
                code: style.code,
                colors: style.colors,
                exemplar: style.exemplar.into(),
            })
            .collect();
        // Where the geometry stage has found them to be.
        for (photo, known) in self.scene.photos.iter_mut().zip(&file.scene.photos) {
            photo.camera.camera_to_world = known.camera.camera_to_world;
        }
        let photos = photo_rays(self.scene.train().map(|(_, p)| p));
        let geometry = TrainedGeometry {
            radiance: file.radiance.clone(),
            grids: file.grids.clone(),
            features: file.features.clone(),
        };
        let mut stage = StyleStage::new(
            &file.config,
            geometry,
            photos,
            StyleNetworks {
                vgg,
                vae,
                first: self.painter.clone(),
            },
            styles,
            self.options.seed,
            &self.options.device,
        );
        place.began = self.watch.elapsed();
        let steps = self.steps_of(&mut stage, place)?;
        file.style = Some(stage.snapshot());
        let model = Model::from_file(file.clone());
        if let Some(preview) = validation::style_preview(&model, &shown) {
            self.preview("style.png", &preview)?;
        }
        Ok(steps)
    }
}

impl Run<'_> {
    /// Statistics, from the cache or measured within a part of the stage's time.
    fn gathered(
        &mut self,
        file: &ModelFile,
        vgg: &Perceptual,
        budget: Budget,
    ) -> Result<StyleSet, TrainError> {
        let folder = self.paintings.as_ref();
        let sources = StyleSources {
            folder,
            crops: CROPS,
            generated: folder.map_or(GENERATED_ALONE, |_| file.config.style.generated),
            patch: file.config.style.patch,
            pictures: file.config.style.pictures,
            exemplars: file.config.style.shading.paint().is_some(),
            cache: self.options.cache.as_deref(),
            deadline: match budget {
                Budget::Time(time) => Some(Instant::now() + time.mul_f64(PREPARATION)),
                Budget::Steps(_) => None,
            },
        };
        let styles = StyleSet::gather(vgg, &sources, &mut |event| self.log.event(event))?;
        self.unreadable = styles.unreadable.len();
        Ok(styles)
    }
}

fn model_scene(scene: &Scene) -> ModelScene {
    let photos = scene.photos.iter().map(|photo| ModelPhoto {
        name: photo.name.clone(),
        split: photo.split,
        camera: photo.camera,
    });
    ModelScene {
        name: scene.name.clone(),
        synthetic: scene.synthetic,
        normalisation: scene.normalisation,
        photos: photos.collect(),
    }
}
