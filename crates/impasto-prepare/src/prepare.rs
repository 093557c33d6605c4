//! From raw photos to a capture, step by step.

use std::fs;
use std::num::NonZero;
use std::path::Path;
use std::thread::available_parallelism;
use std::time::Instant;

use impasto_scene::{LoadOptions, Scene, load, overview};

use crate::colmap::{self, Colmap, Model, Plan};
use crate::error::PrepareError;
use crate::event::{Phase, Sink, note, progress, warning};
use crate::folder::{self, SceneFolder};
use crate::log::Log;
use crate::options::{Matching, PrepareOptions};
use crate::photos::{self, Group, LEAST, LeftOut, Source, Taken, few, too_few};
use crate::summary::{PrepareSummary, Seconds, VideoFrames, summarise};
use crate::video::{self, Ffmpeg};

/// Photos that each camera of a model must have for its principal point to be told. (Twelve of the
/// castle did it good.)
const TELLING: usize = 10;
/// Files of a model that readers look at.
const MODEL_FILES: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];

/// What there is to work with.
struct Input {
    sources: Vec<Source>,
    left_out: Vec<LeftOut>,
    video: Option<VideoFrames>,
}

/// What COLMAP found.
struct Found {
    groups: Vec<Group>,
    plan: Plan,
    models: Vec<Model>,
}

/// A run under way.
struct Preparation<'a> {
    options: &'a PrepareOptions,
    folder: &'a SceneFolder,
    log: &'a mut Log,
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
    let mut found = Input {
        sources: Vec::new(),
        left_out: Vec::new(),
        video: None,
    };
    if input.is_dir() {
        (found.sources, found.left_out) = photos::list(input, &options.scene)?;
        if found.sources.len() < LEAST {
            let usable = found.sources.len();
            return Err(too_few(input, usable, usable, &found.left_out));
        }
    } else if !video::is_video(input) {
        return Err(PrepareError::Unsupported(input.clone()));
    }
    let folder = SceneFolder::new(&options.scene)?;
    let mut log = folder.log()?;
    let mut preparation = Preparation {
        options,
        folder: &folder,
        log: &mut log,
        seconds: Seconds::default(),
        threads: available_parallelism().map_or(1, NonZero::get),
    };
    let mut summary = preparation.run(found, events)?;
    drop(log);
    folder.finish()?;
    summary.seconds.all = start.elapsed().as_secs_f64();
    Ok(summary)
}

