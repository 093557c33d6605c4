//! Colours of pictures as mean and covariance, and the linear map between two of them.

use crate::config::STYLE_SIDE;
use glam::{DMat3, DVec3};
use image::RgbImage;
use impasto_field::Palette;
use impasto_style::{picture, square_crop};
use serde::{Deserialize, Serialize};

/// Mean and covariance of RGB colours in `[0, 1]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ColorStatistics {
    mean: DVec3,
    covariance: DMat3,
}

/// An affine map of colours.
#[derive(Debug, Clone, Copy)]
pub struct ColorTransfer {
    matrix: DMat3,
    from: DVec3,
    to: DVec3,
}

/// Variance that every colour direction has at least, so that grey pictures can be mapped.
const LEAST_VARIANCE: f64 = 1e-4;
/// Rounds of the square root's iteration, which doubles its digits in each.
const ROUNDS: usize = 30;
/// Contrast is multiplied by no more than this: noise would be, too.
const MOST_GAIN: f64 = 3.0;

impl ColorStatistics {
    /// Those of pixels, three numbers each.
    pub fn of<'a>(pixels: impl Iterator<Item = &'a [f32]> + Clone) -> Self {
        let colours = pixels.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()));
        let count = (colours.clone().count() as f64).max(1.0);
        let mean = colours.clone().sum::<DVec3>() / count;
        let covariance = colours.fold(DMat3::ZERO, |sum, c| {
            let d = c - mean;
            sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
        });
        Self {
            mean,
            covariance: covariance * (1.0 / count)
                + DMat3::from_diagonal(DVec3::splat(LEAST_VARIANCE)),
        }
    }

    /// Those of a painting's middle square.
    pub fn of_picture(painting: &RgbImage) -> Self {
        let square = square_crop(painting, 1.0, (0.5, 0.5), STYLE_SIDE);
        Self::of(picture(&square).chunks_exact(3))
    }

    /// How many numbers it is made of.
    pub const NUMBERS: usize = 9;

    /// All of it: the mean, then the covariance's upper triangle by rows.
    pub fn numbers(&self) -> [f64; Self::NUMBERS] {
        let (m, c) = (self.mean, self.covariance);
        let [x, y, z] = [c.x_axis, c.y_axis, c.z_axis];
        [m.x, m.y, m.z, x.x, x.y, x.z, y.y, y.z, z.z]
    }

    /// The inverse of [`Self::numbers`].
    pub fn of_numbers(n: &[f64; Self::NUMBERS]) -> Self {
        Self {
            mean: DVec3::new(n[0], n[1], n[2]),
            covariance: DMat3::from_cols(
                DVec3::new(n[3], n[4], n[5]),
                DVec3::new(n[4], n[6], n[7]),
                DVec3::new(n[5], n[7], n[8]),
            ),
        }
    }

    /// `self` and `other` mixed linearly, `share` of the latter.
    pub fn mixed(&self, other: &Self, share: f32) -> Self {
        let share = f64::from(share);
        Self {
            mean: self.mean.lerp(other.mean, share),
            covariance: self.covariance * (1.0 - share) + other.covariance * share,
        }
    }

    /// The linear map that gives colours of these statistics the mean and covariance of `other` and
    /// moves them least: Monge–Kantorovich (Pitié & Kokaram 2007).
    pub fn transfer_to(&self, other: &Self) -> ColorTransfer {
        let root = square_root(self.covariance);
        let inverse = root.inverse();
        let between = square_root(root * other.covariance * root);
        let matrix = inverse * between * inverse;
        let gain = matrix
            .to_cols_array()
            .iter()
            .fold(0.0f64, |most, x| most.max(x.abs()));
        ColorTransfer {
            matrix: matrix * (MOST_GAIN / gain.max(MOST_GAIN)),
            from: self.mean,
            to: other.mean,
        }
    }
}

impl ColorStatistics {
    /// The way of colours of these statistics into the whitened colours of a painting, and from there to
    /// its own.
    pub fn palette_of(&self, painting: &Self) -> Palette {
        let transfer = self.transfer_to(painting);
        let root = square_root(painting.covariance);
        let inverse = root.inverse();
        let into = inverse * transfer.matrix;
        Palette {
            whitened: rows(into, -(into * transfer.from)),
            coloured: rows(root, painting.mean),
        }
    }
}

/// An affine map row by row, what is added last.
fn rows(matrix: DMat3, added: DVec3) -> [[f32; 4]; 3] {
    [0, 1, 2].map(|i| {
        let row = matrix.row(i);
        [row.x, row.y, row.z, added[i]].map(|x| x as f32)
    })
}

impl ColorTransfer {
    /// Moves colours only part of the way: all of it at a strength of 1.
    pub fn scaled(&self, strength: f32) -> Self {
        let strength = f64::from(strength);
        let (from, to) = (self.from, self.from.lerp(self.to, strength));
        let matrix = self.matrix * strength + DMat3::IDENTITY * (1.0 - strength);
        Self { matrix, from, to }
    }

