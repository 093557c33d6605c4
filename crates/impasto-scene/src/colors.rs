//! Affine changes of colours: what exposure and white balance do to a photo, nearly.

use glam::{DMat4, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use crate::statistics::median;

/// An affine map of colours, three channels of any range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AffineColors(DMat4);

impl AffineColors {
    /// Changes nothing.
    pub const IDENTITY: Self = Self(DMat4::IDENTITY);

    /// Where a colour goes.
    pub fn apply(&self, colour: [f32; 3]) -> [f32; 3] {
        let colour = DVec3::from(colour.map(f64::from));
        self.0.transform_point3(colour).as_vec3().to_array()
    }

    /// The map that takes back what this one does; `None` if that cannot be told.
    pub fn inverse(&self) -> Option<Self> {
        let inverse = self.0.inverse();
        inverse.is_finite().then_some(Self(inverse))
    }

    /// This map after another one.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self(self.0 * first.0)
    }

    /// A map that does `share` of what this one does, 0 to 1.
    #[must_use]
    pub fn weakened(&self, share: f64) -> Self {
        Self(DMat4::IDENTITY * (1.0 - share) + self.0 * share)
    }

    /// The map whose numbers are the medians of those of some: what most of them agree on. The
    /// identity of none.
    pub fn median(maps: &[Self]) -> Self {
        let number = |i: usize| {
            let all = maps.iter().map(|map| map.0.as_ref()[i]);
            median(all).unwrap_or(DMat4::IDENTITY.as_ref()[i])
        };
        Self(DMat4::from_cols_array(&std::array::from_fn(number)))
    }
}

/// Sums over pairs of colours, of which the affine map from the first to the second is found by
/// least squares.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ColorPairs {
    /// Σ a aᵀ, of first colours with a one behind them.
    gram: DMat4,
    /// Σ a bᵀ.
    mixed: DMat4,
}

impl ColorPairs {
    /// None.
    pub const NONE: Self = Self {
        gram: DMat4::ZERO,
        mixed: DMat4::ZERO,
    };

    /// Adds a pair; one that is not of numbers does not count.
    pub fn add(&mut self, from: [f32; 3], to: [f32; 3]) {
        if !from.iter().chain(&to).all(|x| x.is_finite()) {
            return;
        }
        let [a, b] = [from, to].map(|[r, g, b]| DVec4::new(r.into(), g.into(), b.into(), 1.0));
        self.gram += DMat4::from_cols(a * a.x, a * a.y, a * a.z, a * a.w);
        self.mixed += DMat4::from_cols(a * b.x, a * b.y, a * b.z, a * b.w);
    }

    /// Lets all pairs so far count less.
    pub fn fade(&mut self, share: f64) {
        self.gram *= share;
        self.mixed *= share;
    }

    /// Root mean square of how far a map moves the first colours, over channels; 0 without pairs.
    pub fn moved_by(&self, map: &AffineColors) -> f64 {
        // E |Da|² = Σ over rows d of D of dᵀ E[a aᵀ] d.
        let change = (map.0 - DMat4::IDENTITY).transpose();
        let rows = [change.x_axis, change.y_axis, change.z_axis];
        let squares: f64 = rows.iter().map(|row| row.dot(self.gram * *row)).sum();
        (squares / (3.0 * self.count()).max(1e-12)).max(0.0).sqrt()
    }

    /// How much the pairs count together.
    pub fn count(&self) -> f64 {
        self.gram.w_axis.w
    }