impl Preparation<'_> {
    fn run(&mut self, mut input: Input, events: Sink<'_>) -> Result<PrepareSummary, PrepareError> {
        // What is missing is told before the work.
        let colmap = Colmap::new(&self.options.colmap, self.log)?;
        if !self.options.input.is_dir() {
            self.take_frames(&mut input, events)?;
        }
        let start = Instant::now();
        let images = self.folder.ready().join("images");
        let taken = photos::take(
            &self.options.input,
            &input.sources,
            &images,
            &mut input.left_out,
            events,
        )?;
        self.seconds.photos = start.elapsed().as_secs_f64();
        let turned = taken.iter().filter(|photo| photo.turned).count();
        if turned > 0 {
            let message = format!("{turned} photo(s) are turned upright, as their EXIF data say");
            note(events, message);
        }
        let found = self.place(&colmap, &images, &taken, input.video.is_some(), events)?;
        let scene = self.check(events)?;
        let mut summary = summarise(&scene, &taken, &found.groups, &found.models);
        self.options.scene.clone_into(&mut summary.scene);
        summary.colmap = colmap.version;
        summary.matching = found.plan.name();
        summary.photos.given = input.sources.len();
        summary.left_out = input.left_out;
        summary.video = input.video;
        summary.picture = self.options.scene.join("capture.png");
        summary.log = self.log.destination().to_owned();
        summary.seconds = self.seconds;
        Ok(summary)
    }

    fn take_frames(&mut self, input: &mut Input, events: Sink<'_>) -> Result<(), PrepareError> {
        let start = Instant::now();
        let ffmpeg = Ffmpeg::new(&self.options.ffmpeg, self.log)?;
        let (sources, told) = video::frames(
            &ffmpeg,
            &self.options.input,
            self.options.frames,
            &self.folder.work().join("frames"),
            self.log,
            events,
        )?;
        input.sources = sources;
        input.video = Some(told);
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
        events: Sink<'_>,
    ) -> Result<Found, PrepareError> {
        let work = self.folder.work();
        let groups = photos::groups(taken, self.options.cameras)?;
        let mut names: Vec<String> = taken.iter().map(|photo| photo.name.clone()).collect();
        names.sort();
        let count = names.len();
        let plan = colmap::plan(self.options.matching, &names, video);

        let start = Instant::now();
        let threads = colmap::extraction_threads(taken, self.threads);
        let features = colmap::extract(colmap, &work, images, &groups, threads, self.log, events)?;
        self.seconds.features = start.elapsed().as_secs_f64();

        note(events, self.announce(plan, count, features));
        let start = Instant::now();
        colmap::compare(colmap, &work, &plan, self.threads, self.log, events)?;
        self.seconds.matching = start.elapsed().as_secs_f64();

        let start = Instant::now();
        colmap::map(colmap, &work, images, count, self.log, events)?;
        let models = colmap::models(&work.join("models"), self.log)?;
        let registered = models.first().map_or(0, |model| model.photos.len());
        if registered < LEAST {
            return Err(PrepareError::NotRegistered {
                registered,
                photos: count,
                advice: match plan {
                    Plan::Exhaustive => "",
                    Plan::Sequential => ", or use --matching exhaustive",
                },
                log: self.log.destination().to_owned(),
            });
        }
        self.keep(colmap, &models[0], &groups, events)?;
        self.seconds.mapping = start.elapsed().as_secs_f64();
        warn_of_lost(&models, &names, events);
        Ok(Found {
            groups,
            plan,
            models,
        })
    }

    /// Which photos will be compared, and how long that may take.
    fn announce(&self, plan: Plan, photos: usize, features: f64) -> String {
        let pairs = plan.pairs(photos);
        let minutes = plan.seconds(photos, features, self.threads) / 60.0;
        let mut text = match plan {
            Plan::Exhaustive => format!("comparing all {pairs} pairs of {photos} photos"),
            Plan::Sequential => format!("comparing {photos} photos with their neighbours by name"),
        };
        text += &match minutes {
            m if m < 1.0 => ", less than a minute".to_owned(),
            m if m < 90.0 => format!(", about {m:.0} min"),
            m => format!(", about {:.1} h", m / 60.0),
        };
        match plan {
            Plan::Sequential => {
                text += "; that a walk comes back to its start is not looked for: if the picture of \
                         the cameras is torn there, use --matching exhaustive";
            }
            Plan::Exhaustive if minutes > 30.0 && self.options.matching == Matching::Auto => {
                text += "; photos in the order in which they were taken can be compared much \
                         faster: --matching sequential";
            }
            Plan::Exhaustive => {}
        }
        text
    }

    /// Puts the model in its place, adjusted once more where that helps.
    fn keep(
        &mut self,
        colmap: &Colmap<'_>,
        model: &Model,
        groups: &[Group],
        events: Sink<'_>,
    ) -> Result<(), PrepareError> {
        let mut from = model.folder.clone();
        let of_camera = |group: &Group| {
            let registered = |name: &&String| model.photos.binary_search(name).is_ok();
            match group.photos.iter().filter(registered).count() {
                // With a camera each, one photo.
                0 => None,
                count => Some(if group.shared { count } else { 1 }),
            }
        };
        if groups.iter().filter_map(of_camera).min() >= Some(TELLING) {
            progress(events, Phase::Refining, 0, 1);
            let refined = self.folder.work().join("refined");
            if colmap::refine(colmap, &model.folder, &refined, self.log)? {
                from = refined;
            } else {
                let message = "COLMAP could not adjust the principal point; the cameras are kept \
                               as they were before";
                warning(events, message.into());
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
    fn check(&self, events: Sink<'_>) -> Result<Scene, PrepareError> {
        progress(events, Phase::Checking, 0, 1);
        let ready = self.folder.ready();
        let scene =
            load(&ready, &LoadOptions::default()).map_err(|source| PrepareError::Scene {
                source,
                log: self.log.destination().to_owned(),
            })?;
        let picture = ready.join("capture.png");
        overview::picture(&scene)
            .save(&picture)
            .map_err(PrepareError::encode(&picture))?;
        progress(events, Phase::Checking, 1, 1);
        Ok(scene)
    }
}

/// Says which photos have no pose, and why that may be.
fn warn_of_lost(models: &[Model], names: &[String], events: Sink<'_>) {
    let kept = &models[0].photos;
    let lost: Vec<&String> = names
        .iter()
        .filter(|name| kept.binary_search(name).is_err())
        .collect();
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
