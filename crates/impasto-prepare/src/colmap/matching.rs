//! Which photos are compared, and how long that takes.

use crate::options::Matching;

/// Up to so many photos, all pairs are compared where nothing else is asked for: a quarter of an
/// hour on two cores, and no overlap is missed.
const FEW: usize = 80;
/// Core-seconds for a pair of photos, per feature of the one and of the other. (Measured with
/// COLMAP 3.8: 435 pairs of 5300 features took two cores 120 s.)
const PAIR_COST: f64 = 2e-8;
/// Neighbours to each side that the sequential matcher looks at, and as many more at distances of
/// 2, 4, 8 …
const NEIGHBOURS: usize = 10;

/// Which photos are compared with which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MatchingPlan {
    /// All pairs.
    Exhaustive,
    /// Neighbours in the order of names.
    Sequential,
}

impl MatchingPlan {
    /// Its name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Exhaustive => "exhaustive",
            Self::Sequential => "sequential",
        }
    }

    /// COLMAP's command.
    pub(super) fn command(self) -> &'static str {
        match self {
            Self::Exhaustive => "exhaustive_matcher",
            Self::Sequential => "sequential_matcher",
        }
    }

    /// About how many pairs of `photos` photos are compared.
    pub(crate) fn pairs(self, photos: usize) -> usize {
        let all = photos * photos.saturating_sub(1) / 2;
        match self {
            Self::Exhaustive => all,
            Self::Sequential => all.min(photos * 2 * NEIGHBOURS),
        }
    }

    /// About how many seconds that takes.
    pub(crate) fn seconds(self, photos: usize, features: f64, threads: usize) -> f64 {
        self.pairs(photos) as f64 * features * features * PAIR_COST / threads.max(1) as f64
    }
}

/// Decides which photos are compared. `names` are sorted; `video` says that they are frames of one.
pub(crate) fn plan(matching: Matching, names: &[String], video: bool) -> MatchingPlan {
    match matching {
        Matching::Exhaustive => MatchingPlan::Exhaustive,
        Matching::Sequential => MatchingPlan::Sequential,
        Matching::Auto if video => MatchingPlan::Sequential,
        Matching::Auto if names.len() > FEW && are_in_order(names) => MatchingPlan::Sequential,
        Matching::Auto => MatchingPlan::Exhaustive,
    }
}

/// Whether names look as if photos had been taken one after the other: numbers that mostly go up by
/// little. (Without leading zeros, 10 comes before 2, for COLMAP too: that is no order.)
fn are_in_order(names: &[String]) -> bool {
    let mut widths = names.iter().filter_map(|name| Some(numbered(name)?.2));
    let first = widths.next();
    if widths.any(|width| Some(width) != first) {
        return false;
    }
    let steps = names
        .windows(2)
        .filter(|pair| match (numbered(&pair[0]), numbered(&pair[1])) {
            (Some((a, i, _)), Some((b, j, _))) => a == b && (1..=3).contains(&j.saturating_sub(i)),
            _ => false,
        });
    // Some photos are thrown away, and counters begin anew.
    10 * steps.count() >= 8 * names.len().saturating_sub(1)
}

/// A name's beginning, the last number in it, and how many digits that has.
fn numbered(name: &str) -> Option<(&str, u64, usize)> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end]
        .trim_end_matches(|c: char| c.is_ascii_digit())
        .len();
    Some((&name[..start], name[start..end].parse().ok()?, end - start))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(count: usize, name: impl Fn(usize) -> String) -> Vec<String> {
        let mut names: Vec<String> = (0..count).map(name).collect();
        names.sort();
        names
    }

    #[test]
    fn few_photos_are_all_compared_and_long_walks_in_order() {
        let walk = |count| names(count, |i| format!("walk/IMG_{:04}.JPG", 2 * i + 7));
        assert_eq!(
            plan(Matching::Auto, &walk(80), false),
            MatchingPlan::Exhaustive
        );
        assert_eq!(
            plan(Matching::Auto, &walk(81), false),
            MatchingPlan::Sequential
        );
        assert_eq!(
            plan(Matching::Auto, &walk(9), true),
            MatchingPlan::Sequential
        );
        assert_eq!(
            plan(Matching::Exhaustive, &walk(900), true),
            MatchingPlan::Exhaustive
        );
    }

    #[test]
    fn names_without_an_order_are_all_compared() {
        let random = names(200, |i| {
            format!("{:08x}.jpg", i * 2_654_435_761 % 4_294_967_291)
        });
        assert_eq!(
            plan(Matching::Auto, &random, false),
            MatchingPlan::Exhaustive
        );
        let unpadded = names(200, |i| format!("IMG_{i}.jpg"));
        assert_eq!(
            plan(Matching::Auto, &unpadded, false),
            MatchingPlan::Exhaustive
        );
    }

    #[test]
    fn an_estimate_is_of_the_right_size() {
        let seconds = MatchingPlan::Exhaustive.seconds(30, 5300.0, 2);
        assert!((60.0..240.0).contains(&seconds), "{seconds}");
        assert!(MatchingPlan::Sequential.pairs(1000) < MatchingPlan::Exhaustive.pairs(1000) / 10);
    }
}
