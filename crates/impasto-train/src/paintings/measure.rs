//! Statistics of many pictures: paintings read one by one, whole and in crops, and generated
//! ones; measured once, then taken from a [`Cache`].

use crate::event::Event;
use crate::hash::Hash;
use crate::paintings::cache::{Cache, Key, Measured};
use crate::paintings::folder::file_identity;
use crate::paintings::windows::window_statistics;
use crate::smooth::REPORT_EVERY;
use image::RgbImage;
use impasto_model::config::PictureConfig;
use impasto_model::{ColorStatistics, square_statistics, structure_statistics};
use impasto_paintings::{Recipe, paint};
use impasto_scene::{PictureFile, PictureFolder};
use impasto_style::{Perceptual, StyleError, picture, recolour, square_crop};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pictures whose windows are measured.
const WINDOWS: usize = 24;
/// Pictures measured before the first look at the clock, if there are as many.
const LEAST: usize = 128;
/// Pictures per thread between two looks at the clock.
const BATCH: usize = 4;
/// Pictures a turn while windows are measured: not to depend on the number of threads.
const FIRST_BATCH: usize = 8;
/// A cache is written at least this often, so that an interrupted run is not lost.
const SAVE_EVERY: Duration = Duration::from_secs(120);

/// Which pictures are made from a folder of paintings, and beside it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sampling {
    /// Random crops per painting, beside the whole.
    pub crops: u16,
    /// What becomes of them.
    pub pictures: PictureConfig,
    /// First seed of generated pictures.
    pub first_generated: u64,
    /// Generated pictures.
    pub generated: usize,
    /// Most pictures in all. Wholes come first, then crops and generated ones in turn.
    pub most: usize,
    /// Height and width of the windows to measure of the first pictures, if any.
    pub window: Option<[usize; 2]>,
    /// Whether the pictures themselves are kept.
    pub squares: bool,
    /// When to stop: what is missing then is taken from the cache or left out.
    pub deadline: Option<Instant>,
}

/// What was measured.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    /// Every picture, in an order that depends on names only.
    pub pictures: Vec<Arc<Measured>>,
    /// Mean over windows of the first of them.
    pub windows: Vec<Arc<Measured>>,
    /// Pictures themselves, where they were asked for.
    pub squares: Vec<RgbImage>,
    /// Files that are no pictures, with the reason.
    pub unreadable: Vec<(PathBuf, String)>,
    /// Pictures that had to be looked at.
    pub fresh: usize,
}

/// The perceptual network with the place of its caches.
pub(crate) struct Measurer<'a> {
    pub vgg: &'a Perceptual,
    /// Folder of cache files; `None` keeps nothing.
    pub cache: Option<&'a Path>,
    pub sink: &'a mut dyn FnMut(&Event),
}

impl Measurer<'_> {
    /// Measures the pictures that `sampling` makes of `files` of a folder, and the generated ones.
    pub(crate) fn gather(
        &mut self,
        path: &Path,
        files: &[PictureFile],
        sampling: &Sampling,
    ) -> Result<Gathered, StyleError> {
        let mut warn = |message| (self.sink)(&Event::Warning { message });
        let settings = settings(self.vgg, sampling)?;
        // Other spellings of a path are the same folder.
        let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let known = files.iter().map(file_identity).collect();
        let subject = settings.and(&real.display());
        let mut run = Gathering {
            vgg: self.vgg,
            sampling,
            files,
            known,
            folder: Cache::open(self.cache.filter(|_| !files.is_empty()), subject, &mut warn),
            made: Cache::open(
                self.cache.filter(|_| sampling.generated > 0),
                settings.and(&"generated"),
                &mut warn,
            ),
            bad: HashSet::new(),
            found: Gathered::default(),
        };
        run.all(self.sink)?;
        run.save(self.sink);
        Ok(run.found)
    }
}

/// All that changes statistics but the pictures themselves. The network is known by what it says
/// of a fixed picture, its last digits included, in which processors differ.
fn settings(vgg: &Perceptual, sampling: &Sampling) -> Result<Hash, StyleError> {
    const SIDE: u32 = 32;
    let pattern = RgbImage::from_fn(SIDE, SIDE, |x, y| {
        image::Rgb([(x * 8) as u8, (y * 8) as u8, ((x * y) % 256) as u8])
    });
    let said = vgg.features(&picture(&pattern), SIDE as usize, SIDE as usize)?;
    let bytes: Vec<u8> = said
        .statistics
        .0
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    Ok(Hash::of_bytes(&bytes)
        .and(&sampling.pictures.side)
        .and(&sampling.pictures.recoloured)
        .and(&sampling.pictures.canonical)
        .and(&sampling.crops)
        .and(&sampling.pictures.least_crop)
        .and(&sampling.first_generated))
}

/// One picture to take statistics of.
#[derive(Debug, Clone, Copy)]
enum Job {
    Crop { file: usize, crop: u16 },
    Generated(u64),
}

