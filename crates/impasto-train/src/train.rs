//! A whole run: capture and paintings in, model folder out.

use crate::budget::{Budget, Clock};
use crate::config::TrainConfig;
use crate::encoder::read_encoder;
use crate::event::{Event, Stage};
use crate::geometry_stage::GeometryStage;
use crate::log::Log;
use crate::model::{Inspiration, Model};
use crate::model_file::{MODEL_FILE, ModelFile, ModelPhoto, ModelScene, Quality};
use crate::patches::Frozen;
use crate::progress::Progress;
use crate::rays::photo_rays;
use crate::style_folder::StyleFolder;
use crate::style_stage::StyleStage;
use crate::styles::{StyleSet, StyleSources};
use crate::{TrainError, validation};
use burn::tensor::Device;
use impasto_scene::{Format, LoadOptions, MaskUse, Scene};
use impasto_style::{Perceptual, StyleVae};
use serde::Serialize;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Which stages to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stages {
    /// Both.
    All,
    /// Photos → field only.
    Geometry,
    /// Paintings → hypernetwork only, on the model that the output folder holds.
    Style,
}

/// What to train, on what, for how long.
#[derive(Debug, Clone)]
pub struct TrainOptions {
    /// The capture.
    pub scene: PathBuf,
    /// The model folder.
    pub output: PathBuf,
    /// A folder of paintings, with its sub-folders; without one, generated pictures only.
    pub styles: Option<PathBuf>,
    /// An encoder made by [`crate::train_encoder`], which the model then carries; without one,
    /// the shipped one.
    pub encoder: Option<PathBuf>,
    /// Folder where statistics of paintings are kept for later runs; `None` keeps nothing.
    pub cache: Option<PathBuf>,
    /// Stages.
    pub stages: Stages,
    /// Sizes and rates.
    pub config: TrainConfig,
    /// Limit on the whole run, loading and final checks included.
    pub budget: Budget,
    /// Photos are shrunk this many times.
    pub downscale: u32,
    /// Overrides the detected format.
    pub format: Option<Format>,
    /// What becomes of pixels that a mask hides.
    pub masks: MaskUse,
    /// Seed of everything random.
    pub seed: u64,
    /// What the stages compute on; see [`crate::DeviceChoice`].
    pub device: Device,
}

/// What a run came to.
#[derive(Debug, Clone, Serialize)]
pub struct TrainSummary {
    /// The model folder.
    pub model: PathBuf,
    /// Mean PSNR of held-out views, dB.
    pub psnr: f64,
    /// Mean SSIM of held-out views.
    pub ssim: f64,
    /// Held-out views.
    pub views: usize,
    /// Seconds from start to end.
    pub seconds: f64,
    /// Steps of the geometry stage.
    pub geometry_steps: u64,
    /// Steps of the style stage.
    pub style_steps: u64,
    /// Training photos.
    pub train_photos: usize,
    /// Files in the style folder, less those that are known to be no pictures.
    pub paintings: usize,
    /// Files in the style folder that the style stage found to be no pictures.
    pub unreadable_paintings: usize,
    /// Whether the photos were made by a program.
    pub synthetic: bool,
}

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

/// Trains and writes a model folder.
///
/// # Errors
/// If the capture, the paintings or the output folder cannot be used; nothing half-written is
/// left behind.
pub fn train(
    options: &TrainOptions,
    sink: &mut dyn FnMut(&Event),
) -> Result<TrainSummary, TrainError> {
    let start = Instant::now();
    options.config.validate()?;
    let load = LoadOptions {
        downscale: options.downscale,
        format: options.format,
        masks: options.masks,
    };
    let scene = impasto_scene::load(&options.scene, &load)?;
    check_sizes(&scene, options)?;
    let paintings = options.styles.as_deref();
    let paintings = paintings.map(StyleFolder::of_paintings).transpose()?;
    let encoder = options.encoder.as_deref().map(read_encoder).transpose()?;
    // Before anything is written.
    let trained = continued(options, &scene, encoder.clone())?;
    let mut log = Log::create(&options.output, sink)?;
    let found = paintings.as_ref().map_or(0, |folder| folder.files.len());
    let listed = paintings.as_ref().map_or(0, |f| f.unreadable.len());
    log.event(&loaded(&scene, found));
    for message in &scene.warnings {
        let message = message.clone();
        log.event(&Event::Warning { message });
    }
    let mut run = Run {
        options,
        scene,
        start,
        device: options.device.clone(),
        log,
        paintings,
        encoder,
        unreadable: 0,
    };
    let (mut file, geometry_steps) = match trained {
        Some(file) => (file, 0),
        None => run.geometry()?,
    };
    let style_steps = match options.stages {
        Stages::Geometry => 0,
        Stages::All | Stages::Style => run.style(&mut file)?,
    };
    let seconds = start.elapsed().as_secs_f64();
    run.log.event(&Event::Done { seconds });
    Ok(TrainSummary {
        model: options.output.clone(),
        psnr: file.quality.psnr,
        ssim: file.quality.ssim,
        views: file.quality.views,
        seconds,
        geometry_steps,
        style_steps,
        train_photos: run.scene.train().count(),
        // Unreadable entries of the listing were never among the files.
        paintings: (found + listed).saturating_sub(run.unreadable),
        unreadable_paintings: run.unreadable,
        synthetic: run.scene.synthetic,
    })
}

