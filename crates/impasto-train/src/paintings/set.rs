//! The paintings that a run learns from: statistics, measured once.

use crate::TrainError;
use crate::event::Event;
use crate::paintings::cache::Measured;
use crate::paintings::measure::{Measurer, Sampling, parts, warn_of_unreadable};
use crate::paintings::windows::window_statistics;
use image::RgbImage;
use impasto_model::config::PictureConfig;
use impasto_model::{
    CodeNormalisation, ColorStatistics, exemplar, mixed_exemplars, square_statistics,
    structure_statistics,
};
use impasto_scene::{PictureFile, PictureFolder};
use impasto_style::{Perceptual, Statistics, StyleCode, StyleError, StyleVae, square_crop};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Random crops per painting, beside the whole, that a run learns from.
pub const CROPS: u16 = 8;
/// Codes that are looked at to normalise all.
const MOST_CODES: usize = 2048;
/// First seed of generated training pictures; the ones below are free for other uses.
pub const FIRST_GENERATED: u64 = 10_000;
/// Most styles of a run, at 4 kB each: all 81,330 paintings of WikiArt and as many crops and
/// generated pictures as there is room for. Of a larger folder, a part as good as random is used.
pub const MOST_STYLES: usize = 131_072;
/// Most styles whose pictures are held as well, at 200 kB each, because their detail is painted with.
pub const MOST_EXEMPLARS: usize = 4096;

/// A painting as training sees it.
#[derive(Debug, Clone)]
pub struct Style {
    /// Mean statistics of patch-sized windows: what a patch can be compared with. A window has
    /// less variety than the whole, and more border for its pixels.
    pub target: Statistics,
    /// Its colours.
    pub colors: ColorStatistics,
    /// The code.
    pub code: StyleCode,
    /// Its detail; nothing where none is painted with.
    pub exemplar: Vec<f32>,
}

/// What a folder of paintings turned into.
#[derive(Debug, Clone, Default)]
pub struct Paintings {
    /// Readable pictures with their names within the folder, in name order.
    pub named: Vec<(String, RgbImage)>,
    /// Files that could not be read, with the reason.
    pub unreadable: Vec<(PathBuf, String)>,
}

/// Reads every image of a folder and its sub-folders, all into memory: for folders of hundreds.
///
/// # Errors
/// If the folder cannot be listed.
pub fn read_paintings(dir: &Path) -> std::io::Result<Paintings> {
    let folder = PictureFolder::walk(dir)?;
    let read: Vec<_> = folder.files.par_iter().map(PictureFile::read).collect();
    let mut paintings = Paintings {
        unreadable: folder.unreadable,
        ..Paintings::default()
    };
    for (image, file) in read.into_iter().zip(folder.files) {
        match image {
            Ok(image) => paintings.named.push((file.name, image)),
            Err(reason) => paintings.unreadable.push((file.path, reason)),
        }
    }
    Ok(paintings)
}

/// What styles to learn from.
#[derive(Debug, Clone, Copy)]
pub struct StyleSources<'a> {
    /// Paintings: whole and in random crops.
    pub folder: Option<&'a PictureFolder>,
    /// Random crops per painting, beside the whole.
    pub crops: u16,
    /// Generated pictures beside them.
    pub generated: usize,
    /// Height and width of the patches that will be painted.
    pub patch: [usize; 2],
    /// What paintings are measured on.
    pub pictures: PictureConfig,
    /// Whether the pictures' own detail is painted with.
    pub exemplars: bool,
    /// Folder where statistics are kept for later runs, see [`crate::cache_folder`].
    pub cache: Option<&'a Path>,
    /// When to stop measuring. At least 128 pictures are measured, whole paintings first; those
    /// that are missing then are left out, unless they are cached.
    pub deadline: Option<Instant>,
}

/// The styles of a run: statistics in half precision, of which the rest is made when drawn.
#[derive(Debug, Clone)]
pub struct StyleSet {
    kept: Vec<Arc<Measured>>,
    /// Their pictures, where their detail is painted with.
    squares: Vec<RgbImage>,
    /// Factor from whole pictures to windows, per statistic.
    shrinkage: Vec<f32>,
    /// Files that are no pictures, with the reason.
    pub unreadable: Vec<(PathBuf, String)>,
    /// Pictures that had to be looked at; the others' statistics were cached.
    pub fresh: usize,
}

