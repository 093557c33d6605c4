//! What a study consists of: its pairs, and the path and size of their clips.

use super::StudyError;
use super::trials::{ClipKind, Trial, trials};
use crate::methods::Stylizer;
use crate::render::{GROUP, small_orbit};
use image::RgbImage;
use impasto_model::Model;
use impasto_scene::{Camera, Split};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::BTreeSet;

/// JPEG quality of every clip: the same for all methods.
pub(super) const QUALITY: u8 = 75;
/// Frames of a whole orbit, of which a clip shows the first: steps small enough to look like
/// motion.
const AROUND: usize = 120;
/// Bytes of the page for a pixel of a clip: JPEG at [`QUALITY`] of busy pictures, as base64.
const BYTES_A_PIXEL: f64 = 0.45;
/// Bounds of the clips' longer side, in pixels: less shows no strokes, more no phone can show twice.
const SIDES: [f64; 2] = [160.0, 400.0];

/// What to make a study of.
#[derive(Clone, Copy)]
pub struct StudyOptions<'a> {
    /// Paintings with their names, best ones that the model has not seen.
    pub paintings: &'a [(String, RgbImage)],
    /// Methods to compare with, each frame by frame and as a video.
    pub against: &'a [&'a dyn Stylizer],
    /// Frames of a clip, at least 2.
    pub frames: usize,
    /// Most pairs of Impasto and a method; there are no more than two for each painting and method.
    pub questions: usize,
    /// Catch trials beside them.
    pub catches: usize,
    /// About how many bytes the page may have; clips are as large as that allows, within bounds.
    pub bytes: usize,
    /// Start of the random numbers: the same seed makes the same study.
    pub seed: u64,
}

/// A study that can be filmed.
pub struct StudyPlan<'a> {
    pub(super) options: StudyOptions<'a>,
    pub(super) trials: Vec<Trial>,
    /// Cameras of every clip.
    pub(super) path: Vec<Camera>,
}

impl<'a> StudyPlan<'a> {
    /// Chooses pairs and the size of their clips.
    ///
    /// # Errors
    /// If there is nothing to compare, or no path can be fitted to the model's cameras.
    pub fn new(model: &Model, options: StudyOptions<'a>) -> Result<Self, StudyError> {
        let mut random = Pcg64::seed_from_u64(options.seed);
        let size = [options.paintings.len(), options.against.len()];
        let trials = trials(size, [options.questions, options.catches], &mut random);
        let train = model.file.scene.cameras(Split::Train);
        let (Some(camera), false, true) = (train.first(), trials.is_empty(), options.frames >= 2)
        else {
            return Err(StudyError::Nothing);
        };
        let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
        let aspect = f64::from(width.max(height)) / f64::from(width.min(height).max(1));
        let frames = (2 * trials.len() * options.frames) as f64;
        let pixels = options.bytes as f64 / (frames * BYTES_A_PIXEL);
        let longest = (pixels * aspect).sqrt().clamp(SIDES[0], SIDES[1]) as u32;
        let mut path = small_orbit(model, options.frames.max(AROUND), longest)?;
        path.truncate(options.frames);
        Ok(Self {
            options,
            trials,
            path,
        })
    }

    /// Frames that [`StudyPlan::make`] renders or stylises, and reports.
    pub fn frames(&self) -> usize {
        let paintings = self.paintings().len();
        let stylised = self.stylised().len();
        self.path.len() * (1 + paintings.div_ceil(GROUP) + stylised)
    }

    /// Paintings that Impasto is shown with.
    pub(super) fn paintings(&self) -> BTreeSet<usize> {
        let ours = self
            .trials
            .iter()
            .filter(|t| t.sides.contains(&ClipKind::Ours));
        ours.map(|trial| trial.painting).collect()
    }

    /// Paintings and methods whose frames are needed, alone or as a video.
    pub(super) fn stylised(&self) -> BTreeSet<(usize, usize)> {
        let sides = self.trials.iter().flat_map(|trial| {
            let methods = trial.sides.iter().filter_map(|side| side.method());
            methods.map(|method| (trial.painting, method))
        });
        sides.collect()
    }
}