/// The model whose style stage is to run, if that is all; that a style stage can have its networks
/// is checked.
fn continued(
    options: &TrainOptions,
    scene: &Scene,
    encoder: Option<StyleVae>,
) -> Result<Option<ModelFile>, TrainError> {
    if options.stages == Stages::Geometry {
        return Ok(None);
    }
    options.config.style.perceptual.load()?;
    options.config.encoder(encoder)?;
    if options.stages == Stages::All {
        return Ok(None);
    }
    let file = ModelFile::load(&options.output.join(MODEL_FILE), &options.device)?;
    check_same_scene(&file, scene)?;
    Ok(Some(file))
}

fn loaded(scene: &Scene, paintings: usize) -> Event {
    let size = scene
        .photos
        .first()
        .map_or((0, 0), |p| p.pixels.dimensions());
    Event::Loaded {
        train_photos: scene.train().count(),
        test_photos: scene.test().count(),
        size: [size.0, size.1],
        paintings,
        synthetic: scene.synthetic,
    }
}

fn check_sizes(scene: &Scene, options: &TrainOptions) -> Result<(), TrainError> {
    let [least_height, least_width] = options.config.style.patch;
    // Patches are cut from training photos only.
    let small = scene.train().map(|(_, p)| p).find(|p| {
        let (w, h) = p.pixels.dimensions();
        (w as usize) < least_width || (h as usize) < least_height
    });
    match small {
        Some(photo) if options.stages != Stages::Geometry => Err(TrainError::SmallPhotos {
            photo: photo.name.clone(),
            width: photo.pixels.width() as usize,
            height: photo.pixels.height() as usize,
            least_width,
            least_height,
        }),
        _ => Ok(()),
    }
}

/// A frozen field fits only the capture that it was made from: the same photos, split and poses.
fn check_same_scene(file: &ModelFile, scene: &Scene) -> Result<(), TrainError> {
    let differs = |what: String| TrainError::OtherScene { what };
    let (ours, theirs) = (&file.scene.photos, &scene.photos);
    if ours.len() != theirs.len() {
        return Err(differs(format!(
            "{} photos instead of {}",
            theirs.len(),
            ours.len()
        )));
    }
    for (ours, theirs) in ours.iter().zip(theirs) {
        let moved = ours.camera.centre().distance(theirs.camera.centre());
        if ours.name != theirs.name || ours.split != theirs.split || moved > SAME_PLACE {
            return Err(differs(format!(
                "photo {} where the model knows {}, or another pose or split of it",
                theirs.name, ours.name
            )));
        }
    }
    Ok(())
}

/// How far a camera of the same capture may seem to have moved, scene units.
const SAME_PLACE: f64 = 1e-4;

struct Run<'a> {
    options: &'a TrainOptions,
    scene: Scene,
    start: Instant,
    device: Device,
    log: Log<'a>,
    paintings: Option<StyleFolder>,
    encoder: Option<StyleVae>,
    /// Files of the style folder that are no pictures.
    unreadable: usize,
}