    /// The mapped colours, clamped to `[0, 1]`.
    pub fn apply(&self, pixels: &[f32]) -> Vec<f32> {
        pixels
            .chunks_exact(3)
            .flat_map(|p| {
                let colour = DVec3::new(p[0].into(), p[1].into(), p[2].into());
                let mapped = self.matrix * (colour - self.from) + self.to;
                mapped.clamp(DVec3::ZERO, DVec3::ONE).as_vec3().to_array()
            })
            .collect()
    }
}

/// The principal square root of a positive definite matrix (Denman–Beavers iteration).
fn square_root(matrix: DMat3) -> DMat3 {
    let (mut y, mut z) = (matrix, DMat3::IDENTITY);
    for _ in 0..ROUNDS {
        (y, z) = ((y + z.inverse()) * 0.5, (z + y.inverse()) * 0.5);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn colours(seed: u64, spread: [f32; 3]) -> Vec<f32> {
        let mut rng = Pcg64::seed_from_u64(seed);
        (0..3000)
            .flat_map(|_| {
                let common: f32 = rng.random();
                [0, 1, 2].map(|c| 0.3 + spread[c] * (common + 0.5 * rng.random::<f32>()))
            })
            .collect()
    }

    #[test]
    fn recoloured_pixels_have_the_other_palette() {
        let (photo, painting) = (colours(1, [0.1, 0.2, 0.3]), colours(2, [0.3, 0.1, 0.2]));
        let palette = |pixels: &[f32]| ColorStatistics::of(pixels.chunks_exact(3));
        let wanted = palette(&painting);
        let found = palette(&palette(&photo).transfer_to(&wanted).apply(&photo));
        assert!((found.mean - wanted.mean).length() < 1e-3);
        let far = (found.covariance - wanted.covariance).to_cols_array();
        assert!(far.iter().all(|d| d.abs() < 2e-3), "{far:?}");
    }

    #[test]
    fn a_palette_leads_through_whitened_colours_to_the_painting() {
        let (photo, painting) = (colours(1, [0.5, 0.5, 0.7]), colours(2, [0.7, 0.5, 0.5]));
        let of = |pixels: &[f32]| ColorStatistics::of(pixels.chunks_exact(3));
        let palette = of(&photo).palette_of(&of(&painting));
        let through = |map: &[[f32; 4]; 3], pixel: &[f32]| {
            map.map(|[x, y, z, added]| x * pixel[0] + y * pixel[1] + z * pixel[2] + added)
        };
        let whitened: Vec<f32> = photo
            .chunks_exact(3)
            .flat_map(|pixel| through(&palette.whitened, pixel))
            .collect();
        let found = of(&whitened);
        assert!(found.mean.length() < 1e-3, "{found:?}");
        let far = (found.covariance - DMat3::IDENTITY).to_cols_array();
        assert!(far.iter().all(|d| d.abs() < 0.05), "{far:?}");
        let wanted = of(&photo).transfer_to(&of(&painting)).apply(&photo);
        for (whitened, wanted) in whitened.chunks_exact(3).zip(wanted.chunks_exact(3)) {
            let found = through(&palette.coloured, whitened).map(|c| c.clamp(0.0, 1.0));
            let mut pairs = found.iter().zip(wanted);
            assert!(
                pairs.all(|(a, b)| (a - b).abs() < 1e-3),
                "{found:?} {wanted:?}"
            );
        }
    }

    #[test]
    fn a_softened_map_goes_part_of_the_way() {
        let palette = |seed| ColorStatistics::of(colours(seed, [0.2; 3]).chunks_exact(3));
        let map = palette(1).transfer_to(&ColorStatistics {
            mean: DVec3::splat(0.6),
            ..palette(2)
        });
        let pixels = [0.4, 0.5, 0.45];
        let (all, half, none) = (
            map.apply(&pixels),
            map.scaled(0.5).apply(&pixels),
            map.scaled(0.0).apply(&pixels),
        );
        for c in 0..3 {
            assert!((none[c] - pixels[c]).abs() < 1e-6);
            assert!((half[c] - 0.5 * (pixels[c] + all[c])).abs() < 1e-6);
        }
    }

    #[test]
    fn one_colour_and_no_pixel_give_finite_maps() {
        let grey = ColorStatistics::of([0.5f32; 30].chunks_exact(3));
        let none = ColorStatistics::of(std::iter::empty());
        for (a, b) in [(grey, none), (none, grey), (grey, grey)] {
            let mapped = a.transfer_to(&b).apply(&[0.2, 0.5, 0.9]);
            assert!(mapped.iter().all(|c| (0.0..=1.0).contains(c)));
        }
    }
}