impl StyleSet {
    /// Measures styles, or takes them from the cache: what comes out does not depend on which.
    ///
    /// # Errors
    /// If there is no picture at all.
    pub fn gather(
        vgg: &Perceptual,
        sources: &StyleSources<'_>,
        sink: &mut dyn FnMut(&Event),
    ) -> Result<Self, TrainError> {
        let (path, files) = parts(sources.folder);
        let sampling = Sampling {
            crops: sources.crops,
            pictures: sources.pictures,
            first_generated: FIRST_GENERATED,
            generated: sources.generated,
            most: match sources.exemplars {
                true => MOST_EXEMPLARS,
                false => MOST_STYLES,
            },
            squares: sources.exemplars,
            window: sources.pictures.windowed.then_some(sources.patch),
            deadline: sources.deadline,
        };
        let cache = sources.cache;
        let gathered = Measurer { vgg, cache, sink }.gather(path, files, &sampling)?;
        let mut unreadable = sources.folder.map_or(Vec::new(), |f| f.unreadable.clone());
        unreadable.extend(gathered.unreadable);
        warn_of_unreadable(&unreadable, sink);
        if gathered.pictures.is_empty() {
            return Err(TrainError::Styles {
                path: path.to_owned(),
                reason: "holds no readable painting any more".into(),
            });
        }
        Ok(Self {
            shrinkage: shrinkage(&gathered.pictures, &gathered.windows),
            kept: gathered.pictures,
            squares: gathered.squares,
            unreadable,
            fresh: gathered.fresh,
        })
    }

    /// The styles of whole pictures in memory.
    ///
    /// # Errors
    /// Never for pictures of at least 1×1 pixel.
    pub fn of_pictures(
        vgg: &Perceptual,
        pictures: &[RgbImage],
        patch: [usize; 2],
        settings: &PictureConfig,
    ) -> Result<Self, StyleError> {
        let (mut kept, mut windows, mut squares) = (Vec::new(), Vec::new(), Vec::new());
        for image in pictures {
            let square = square_crop(image, 1.0, (0.5, 0.5), settings.side);
            squares.push(square.clone());
            let colors = ColorStatistics::of_picture(image);
            let measured = |s: &_, structure: &_| Arc::new(Measured::new(s, structure, colors));
            let structure = structure_statistics(vgg, &square, settings)?;
            kept.push(measured(&square_statistics(vgg, &square)?, &structure));
            if settings.windowed {
                let window = window_statistics(vgg, &square, patch)?;
                windows.push(measured(&window, &window));
            }
        }
        Ok(Self {
            shrinkage: shrinkage(&kept, &windows),
            kept,
            squares,
            unreadable: Vec::new(),
            fresh: pictures.len(),
        })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// How their codes are normalised, by at most a few thousand of them.
    pub(crate) fn code_normalisation(&self, vae: &StyleVae) -> CodeNormalisation {
        let step = self.kept.len().div_ceil(MOST_CODES).max(1);
        let some: Vec<_> = self.kept.iter().step_by(step).collect();
        let codes = some.par_iter().map(|one| vae.encode(&one.structure()));
        CodeNormalisation::of(&codes.collect::<Vec<_>>())
    }

    /// One style, or what lies between it and another: `other` is an index with its share. The
    /// losses need statistics only, and the code that belongs to mixed statistics is known.
    ///
    /// # Panics
    /// If an index is not below [`Self::len`].
    pub fn style(&self, vae: &StyleVae, index: usize, other: Option<(usize, f32)>) -> Style {
        let one = &self.kept[index];
        let (mut statistics, mut colors) = (one.statistics(), one.colors);
        let mut structure = one.structure();
        let detail = |index: usize| self.squares.get(index).map(exemplar).unwrap_or_default();
        let mut own = detail(index);
        if let Some((other, share)) = other {
            if !own.is_empty() {
                let both = [(&*own, 1.0 - share), (&*detail(other), share)];
                own = mixed_exemplars(both.into_iter());
            }
            let other = &self.kept[other];
            statistics = statistics.mixed(&other.statistics(), share);
            structure = structure.mixed(&other.structure(), share);
            colors = colors.mixed(&other.colors, share);
        }
        let shrunk = statistics.0.iter().zip(&self.shrinkage).map(|(x, s)| x * s);
        Style {
            target: Statistics(shrunk.collect()),
            code: vae.encode(&structure),
            exemplar: own,
            colors,
        }
    }
}

/// How each statistic changes, on average, from whole pictures to windows: measured on a few, the
/// first, it saves the windows of all others.
fn shrinkage(wholes: &[Arc<Measured>], windows: &[Arc<Measured>]) -> Vec<f32> {
    let sum = |all: &[Arc<Measured>]| {
        let mut sum = vec![0.0; Statistics::LEN];
        for one in all.iter().take(windows.len()) {
            let numbers = one.statistics();
            sum.iter_mut().zip(&numbers.0).for_each(|(s, x)| *s += x);
        }
        sum
    };
    let both = sum(wholes).into_iter().zip(sum(windows));
    both.map(|(whole, window): (f32, f32)| {
        if whole > 0.0 {
            (window / whole).clamp(0.5, 2.0)
        } else {
            1.0
        }
    })
    .collect()
}
