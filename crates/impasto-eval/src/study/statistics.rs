//! How sure a share is.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// The standard normal distribution's 97.5th percentile.
const Z: f64 = 1.959_963_984_540_054;
/// Resamples of participants.
const RESAMPLES: usize = 10_000;
/// Start of their random numbers: the same answers give the same interval.
const SEED: u64 = 95;
/// Shares that differ by less are the same: sums in another order.
const ROUNDING: f64 = 1e-9;

/// Wilson's 95 % interval of a share of `count` independent answers (Wilson 1927), of which
/// `successes` are for it, halves allowed; from 0 to 1 for no answer.
pub fn wilson(successes: f64, count: f64) -> [f64; 2] {
    if count <= 0.0 {
        return [0.0, 1.0];
    }
    let share = successes / count;
    let square = Z * Z / count;
    let centre = share + square / 2.0;
    let spread = Z * ((share * (1.0 - share) + square / 4.0) / count).sqrt();
    [centre - spread, centre + spread].map(|end| (end / (1.0 + square)).clamp(0.0, 1.0))
}

/// Two-sided exact sign test: how probable it is that `wins` and `losses` differ at least so much,
/// if either is as likely; 1 without any. Ties are left out beforehand.
pub fn sign_test(wins: usize, losses: usize) -> f64 {
    let (fewer, count) = (wins.min(losses), (wins + losses) as f64);
    // Logarithms, because 2^-count is no number for many answers.
    let mut ways = 0.0;
    let mut tail = 0.0;
    for k in 0..=fewer {
        if k > 0 {
            ways += ((count - k as f64 + 1.0) / k as f64).ln();
        }
        tail += (ways - count * std::f64::consts::LN_2).exp();
    }
    (2.0 * tail).min(1.0)
}

/// 95 % percentile interval over participants (cluster bootstrap, Efron and Tibshirani 1993): whole
/// participants are drawn with replacement, because the answers of one are not independent.
/// `statistic` is given the indices of those that were drawn. `None` if there are fewer than two, or
/// if every draw comes to the same: nothing is known of how much others would differ then.
pub(super) fn bootstrap(
    participants: usize,
    statistic: impl Fn(&[usize]) -> f64,
) -> Option<[f64; 2]> {
    if participants < 2 {
        return None;
    }
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut drawn = vec![0; participants];
    let mut found: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            drawn.fill_with(|| random.random_range(0..participants));
            statistic(&drawn)
        })
        .collect();
    found.sort_by(f64::total_cmp);
    let at = |share: f64| found[(share * (RESAMPLES - 1) as f64).round() as usize];
    (found[RESAMPLES - 1] - found[0] > ROUNDING).then(|| [at(0.025), at(0.975)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: [f64; 2], wanted: [f64; 2], tolerance: f64) {
        for (found, wanted) in found.into_iter().zip(wanted) {
            assert!((found - wanted).abs() < tolerance, "{found} for {wanted}");
        }
    }

    #[test]
    fn wilson_intervals_are_the_published_ones() {
        near(wilson(7.0, 10.0), [0.3968, 0.8922], 5e-5);
        near(wilson(0.0, 10.0), [0.0, 0.2775], 5e-5);
        near(wilson(81.0, 263.0), [0.2553, 0.3662], 5e-5);
        near(wilson(0.0, 0.0), [0.0, 1.0], 1e-12);
    }

    #[test]
    fn sign_tests_are_exact() {
        for (wins, losses, p) in [
            (0, 0, 1.0),
            (5, 5, 1.0),
            (10, 0, 2.0 / 1024.0),
            (0, 5, 0.0625),
            // 2 · (1 + 10 + 45) / 1024
            (8, 2, 0.109_375),
        ] {
            assert!(
                (sign_test(wins, losses) - p).abs() < 1e-12,
                "{wins}:{losses}"
            );
        }
        // Close to the normal approximation: (1100 − 1000 − ½) / √500 = 4.45.
        let many = sign_test(1100, 900);
        assert!((7.5e-6..1.0e-5).contains(&many), "{many}");
    }

    #[test]
    fn an_interval_over_participants_is_theirs() {
        // The mean of ten participants' shares, whose standard error is √(0.2 · 0.8 / 10) = 0.126.
        let shares = [1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0];
        let mean =
            |drawn: &[usize]| drawn.iter().map(|i| shares[*i]).sum::<f64>() / drawn.len() as f64;
        near(bootstrap(10, mean).unwrap(), [0.5, 1.0], 1e-9);
        assert_eq!(bootstrap(10, mean), bootstrap(10, mean));
        assert_eq!(bootstrap(1, |_| 0.7), None);
        assert_eq!(bootstrap(5, |_| 0.7), None);
        let rounded = |drawn: &[usize]| 0.7 + 2e-16 * drawn[0] as f64;
        assert_eq!(bootstrap(5, rounded), None);
    }
}
