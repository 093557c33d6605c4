//! Training and checking of the encoder that turns a painting's statistics into a style code.

use crate::TrainError;
use crate::event::Event;
use crate::paintings::measure::{Measurer, Sampling, parts, warn_of_unreadable};
use crate::paintings::painting_folder;
use crate::smooth::{REPORT_EVERY, Smooth};
use burn::tensor::Device;
use impasto_model::config::PictureConfig;
use impasto_model::{STYLE_SIDE, TrainConfig};
use impasto_scene::file::{LARGEST_FILE, plainly, read_whole};
use impasto_scene::{PictureFile, PictureFolder};
use impasto_style::{
    Network, Perceptual, Statistics, StyleError, StyleInput, StyleVae, VaeTraining, train_vae,
};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Random crops per painting, beside the whole.
const CROPS: u16 = 13;
/// Smallest share of the side that a random crop keeps.
const LEAST_CROP: f32 = 0.45;
/// First seed of generated pictures: far from those that styles are learned from.
const FIRST_GENERATED: u64 = 1_000_000;
/// Most vectors to learn from; training holds several copies of them, 8 kB each.
const MOST: usize = 24_576;
/// Without a folder of its own, one painting in this many is held out.
const HELD_OUT: usize = 8;

/// How to train an encoder.
#[derive(Debug, Clone)]
pub struct EncoderOptions {
    /// A folder of paintings, with its sub-folders.
    pub styles: PathBuf,
    /// Paintings to check it on; without, every 8th of `styles` is held out.
    pub heldout: Option<PathBuf>,
    /// Optimiser steps.
    pub steps: u64,
    /// Generated pictures to learn from beside the paintings.
    pub generated: usize,
    /// The network that measures paintings.
    pub network: Network,
    /// Which statistics it reads.
    pub input: StyleInput,
    /// Pixels a side of the squares that paintings become.
    pub side: u32,
    /// Seed of the training; crops and generated pictures are always the same.
    pub seed: u64,
    /// Folder where statistics of paintings are kept for later runs; `None` keeps nothing.
    pub cache: Option<PathBuf>,
}

impl EncoderOptions {
    /// Steps that the shipped encoder was trained for.
    pub const STEPS: u64 = 1200;
    /// Generated pictures that the shipped encoder was trained on.
    pub const GENERATED: usize = 1600;
    /// Pixels a side that the shipped encoder has seen.
    pub const SIDE: u32 = STYLE_SIDE;
    /// Seed that the shipped encoder was trained with.
    pub const SEED: u64 = 1;
}

/// How well an encoder rebuilds whole paintings that it has not seen.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct EncoderCheck {
    /// Which statistics it reads.
    pub input: StyleInput,
    /// R²: share of the variance of the paintings' statistics that is rebuilt, see
    /// [`StyleVae::explained`].
    pub explained: f64,
    /// Paintings.
    pub paintings: usize,
    /// Files that are no pictures.
    pub unreadable: usize,
}

/// What training an encoder came to.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct EncoderSummary {
    /// On paintings that it has not seen.
    pub heldout: EncoderCheck,
    /// R² on all that it learned from.
    pub explained_of_training: f64,
    /// Vectors that it learned from: paintings, crops of them, generated pictures.
    pub vectors: usize,
    /// Steps.
    pub steps: u64,
    /// Seconds from start to end.
    pub seconds: f64,
}

/// Trains an encoder. What comes back has been rounded as its file is.
///
/// # Errors
/// If a folder cannot be read or holds no picture.
pub fn train_encoder(
    options: &EncoderOptions,
    sink: &mut dyn FnMut(&Event),
) -> Result<(StyleVae, EncoderSummary), TrainError> {
    let start = Instant::now();
    let mut folder = painting_folder(&options.styles)?;
    let heldout = match &options.heldout {
        Some(dir) => painting_folder(dir)?,
        None => hold_out(&mut folder),
    };
    let vgg = options.network.load()?;
    let cache = options.cache.as_deref();
    let sampling = Sampling {
        crops: CROPS,
        generated: options.generated,
        most: MOST,
        ..wholes(options.side)
    };
    // Before the training: a folder that cannot be used is no reason to lose it.
    let (unseen, unreadable) = vectors(&vgg, cache, &heldout, &wholes(options.side), sink)?;
    let (set, _) = vectors(&vgg, cache, &folder, &sampling, sink)?;
    let training = VaeTraining {
        input: options.input,
        steps: options.steps,
        batch: 64,
        rate: 1e-4,
        divergence: 2e-3,
        reconstruction: 5.0,
        mixed: 0.5,
        seed: options.seed,
    };
    let mut steps = Steps::new(options.steps);
    let vae = train_vae(&set, &training, &Device::flex(), |step, error| {
        steps.report(step, error, sink);
    });
    let vae = vae.of_network(options.network);
    let vae = StyleVae::from_bytes("the trained encoder", &vae.to_bytes()?)?;
    let summary = EncoderSummary {
        heldout: EncoderCheck::of(&vae, &unseen, unreadable),
        explained_of_training: vae.explained(&set),
        vectors: set.len(),
        steps: options.steps,
        seconds: start.elapsed().as_secs_f64(),
    };
    Ok((vae, summary))
}

