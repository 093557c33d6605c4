//! Which pairs of clips are shown, and which of the two is A.

use crate::methods::Stylizer;
use crate::names::{OURS, PHOTO};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

/// Whose clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ClipKind {
    /// Impasto's.
    Ours,
    /// The unstylised render.
    Photo,
    /// That method's, frame by frame.
    Frames(usize),
    /// That method's, as a video.
    Video(usize),
}

impl ClipKind {
    /// Its name in the key.
    pub(super) fn name(self, against: &[&dyn Stylizer]) -> String {
        match self {
            Self::Ours => OURS.to_owned(),
            Self::Photo => PHOTO.to_owned(),
            Self::Frames(method) => against[method].name().to_owned(),
            Self::Video(method) => against[method].video_name(),
        }
    }

    /// The compared method's index.
    pub(super) fn method(self) -> Option<usize> {
        match self {
            Self::Ours | Self::Photo => None,
            Self::Frames(method) | Self::Video(method) => Some(method),
        }
    }
}

/// Two clips side by side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Trial {
    /// Index of the painting.
    pub(super) painting: usize,
    /// What is shown as A and as B.
    pub(super) sides: [ClipKind; 2],
}

/// Pairs of paintings and methods, in random order. With fewer questions than there are pairs, every
/// method gets its share, over as many paintings as possible. Sides are random, with every method on
/// either side equally often, or once more.
pub(super) fn trials(
    [paintings, methods]: [usize; 2],
    [questions, catches]: [usize; 2],
    random: &mut Pcg64,
) -> Vec<Trial> {
    let mut order: Vec<usize> = (0..paintings).collect();
    order.shuffle(random);
    let variants =
        (0..methods).flat_map(|method| [ClipKind::Frames(method), ClipKind::Video(method)]);
    let variants: Vec<ClipKind> = variants.collect();
    let questions = questions.min(paintings * variants.len());
    let asked = (0..questions).map(|k| {
        let (turn, round) = (k % paintings, k / paintings);
        let variant = variants[(turn + round) % variants.len()];
        (order[turn], [ClipKind::Ours, variant])
    });
    // On paintings that are rendered anyway.
    let catches = if questions == 0 { 0 } else { catches };
    let caught = (0..catches).map(|k| {
        let method = ClipKind::Frames(k % methods);
        (
            order[k % questions.min(paintings)],
            [ClipKind::Photo, method],
        )
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
    let mut kinds: BTreeMap<[ClipKind; 2], Vec<&mut Trial>> = BTreeMap::new();
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
    use rand::SeedableRng;
    use std::collections::BTreeSet;

    fn plan(size: [usize; 2], counts: [usize; 2], seed: u64) -> Vec<Trial> {
        trials(size, counts, &mut Pcg64::seed_from_u64(seed))
    }

    fn count(trials: &[Trial], of: impl Fn(&Trial) -> bool) -> usize {
        trials.iter().filter(|trial| of(trial)).count()
    }

    #[test]
    fn sides_are_balanced_for_every_method_and_over_all() {
        for seed in 0..20 {
            for questions in 1..=20 {
                let all = plan([5, 2], [questions, 3], seed);
                assert_eq!(all.len(), questions + 3);
                let on = |side: usize, shown| count(&all, |trial| trial.sides[side] == shown);
                assert!(on(0, ClipKind::Ours).abs_diff(on(1, ClipKind::Ours)) <= 1);
                assert_eq!(on(0, ClipKind::Photo).abs_diff(on(1, ClipKind::Photo)), 1);
                for method in [ClipKind::Video(0), ClipKind::Video(1)] {
                    assert!(on(0, method).abs_diff(on(1, method)) <= 1);
                }
            }
        }
    }

    #[test]
    fn every_pair_comes_once_and_few_questions_are_spread() {
        let all = plan([3, 2], [99, 0], 4);
        let mut pairs: Vec<_> = all
            .iter()
            .map(|trial| {
                let other = trial.sides.into_iter().find(|side| *side != ClipKind::Ours);
                (trial.painting, other)
            })
            .collect();
        pairs.sort();
        pairs.dedup();
        assert_eq!((pairs.len(), all.len()), (12, 12));

        let few = plan([10, 1], [6, 0], 4);
        let paintings: BTreeSet<_> = few.iter().map(|trial| trial.painting).collect();
        assert_eq!(paintings.len(), 6);
        let frames = |trial: &Trial| trial.sides.contains(&ClipKind::Frames(0));
        assert_eq!(count(&few, frames), 3);
    }

    #[test]
    fn chance_is_the_seeds_and_nothing_gives_nothing() {
        let of = |seed| plan([4, 1], [8, 1], seed);
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
        for (size, counts) in [([0, 1], [5, 1]), ([3, 0], [5, 1]), ([3, 1], [0, 2])] {
            assert!(plan(size, counts, 0).is_empty());
        }
    }
}
