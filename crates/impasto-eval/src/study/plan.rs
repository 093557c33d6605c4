//! Which pairs of clips are shown, and which of the two is A.

use super::clips::Shown;
use super::{Study, StudyError, clips, html};
use crate::bench::GROUP;
use crate::methods::Stylizer;
use crate::path::small_orbit;
use image::RgbImage;
use impasto_scene::{Camera, Split};
use impasto_train::Model;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::{BTreeMap, BTreeSet};

/// Frames of a whole orbit, of which a clip shows the first: steps small enough to look like
/// motion.
const AROUND: usize = 120;
/// Bytes of the page for a pixel of a clip: JPEG at [`clips::QUALITY`] of busy pictures, as base64.
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

/// Two clips side by side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Trial {
    /// Index of the painting.
    pub(super) painting: usize,
    /// What is shown as A and as B.
    pub(super) sides: [Shown; 2],
}

/// A study that can be filmed.
pub struct Plan<'a> {
    pub(super) options: StudyOptions<'a>,
    pub(super) trials: Vec<Trial>,
    /// Cameras of every clip.
    pub(super) path: Vec<Camera>,
}

impl<'a> Plan<'a> {
    /// Chooses pairs and the size of their clips.
    ///
    /// # Errors
    /// If there is nothing to compare, or no walk can be fitted to the model's cameras.
    pub fn new(model: &Model, options: StudyOptions<'a>) -> Result<Self, StudyError> {
        let mut random = Pcg64::seed_from_u64(options.seed);
        let size = (options.paintings.len(), options.against.len());
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

    /// Frames that [`Plan::make`] renders or stylises, and tells of.
    pub fn frames(&self) -> usize {
        let paintings = self.paintings().len();
        let stylised = self.stylised().len();
        self.path.len() * (1 + paintings.div_ceil(GROUP) + stylised)
    }

    /// Renders and stylises every clip and puts them into a page. `tick` hears of every frame.
    ///
    /// # Errors
    /// If the model has no style stage, or a frame cannot be encoded.
    pub fn make(&self, model: &Model, tick: &mut dyn FnMut()) -> Result<Study, StudyError> {
        if !model.has_style() {
            return Err(crate::EvalError::Unstyled.into());
        }
        let clips = clips::film(model, self, tick)?;
        html::study(self, model.file.scene.synthetic, &clips)
    }

    /// Paintings that Impasto is shown with.
    pub(super) fn paintings(&self) -> BTreeSet<usize> {
        let ours = self
            .trials
            .iter()
            .filter(|t| t.sides.contains(&Shown::Ours));
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

/// Pairs of paintings and methods, in random order. With fewer questions than there are pairs, every
/// method gets its share, over as many paintings as possible. Sides are random, with every method on
/// either side equally often, or once more.
fn trials(
    (paintings, methods): (usize, usize),
    [questions, catches]: [usize; 2],
    random: &mut Pcg64,
) -> Vec<Trial> {
    let mut order: Vec<usize> = (0..paintings).collect();
    order.shuffle(random);
    let variants = (0..methods).flat_map(|method| [Shown::Frames(method), Shown::Video(method)]);
    let variants: Vec<Shown> = variants.collect();
    let questions = questions.min(paintings * variants.len());
    let asked = (0..questions).map(|k| {
        let (turn, round) = (k % paintings, k / paintings);
        let variant = variants[(turn + round) % variants.len()];
        (order[turn], [Shown::Ours, variant])
    });
    // On paintings that are rendered anyway.
    let catches = if questions == 0 { 0 } else { catches };
    let caught = (0..catches).map(|k| {
        let method = Shown::Frames(k % methods);
        (order[k % questions.min(paintings)], [Shown::Photo, method])
    });
    let mut trials: Vec<Trial> = asked
        .chain(caught)
        .map(|(painting, sides)| Trial { painting, sides })
        .collect();
    balance(&mut trials, random);
    trials.shuffle(random);
    trials
}

/// Swaps the sides of half of every kind of pair.
fn balance(trials: &mut [Trial], random: &mut Pcg64) {
    let mut kinds: BTreeMap<[Shown; 2], Vec<&mut Trial>> = BTreeMap::new();
    for trial in trials {
        kinds.entry(trial.sides).or_default().push(trial);
    }
    let mut larger: bool = random.random();
    for alike in kinds.values_mut() {
        alike.shuffle(random);
        let half = (alike.len() + usize::from(larger)) / 2;
        alike.iter_mut().take(half).for_each(|t| t.sides.reverse());
        // What is left over of odd kinds evens out over them.
        larger ^= alike.len() % 2 == 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(size: (usize, usize), counts: [usize; 2], seed: u64) -> Vec<Trial> {
        trials(size, counts, &mut Pcg64::seed_from_u64(seed))
    }

    fn count(trials: &[Trial], of: impl Fn(&Trial) -> bool) -> usize {
        trials.iter().filter(|trial| of(trial)).count()
    }

    #[test]
    fn sides_are_balanced_for_every_method_and_over_all() {
        for seed in 0..20 {
            for questions in 1..=20 {
                let all = plan((5, 2), [questions, 3], seed);
                assert_eq!(all.len(), questions + 3);
                let on = |side: usize, shown| count(&all, |trial| trial.sides[side] == shown);
                assert!(on(0, Shown::Ours).abs_diff(on(1, Shown::Ours)) <= 1);
                assert_eq!(on(0, Shown::Photo).abs_diff(on(1, Shown::Photo)), 1);
                for method in [Shown::Video(0), Shown::Video(1)] {
                    assert!(on(0, method).abs_diff(on(1, method)) <= 1);
                }
            }
        }
    }

    #[test]
    fn every_pair_comes_once_and_few_questions_are_spread() {
        let all = plan((3, 2), [99, 0], 4);
        let mut pairs: Vec<_> = all
            .iter()
            .map(|trial| {
                let other = trial.sides.into_iter().find(|side| *side != Shown::Ours);
                (trial.painting, other)
            })
            .collect();
        pairs.sort();
        pairs.dedup();
        assert_eq!((pairs.len(), all.len()), (12, 12));

        let few = plan((10, 1), [6, 0], 4);
        let paintings: BTreeSet<_> = few.iter().map(|trial| trial.painting).collect();
        assert_eq!(paintings.len(), 6);
        let frames = |trial: &Trial| trial.sides.contains(&Shown::Frames(0));
        assert_eq!(count(&few, frames), 3);
    }

    #[test]
    fn chance_is_the_seeds_and_nothing_gives_nothing() {
        let of = |seed| plan((4, 1), [8, 1], seed);
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
        for (size, counts) in [((0, 1), [5, 1]), ((3, 0), [5, 1]), ((3, 1), [0, 2])] {
            assert!(plan(size, counts, 0).is_empty());
        }
    }
}