/// Checks an encoder on a folder of paintings of `side` pixels, best ones that it has not seen.
///
/// # Errors
/// If the folder cannot be read or holds no picture.
pub fn check_encoder(
    vae: &StyleVae,
    heldout: &Path,
    side: u32,
    cache: Option<&Path>,
    sink: &mut dyn FnMut(&Event),
) -> Result<EncoderCheck, TrainError> {
    let folder = painting_folder(heldout)?;
    let vgg = vae.network().load()?;
    let (set, unreadable) = vectors(&vgg, cache, &folder, &wholes(side), sink)?;
    Ok(EncoderCheck::of(vae, &set, unreadable))
}

/// Reads an encoder's file.
///
/// # Errors
/// If it cannot be read or is no encoder.
pub fn read_encoder(path: &Path) -> Result<StyleVae, TrainError> {
    let (name, bytes) = read_weights(path, "train-encoder")?;
    Ok(StyleVae::from_bytes(&name, &bytes)?)
}

/// Name and bytes of a file of weights that the command `maker` makes.
pub(crate) fn read_weights(path: &Path, maker: &str) -> Result<(String, Vec<u8>), StyleError> {
    let name = path.display().to_string();
    match read_whole(path, LARGEST_FILE) {
        Ok(bytes) => Ok((name, bytes)),
        Err(error) => Err(StyleError::Weights {
            reason: format!(
                "cannot be read ({}); `impasto {maker}` makes one",
                plainly(&error)
            ),
            file: name,
        }),
    }
}

/// Whole paintings alone.
fn wholes(side: u32) -> Sampling {
    Sampling {
        crops: 0,
        pictures: PictureConfig {
            side,
            least_crop: LEAST_CROP,
            recoloured: 0.5,
            canonical: false,
            ..TrainConfig::fast().style.pictures
        },
        first_generated: FIRST_GENERATED,
        generated: 0,
        most: MOST,
        window: None,
        squares: false,
        deadline: None,
    }
}

impl EncoderCheck {
    fn of(vae: &StyleVae, unseen: &[Statistics], unreadable: usize) -> Self {
        Self {
            input: vae.input(),
            explained: vae.explained(unseen),
            paintings: unseen.len(),
            unreadable,
        }
    }
}

/// Statistics of a folder's pictures, and the number of files that are none.
fn vectors(
    vgg: &Perceptual,
    cache: Option<&Path>,
    folder: &PictureFolder,
    sampling: &Sampling,
    sink: &mut dyn FnMut(&Event),
) -> Result<(Vec<Statistics>, usize), TrainError> {
    let (path, files) = parts(Some(folder));
    let gathered = Measurer { vgg, cache, sink }.gather(path, files, sampling)?;
    let unreadable = [&folder.unreadable[..], &gathered.unreadable].concat();
    warn_of_unreadable(&unreadable, sink);
    let set: Vec<Statistics> = gathered.pictures.iter().map(|m| m.statistics()).collect();
    if set.is_empty() {
        return Err(TrainError::Styles {
            path: path.to_owned(),
            reason: "holds too few readable paintings; give more, or generated ones".into(),
        });
    }
    Ok((set, unreadable.len()))
}

/// Takes every 8th painting out of a folder.
fn hold_out(folder: &mut PictureFolder) -> PictureFolder {
    let (heldout, rest): (Vec<_>, Vec<_>) = std::mem::take(&mut folder.files)
        .into_iter()
        .enumerate()
        .partition(|(i, _)| i % HELD_OUT == 0);
    let files = |all: Vec<(usize, PictureFile)>| all.into_iter().map(|(_, file)| file).collect();
    folder.files = files(rest);
    PictureFolder {
        path: folder.path.clone(),
        files: files(heldout),
        unreadable: Vec::new(),
    }
}

/// Smoothed error, reported now and then.
struct Steps {
    steps: u64,
    smooth: Smooth,
    last: Instant,
}

impl Steps {
    fn new(steps: u64) -> Self {
        Self {
            steps,
            smooth: Smooth::default(),
            last: Instant::now(),
        }
    }

    fn report(&mut self, step: u64, error: f32, sink: &mut dyn FnMut(&Event)) {
        self.smooth.add(error.into());
        if self.last.elapsed() >= REPORT_EVERY || step + 1 == self.steps {
            self.last = Instant::now();
            sink(&Event::EncoderStep {
                step: step + 1,
                steps: self.steps,
                error: self.smooth.value().unwrap_or_default(),
            });
        }
    }
}