    /// The map from first to second colours: of the least mean squared difference, to which
    /// `prior` times the squared distance from the identity is added.
    pub fn fit(&self, prior: f64) -> AffineColors {
        let least = DMat4::IDENTITY * (prior * self.count());
        let columns = (self.gram + least).inverse() * (self.mixed + least);
        if !columns.is_finite() {
            return AffineColors::IDENTITY;
        }
        let mut map = columns.transpose();
        // Exactly affine, whatever rounding said.
        (map.x_axis.w, map.y_axis.w, map.z_axis.w, map.w_axis.w) = (0.0, 0.0, 0.0, 1.0);
        AffineColors(map)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn colours() -> impl Iterator<Item = [f32; 3]> {
        let value = |i: usize| ((i * 37) % 101) as f32 / 101.0;
        (0..20).map(move |i| [value(i), value(3 * i + 1), value(7 * i + 2)])
    }

    fn near(a: [f32; 3], b: [f32; 3], tolerance: f32) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance)
    }

    fn fitted(change: impl Fn([f32; 3]) -> [f32; 3], prior: f64) -> AffineColors {
        let mut pairs = ColorPairs::NONE;
        colours().for_each(|colour| pairs.add(colour, change(colour)));
        pairs.fit(prior)
    }

    #[test]
    fn an_affine_change_is_found_and_taken_back() {
        let change = |[r, g, b]: [f32; 3]| [0.5 * r + 0.1, 0.9 * g + 0.2 * r, 0.7 * b - 0.05];
        let map = fitted(change, 0.0);
        let inverse = map.inverse().unwrap();
        for colour in colours() {
            assert!(near(map.apply(colour), change(colour), 1e-5));
            assert!(near(inverse.apply(change(colour)), colour, 1e-5));
            assert!(near(inverse.after(&map).apply(colour), colour, 1e-5));
        }
    }

    #[test]
    fn a_prior_holds_back_and_settles_what_pairs_leave_open() {
        let darker = |c: [f32; 3]| c.map(|x| 0.5 * x);
        let grey = |map: &AffineColors| map.apply([0.5; 3])[0];
        assert!((grey(&fitted(darker, 0.0)) - 0.25).abs() < 1e-5);
        assert!(grey(&fitted(darker, 0.1)) > 0.26 && grey(&fitted(darker, 1e6)) > 0.49);
        let mut one = ColorPairs::NONE;
        one.add([0.5; 3], [0.2; 3]);
        assert_eq!(one.fit(0.0), AffineColors::IDENTITY);
        assert!(near(one.fit(1e-6).apply([0.5; 3]), [0.2; 3], 1e-3));
        assert_eq!(ColorPairs::NONE.fit(1.0), AffineColors::IDENTITY);
    }

    #[test]
    fn how_far_a_map_moves_colours() {
        let mut pairs = ColorPairs::NONE;
        colours().for_each(|colour| pairs.add(colour, colour.map(|c| c + 0.1)));
        let map = pairs.fit(0.0);
        assert!((pairs.moved_by(&map) - 0.1).abs() < 1e-5);
        assert!((pairs.moved_by(&map.weakened(0.3)) - 0.03).abs() < 1e-5);
        assert_eq!(map.weakened(0.0), AffineColors::IDENTITY);
        assert_eq!(ColorPairs::NONE.moved_by(&map), 0.0);
    }

    #[test]
    fn pairs_that_are_no_numbers_do_not_count() {
        let mut pairs = ColorPairs::NONE;
        pairs.add([f32::NAN, 0.0, 0.0], [0.0; 3]);
        pairs.add([0.0; 3], [0.0, f32::INFINITY, 0.0]);
        assert_eq!(pairs, ColorPairs::NONE);
    }

    #[test]
    fn faded_pairs_count_less() {
        let mut pairs = ColorPairs::NONE;
        colours().for_each(|colour| pairs.add(colour, [0.0; 3]));
        pairs.fade(1e-9);
        colours().for_each(|colour| pairs.add(colour, colour));
        assert!(near(pairs.fit(0.0).apply([0.7; 3]), [0.7; 3], 1e-5));
        assert!((pairs.count() - 20.0).abs() < 1e-6);
    }

    #[test]
    fn medians_do_not_follow_the_odd_one() {
        let maps = [0.5f32, 1.0, 1.01].map(|k| fitted(move |c| c.map(|x| k * x), 0.0));
        let median = AffineColors::median(&maps);
        assert!(near(median.apply([0.4; 3]), [0.4; 3], 1e-4));
        assert_eq!(AffineColors::median(&[]), AffineColors::IDENTITY);
    }
}