impl Run<'_> {
    fn started(&mut self, stage: Stage, budget: Budget) {
        let (seconds, steps) = match budget {
            Budget::Time(time) => (Some(time.as_secs_f64()), None),
            Budget::Steps(steps) => (None, Some(steps)),
        };
        self.log.event(&Event::StageStarted {
            stage,
            seconds,
            steps,
        });
    }

    /// The budget of a stage that begins now.
    fn stage_budget(&self, stage: Stage) -> Budget {
        let share = self.options.config.geometry_share;
        let only = self.options.stages != Stages::All;
        let total = match (self.options.budget, stage) {
            (Budget::Steps(_), _) if only => return self.options.budget,
            (Budget::Steps(_), Stage::Geometry) => return self.options.budget.share(share),
            (Budget::Steps(_), Stage::Style) => return self.options.budget.share(1.0 - share),
            (Budget::Time(total), _) => total,
        };
        let reserve = total.mul_f64(RESERVE).max(LEAST_RESERVE).min(total / 4);
        let end = match stage {
            Stage::Geometry if only => total.mul_f64(1.0 - COMPARISON).saturating_sub(reserve),
            Stage::Geometry => total.mul_f64(share),
            Stage::Style => total.saturating_sub(reserve),
        };
        let left = end.saturating_sub(self.start.elapsed());
        Budget::Time(left.max(Duration::from_millis(100)))
    }

    fn geometry(&mut self) -> Result<(ModelFile, u64), TrainError> {
        let config = &self.options.config;
        let mut stage = GeometryStage::new(&self.scene, config, self.options.seed, &self.device);
        let budget = self.stage_budget(Stage::Geometry);
        self.started(Stage::Geometry, budget);
        let mut clock = Clock::start(budget);
        let mut progress = Progress::new(Stage::Geometry);
        while !clock.is_over() {
            let report = stage.step(&clock);
            clock.steps += 1;
            progress.step(
                &clock,
                [Some(report.loss), None, None],
                report.rays,
                &mut self.log,
            );
        }
        let (weights, grids, photo_app) = stage.snapshot();
        let mut file = ModelFile {
            config: config.clone(),
            scene: model_scene(&self.scene),
            quality: Quality::default(),
            seed: self.options.seed,
            weights,
            grids,
            photo_app,
            style: None,
            encoder: None,
        };
        let model = Model::from_file(file.clone(), self.device.clone());
        let limit = match self.options.budget {
            Budget::Time(time) => time.mul_f64(COMPARISON),
            Budget::Steps(_) => Duration::MAX,
        };
        let (quality, preview) = validation::validate(&model, &self.scene, limit);
        file.quality = quality;
        self.log.event(&Event::Validation {
            step: clock.steps,
            psnr: quality.psnr,
            ssim: quality.ssim,
            views: quality.views,
        });
        if let Some(preview) = preview {
            self.preview("geometry.png", &preview)?;
        }
        self.save(&file)?;
        Ok((file, clock.steps))
    }

    fn preview(&mut self, name: &str, picture: &image::RgbImage) -> Result<(), TrainError> {
        let path = self.options.output.join("previews").join(name);
        let mut bytes = std::io::Cursor::new(Vec::new());
        let failed = |reason: String| TrainError::Write {
            path: path.clone(),
            reason,
        };
        picture
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|e| failed(e.to_string()))?;
        crate::model_file::write_whole(&path, bytes.get_ref())?;
        self.log.event(&Event::Preview { path });
        Ok(())
    }

    fn save(&mut self, file: &ModelFile) -> Result<(), TrainError> {
        let path = file.save(&self.options.output)?;
        self.log.event(&Event::Checkpoint { path });
        Ok(())
    }

    fn style(&mut self, file: &mut ModelFile) -> Result<u64, TrainError> {
        // The field stays as it was trained; only what concerns styles is taken from this run.
        file.config.style = self.options.config.style.clone();
        file.config.style_app = self.options.config.style_app.clone();
        file.encoder = self.encoder.clone();
        let (vgg, vae) = (file.config.style.perceptual.load()?, file.encoder()?);
        let whole = self.stage_budget(Stage::Style);
        self.started(Stage::Style, whole);
        let styles = self.gathered(file, &vgg, whole)?;
        let shown: Vec<_> = (0..styles.len())
            .step_by(styles.len().div_ceil(4).max(1))
            .map(|index| styles.style(&vae, index, None))
            .map(|style| Inspiration {
                code: style.code,
                palette: style.palette,
            })
            .collect();
        let budget = self.stage_budget(Stage::Style);
        let photos = photo_rays(self.scene.train().map(|(_, p)| p));
        let frozen = Frozen {
            weights: file.weights.clone(),
            grids: file.grids.clone(),
            photo_app: file.photo_app.clone(),
        };
        let mut stage = StyleStage::new(
            &file.config,
            frozen,
            photos,
            (vgg, vae),
            styles,
            self.options.seed,
            &self.device,
        );
        let mut clock = Clock::start(budget);
        let mut progress = Progress::new(Stage::Style);
        while !clock.is_over() {
            let report = stage.step(&clock)?;
            clock.steps += 1;
            let losses = [Some(report.loss), report.content, report.style];
            progress.step(&clock, losses, report.rays, &mut self.log);
        }
        file.style = Some(stage.snapshot());
        let model = Model::from_file(file.clone(), self.device.clone());
        if let Some(preview) = validation::style_preview(&model, &shown) {
            self.preview("style.png", &preview)?;
        }
        self.save(file)?;
        Ok(clock.steps)
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
            generated: folder.map_or(GENERATED_ALONE, |_| file.config.style.generated),
            patch: file.config.style.patch,
            pictures: file.config.style.pictures,
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
