//! From raw photos to a capture, step by step.

use std::fs;
use std::num::NonZero;
use std::path::Path;
use std::thread::available_parallelism;
use std::time::Instant;

use impasto_scene::{LoadOptions, Scene, load, overview};

use crate::colmap::{self, Colmap, MatchingPlan, Reconstruction, SparseModel};
use crate::error::PrepareError;
use crate::event::{Phase, Sink, note, progress, warning};
use crate::folder::{self, SceneFolder};
use crate::log::CommandLog;
use crate::options::{Matching, PrepareOptions};
use crate::photos::{self, CameraGroup, LEAST, LeftOut, PhotoSource, Taken, few, too_few};
use crate::summary::{PrepareSummary, Seconds, VideoFrames, summarise};
use crate::video::endings::is_video;
use crate::video::{self, Ffmpeg};

/// Photos that each camera of a model must have for its principal point to be told. (Twelve of the
/// castle did it good.)
const TELLING: usize = 10;
/// Files of a model that readers look at.
const MODEL_FILES: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];

/// What there is to work with.
struct Input {
    sources: Vec<PhotoSource>,
    left_out: Vec<LeftOut>,
    video: Option<VideoFrames>,
}

/// What COLMAP found.
struct Found {
    groups: Vec<CameraGroup>,
    plan: MatchingPlan,
    models: Vec<SparseModel>,
}

/// A run under way.
struct Preparation<'a> {
    options: &'a PrepareOptions,
    folder: &'a SceneFolder,
    log: &'a mut CommandLog,
    events: Sink<'a>,
    seconds: Seconds,
    threads: usize,
}

/// Makes a capture of the photos or the video: `images/`, `sparse/0/`, `colmap.log` and
/// `capture.png` in the folder `options.scene`, which appear when everything is done. After a
/// failure, and only where a program had been started, `colmap.log` is there.
///
/// # Errors
/// Unusable input, programs that are missing or fail, photos that do not fit together; see
/// [`PrepareError`].
pub fn prepare(options: &PrepareOptions, events: Sink<'_>) -> Result<PrepareSummary, PrepareError> {
    let start = Instant::now();
    let input = &options.input;
    if !input.exists() {
        return Err(PrepareError::Missing(input.clone()));
    }
    folder::check(&options.scene)?;
    let (sources, left_out) = if input.is_dir() {
        let (sources, left_out) = photos::list(input, &options.scene)?;
        if sources.len() < LEAST {
            return Err(too_few(input, sources.len(), sources.len(), &left_out));
        }
        (sources, left_out)
    } else if is_video(input) {
        (Vec::new(), Vec::new())
    } else {
        return Err(PrepareError::Unsupported(input.clone()));
    };
    let found = Input {
        sources,
        left_out,
        video: None,
    };
    let folder = SceneFolder::new(&options.scene)?;
    let mut log = folder.log()?;
    let mut preparation = Preparation {
        options,
        folder: &folder,
        log: &mut log,
        events,
        seconds: Seconds::default(),
        threads: available_parallelism().map_or(1, NonZero::get),
    };
    let mut summary = preparation.run(found)?;
    drop(log);
    folder.finish()?;
    summary.seconds.all = start.elapsed().as_secs_f64();
    Ok(summary)
}