/// How one picture went.
enum Outcome {
    Found(Found),
    /// Not in the cache, and there is no time to look at it.
    Missing,
    Unreadable(String),
}

/// What is known of a picture.
struct Found {
    whole: Arc<Measured>,
    windows: Option<Arc<Measured>>,
    square: Option<RgbImage>,
    /// Whether it had to be looked at.
    fresh: bool,
}

struct Gathering<'a> {
    vgg: &'a Perceptual,
    sampling: &'a Sampling,
    files: &'a [PictureFile],
    /// Identities of the files.
    known: HashSet<u64>,
    folder: Cache,
    made: Cache,
    /// Files that were no pictures.
    bad: HashSet<usize>,
    found: Gathered,
}

impl Gathering<'_> {
    fn all(&mut self, sink: &mut dyn FnMut(&Event)) -> Result<(), StyleError> {
        let jobs = self.jobs();
        let (mut reported, mut saved) = (Instant::now(), Instant::now());
        let mut at = 0;
        while at < jobs.len() {
            let windowed = self
                .sampling
                .window
                .filter(|_| self.found.windows.len() < WINDOWS);
            let batch = match windowed {
                Some(_) => FIRST_BATCH,
                None => BATCH * rayon::current_num_threads(),
            };
            let chunk = &jobs[at..jobs.len().min(at + batch)];
            at += chunk.len();
            let late = self.found.pictures.len() >= LEAST
                && self.sampling.deadline.is_some_and(|d| Instant::now() >= d);
            let outcomes = chunk
                .par_iter()
                .map(|job| self.outcome(*job, windowed, late))
                .collect::<Result<Vec<_>, _>>()?;
            for (job, outcome) in chunk.iter().zip(outcomes) {
                self.take(*job, windowed, outcome);
            }
            if reported.elapsed() >= REPORT_EVERY || at == jobs.len() {
                reported = Instant::now();
                sink(&Event::Measured {
                    pictures: self.found.pictures.len(),
                    fresh: self.found.fresh,
                    planned: jobs.len(),
                });
            }
            if saved.elapsed() >= SAVE_EVERY {
                self.save(sink);
                saved = Instant::now();
            }
        }
        Ok(())
    }

    /// In the order of their use: wholes, in an order as good as random, because a deadline may
    /// cut it; then crops and generated pictures in turn.
    fn jobs(&self) -> Vec<Job> {
        let mut order: Vec<usize> = (0..self.files.len()).collect();
        order.sort_by_cached_key(|i| (Hash::of(&self.files[*i].name).0, *i));
        let order = &order;
        let crops = |which: std::ops::RangeInclusive<u16>| {
            which.flat_map(move |crop| order.iter().map(move |&file| Job::Crop { file, crop }))
        };
        let made = (0..self.sampling.generated as u64).map(Job::Generated);
        crops(0..=0)
            .chain(alternating(crops(1..=self.sampling.crops), made))
            .take(self.sampling.most)
            .collect()
    }

    fn key(&self, job: Job, window: Option<[usize; 2]>) -> Key {
        // No side is longer than the pictures are, or it is cut to that.
        let window = window.map_or([0; 2], |w| w.map(|side| side.min(u16::MAX.into()) as u16));
        let (picture, crop) = match job {
            Job::Crop { file, crop } => (file_identity(&self.files[file]), crop),
            Job::Generated(i) => (i, 0),
        };
        Key {
            picture,
            crop,
            window,
        }
    }

    fn cache(&self, job: Job) -> &Cache {
        match job {
            Job::Crop { .. } => &self.folder,
            Job::Generated(_) => &self.made,
        }
    }

    fn outcome(
        &self,
        job: Job,
        window: Option<[usize; 2]>,
        late: bool,
    ) -> Result<Outcome, StyleError> {
        let cached = |window| self.cache(job).get(&self.key(job, window));
        let (whole, windows) = (cached(None), window.map(|_| cached(window)));
        let fresh = whole.is_none() || windows.as_ref().is_some_and(Option::is_none);
        let kept = self.sampling.squares;
        if late && (fresh || kept) {
            return Ok(Outcome::Missing);
        }
        let square = match (fresh || kept).then(|| self.square(job)).transpose() {
            Ok(square) => square,
            Err(reason) => return Ok(Outcome::Unreadable(reason)),
        };
        let (whole, windows) = match (&square, whole) {
            (Some(square), whole) if fresh => self.look(square, whole, window)?,
            (_, Some(whole)) => (whole, windows.flatten()),
            (_, None) => return Ok(Outcome::Missing),
        };
        Ok(Outcome::Found(Found {
            whole,
            windows,
            square: square.filter(|_| kept),
            fresh,
        }))
    }

    /// Statistics of a picture, unless `whole` are known, and of its windows.
    fn look(
        &self,
        square: &RgbImage,
        whole: Option<Arc<Measured>>,
        window: Option<[usize; 2]>,
    ) -> Result<(Arc<Measured>, Option<Arc<Measured>>), StyleError> {
        let colors = ColorStatistics::of(picture(square).chunks_exact(3));
        let measured =
            |statistics: &_, structure: &_| Arc::new(Measured::new(statistics, structure, colors));
        let whole = match whole {
            Some(whole) => whole,
            None => {
                let statistics = square_statistics(self.vgg, square)?;
                let pictures = &self.sampling.pictures;
                match pictures.canonical {
                    true => measured(
                        &statistics,
                        &structure_statistics(self.vgg, square, pictures)?,
                    ),
                    false => measured(&statistics, &statistics),
                }
            }
        };
        let windows = match window {
            Some(size) => {
                let statistics = window_statistics(self.vgg, square, size)?;
                Some(measured(&statistics, &statistics))
            }
            None => None,
        };
        Ok((whole, windows))
    }

    fn take(&mut self, job: Job, window: Option<[usize; 2]>, outcome: Outcome) {
        let found = match outcome {
            Outcome::Found(found) => found,
            Outcome::Missing => return,
            Outcome::Unreadable(reason) => {
                if let Job::Crop { file, .. } = job
                    && self.bad.insert(file)
                {
                    let path = self.files[file].path.clone();
                    self.found.unreadable.push((path, reason));
                }
                return;
            }
        };
        if found.fresh {
            self.found.fresh += 1;
            let keys = [self.key(job, None), self.key(job, window)];
            let cache = match job {
                Job::Crop { .. } => &mut self.folder,
                Job::Generated(_) => &mut self.made,
            };
            cache.insert(keys[0], &found.whole);
            if let Some(mean) = &found.windows {
                cache.insert(keys[1], mean);
            }
        }
        self.found.pictures.push(found.whole);
        self.found.windows.extend(found.windows);
        self.found.squares.extend(found.square);
    }

    /// The picture of a job, or why there is none.
    fn square(&self, job: Job) -> Result<RgbImage, String> {
        let side = self.sampling.pictures.side;
        match job {
            Job::Generated(i) => {
                let recipe = Recipe::random(self.sampling.first_generated + i);
                Ok(paint(&recipe, side, side))
            }
            Job::Crop { file, .. } if self.bad.contains(&file) => Err("see above".into()),
            Job::Crop { file, crop: 0 } => {
                let painting = self.files[file].read()?;
                Ok(square_crop(&painting, 1.0, (0.5, 0.5), side))
            }
            Job::Crop { file, crop } => {
                let file = &self.files[file];
                let seed = Hash::of(&file.name).and(&crop).0;
                Ok(self.random_crop(&file.read()?, &mut Pcg64::seed_from_u64(seed)))
            }
        }
    }

    fn random_crop(&self, painting: &RgbImage, rng: &mut Pcg64) -> RgbImage {
        let pictures = &self.sampling.pictures;
        // Every area is as likely as any other.
        let part = rng.random_range(pictures.least_crop.powi(2)..1.0).sqrt();
        let place = (rng.random(), rng.random());
        let mut square = square_crop(painting, part, place, pictures.side);
        if rng.random() {
            image::imageops::flip_horizontal_in_place(&mut square);
        }
        if rng.random_bool(pictures.recoloured) {
            recolour(&mut square, rng);
        }
        square
    }

    fn save(&mut self, sink: &mut dyn FnMut(&Event)) {
        let mut warn = |message| sink(&Event::Warning { message });
        let known = &self.known;
        self.folder
            .save(|picture| known.contains(&picture), &mut warn);
        self.made.save(|_| true, &mut warn);
    }
}