impl Preparation<'_> {
    fn run(&mut self, mut input: Input) -> Result<PrepareSummary, PrepareError> {
        // What is missing is told before the work.
        let colmap = Colmap::new(&self.options.colmap, self.log)?;
        if !self.options.input.is_dir() {
            self.take_frames(&mut input)?;
        }
        let start = Instant::now();
        let images = self.folder.ready().join("images");
        let taken = photos::take(
            &self.options.input,
            &input.sources,
            &images,
            &mut input.left_out,
            self.events,
        )?;
        self.seconds.photos = start.elapsed().as_secs_f64();
        let turned = taken.iter().filter(|photo| photo.turned).count();
        if turned > 0 {
            let message = format!("{turned} photo(s) are turned upright, as their EXIF data say");
            note(self.events, message);
        }
        let found = self.place(&colmap, &images, &taken, input.video.is_some())?;
        let scene = self.check()?;
        let mut summary = summarise(&scene, &taken, &found.groups, &found.models);
        summary.photos.given = input.sources.len();
        Ok(PrepareSummary {
            scene: self.options.scene.clone(),
            colmap: colmap.version,
            matching: found.plan.name(),
            left_out: input.left_out,
            video: input.video,
            picture: self.options.scene.join("capture.png"),
            log: self.log.destination(),
            seconds: self.seconds,
            ..summary
        })
    }

    fn take_frames(&mut self, input: &mut Input) -> Result<(), PrepareError> {
        let start = Instant::now();
        let ffmpeg = Ffmpeg::new(&self.options.ffmpeg, self.log)?;
        let (sources, frames) = video::frames(
            &ffmpeg,
            &self.options.input,
            self.options.frames,
            &self.folder.work().join("frames"),
            self.log,
            self.events,
        )?;
        input.sources = sources;
        input.video = Some(frames);
        self.seconds.frames = start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Runs COLMAP; the largest model and its photos are then in the folder of finished parts.
    fn place(
        &mut self,
        colmap: &Colmap<'_>,
        images: &Path,
        taken: &[Taken],
        video: bool,
    ) -> Result<Found, PrepareError> {
        let groups = photos::groups(taken, self.options.cameras)?;
        let mut names: Vec<String> = taken.iter().map(|photo| photo.name.clone()).collect();
        names.sort();
        let count = names.len();
        let plan = colmap::plan(self.options.matching, &names, video);
        let mut reconstruction = Reconstruction {
            colmap,
            work: &self.folder.work(),
            images,
            log: self.log,
            events: self.events,
        };

        let start = Instant::now();
        let threads = colmap::extraction_threads(taken, self.threads);
        let features = reconstruction.extract(&groups, threads)?;
        self.seconds.features = start.elapsed().as_secs_f64();

        let free = self.options.matching == Matching::Auto;
        let seconds = plan.seconds(count, features, self.threads);
        note(reconstruction.events, announce(plan, count, seconds, free));
        let start = Instant::now();
        reconstruction.compare(plan, self.threads)?;
        self.seconds.matching = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let models = reconstruction.map(count)?;
        let registered = models.first().map_or(0, |model| model.photos.len());
        if registered < LEAST {
            return Err(PrepareError::NotRegistered {
                registered,
                photos: count,
                advice: match plan {
                    MatchingPlan::Exhaustive => "",
                    MatchingPlan::Sequential => ", or use --matching exhaustive",
                },
                log: self.log.destination(),
            });
        }
        self.keep(colmap, &models[0], &groups)?;
        self.seconds.mapping = start.elapsed().as_secs_f64();
        warn_of_lost(&models, &names, self.events);
        Ok(Found {
            groups,
            plan,
            models,
        })
    }

    /// Puts the model in its place, adjusted once more where that helps.
    fn keep(
        &mut self,
        colmap: &Colmap<'_>,
        model: &SparseModel,
        groups: &[CameraGroup],
    ) -> Result<(), PrepareError> {
        let mut from = model.folder.clone();
        let of_camera = |group: &CameraGroup| {
            let registered = |name: &&String| model.photos.binary_search(name).is_ok();
            let count = group.photos.iter().filter(registered).count();
            // With a camera each, one photo.
            (count > 0).then_some(if group.shared { count } else { 1 })
        };
        if groups.iter().filter_map(of_camera).min() >= Some(TELLING) {
            progress(self.events, Phase::Refining, 0, 1);
            let refined = self.folder.work().join("refined");
            if colmap::refine(colmap, &model.folder, &refined, self.log)? {
                from = refined;
            } else {
                let message = "COLMAP could not adjust the principal point; the cameras are kept \
                               as they were before";
                warning(self.events, message.into());
            }
        }
        let to = self.folder.ready().join("sparse/0");
        fs::create_dir_all(&to).map_err(PrepareError::write(&to))?;
        for name in MODEL_FILES {
            let to = to.join(name);
            fs::rename(from.join(name), &to).map_err(PrepareError::write(&to))?;
        }
        Ok(())
    }

    /// Reads the capture as training will, and draws it.
    fn check(&mut self) -> Result<Scene, PrepareError> {
        progress(self.events, Phase::Checking, 0, 1);
        let ready = self.folder.ready();
        let scene = load(&ready, &LoadOptions::default());
        let scene = scene.map_err(|source| self.log.unusable(source))?;
        let picture = ready.join("capture.png");
        let saved = overview::picture(&scene).save(&picture);
        saved.map_err(PrepareError::encode(&picture))?;
        progress(self.events, Phase::Checking, 1, 1);
        Ok(scene)
    }
}

/// Which photos will be compared, and how long that may take; `free` says that a plan was left to
/// this program.
fn announce(plan: MatchingPlan, photos: usize, seconds: f64, free: bool) -> String {
    let pairs = plan.pairs(photos);
    let minutes = seconds / 60.0;
    let duration = match minutes {
        m if m < 1.0 => "less than a minute".to_owned(),
        m if m < 90.0 => format!("about {m:.0} min"),
        m => format!("about {:.1} h", m / 60.0),
    };
    if plan == MatchingPlan::Sequential {
        return format!(
            "comparing {photos} photos with their neighbours by name, {duration}; that a walk comes \
             back to its start is not looked for: if the picture of the cameras is torn there, use \
             --matching exhaustive"
        );
    }
    let advice = if minutes > 30.0 && free {
        "; photos in the order in which they were taken can be compared much faster: --matching \
         sequential"
    } else {
        ""
    };
    format!("comparing all {pairs} pairs of {photos} photos, {duration}{advice}")
}

/// Says which photos have no pose, and why that may be.
fn warn_of_lost(models: &[SparseModel], names: &[String], events: Sink<'_>) {
    let kept = &models[0].photos;
    let mut lost: Vec<&String> = names.iter().collect();
    lost.retain(|name| kept.binary_search(name).is_err());
    if lost.is_empty() {
        return;
    }
    let mut message = format!(
        "{} of {} photos are not registered: {}",
        lost.len(),
        names.len(),
        few(&lost, ", ")
    );
    if models.len() > 1 {
        let sizes: Vec<String> = models.iter().map(|m| m.photos.len().to_string()).collect();
        message = format!(
            "COLMAP made {} separate models, of {} photos; the largest is kept. {message}. Photos \
             taken between the two places would join them",
            models.len(),
            sizes.join(" and ")
        );
    }
    warning(events, message);
}