/// Elements of both in turn, so that stopping early keeps the balance.
fn alternating<T>(
    one: impl Iterator<Item = T>,
    other: impl Iterator<Item = T>,
) -> impl Iterator<Item = T> {
    let (mut one, mut other) = (one.fuse(), other.fuse());
    let mut first = false;
    std::iter::from_fn(move || {
        first = !first;
        if first {
            one.next().or_else(|| other.next())
        } else {
            other.next().or_else(|| one.next())
        }
    })
}

/// Files that are named one by one; of more, the rest is counted.
const NAMED: usize = 20;

/// Warns of files that are no pictures.
pub(crate) fn warn_of_unreadable(all: &[(PathBuf, String)], sink: &mut dyn FnMut(&Event)) {
    let mut warn = |message| sink(&Event::Warning { message });
    for (path, reason) in all.iter().take(NAMED) {
        warn(format!("left out {}: {reason}", path.display()));
    }
    if let Some(rest) = all.len().checked_sub(NAMED).filter(|rest| *rest > 0) {
        warn(format!(
            "left out {rest} more files that are no readable pictures"
        ));
    }
}

/// Folder and files to gather from; none if there is no folder.
pub(crate) fn parts(folder: Option<&PictureFolder>) -> (&Path, &[PictureFile]) {
    folder.map_or((Path::new(""), &[]), |f| (&f.path, &f.files))
}
