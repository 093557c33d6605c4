//! Detail without structure.

use crate::grid::Grid;
use rand::RngExt;
use rand_pcg::Pcg64;

/// Copies that a random-phase picture is made of.
const COPIES: usize = 48;
/// What is coarser than this share of the shorter side is no detail.
const COARSE: f32 = 1.0 / 16.0;

/// A picture's detail with its phases scrambled: its spectrum, and none of its structure. A sum of
/// copies moved and turned to their negative at random, around the edges (Galerne et al. 2011,
/// "Random Phase Textures": asymptotic discrete spot noise). Repeats without a seam.
pub(super) fn scrambled_detail(picture: &Grid<f32>, rng: &mut Pcg64) -> Grid<f32> {
    let detail = detail(picture);
    let (width, height) = (picture.width, picture.height);
    let mut values = vec![0.0f32; width * height];
    for _ in 0..COPIES {
        let (right, down) = (rng.random_range(0..width), rng.random_range(0..height));
        let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
        for (y, row) in values.chunks_exact_mut(width).enumerate() {
            let from = &detail[(y + down) % height * width..][..width];
            let (head, tail) = row.split_at_mut(width - right);
            let moved = from[right..].iter().chain(&from[..right]);
            let row = head.iter_mut().chain(tail);
            row.zip(moved).for_each(|(to, from)| *to += sign * from);
        }
    }
    let size = (COPIES as f32).sqrt().recip();
    values.iter_mut().for_each(|v| *v *= size);
    Grid { values, ..*picture }
}

/// A picture with so much of a repeating texture on it.
pub(super) fn with_texture(picture: &Grid<f32>, texture: &Grid<f32>, strength: f32) -> Grid<f32> {
    let pixels = picture.values.iter().enumerate().map(|(i, value)| {
        let (x, y) = (i % picture.width, i / picture.width);
        let at = y % texture.height * texture.width + x % texture.width;
        value + strength * texture.values[at]
    });
    Grid {
        values: pixels.collect(),
        ..*picture
    }
}

/// The picture less its blurred self.
fn detail(picture: &Grid<f32>) -> Vec<f32> {
    let side = picture.width.min(picture.height) as f32;
    let reach = ((COARSE * side).round() as usize).max(1);
    let mut soft = picture.clone();
    // Two box filters a direction are a triangle, near enough to a bell.
    for _ in 0..2 {
        soft = averaged_rows(&soft, reach).transposed();
        soft = averaged_rows(&soft, reach).transposed();
    }
    let pairs = picture.values.iter().zip(&soft.values);
    pairs.map(|(value, soft)| value - soft).collect()
}

/// Mean of the pixels of a row up to `reach` away, as far as there are any.
fn averaged_rows(picture: &Grid<f32>, reach: usize) -> Grid<f32> {
    let rows = picture.values.chunks_exact(picture.width);
    let averaged = rows.flat_map(|row| {
        let mut sums = vec![0.0f32];
        sums.extend(row.iter().scan(0.0, |sum, value| {
            *sum += value;
            Some(*sum)
        }));
        (0..row.len()).map(move |x| {
            let (from, to) = (x.saturating_sub(reach), (x + reach + 1).min(sums.len() - 1));
            (sums[to] - sums[from]) / (to - from) as f32
        })
    });
    Grid {
        values: averaged.collect(),
        ..*picture
    }
}

impl Grid<f32> {
    fn transposed(&self) -> Self {
        let columns = (0..self.width).flat_map(|x| (0..self.height).map(move |y| (x, y)));
        let values = columns.map(|(x, y)| self.values[y * self.width + x]);
        Self {
            values: values.collect(),
            width: self.height,
            height: self.width,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn correlation(values: &[f32], width: usize, [right, down]: [usize; 2]) -> f32 {
        let height = values.len() / width;
        let at = |x: usize, y: usize| values[y % height * width + x % width];
        let pairs = (0..values.len()).map(|i| {
            let (x, y) = (i % width, i / width);
            at(x, y) * at(x + right, y + down)
        });
        pairs.sum::<f32>() / values.iter().map(|v| v * v).sum::<f32>()
    }

    #[test]
    fn scrambling_keeps_the_spectrum_and_loses_the_place() {
        // Slanted stripes, eight pixels apart, on a slope.
        let picture = Grid {
            width: 64,
            height: 48,
            values: (0..64 * 48)
                .map(|i| {
                    let (x, y) = ((i % 64) as f32, (i / 64) as f32);
                    0.3 + 0.2 * ((x + y) * std::f32::consts::TAU / 8.0).sin() + 0.001 * x
                })
                .collect(),
        };
        let plain = detail(&picture);
        let mut rng = Pcg64::seed_from_u64(1);
        let scrambled = scrambled_detail(&picture, &mut rng);
        for shift in [[4, 4], [8, 0], [4, 0], [2, 2]] {
            let [a, b] = [&plain, &scrambled.values].map(|v| correlation(v, 64, shift));
            assert!((a - b).abs() < 0.15, "{shift:?}: {a} {b}");
        }
        let again = scrambled_detail(&picture, &mut rng);
        assert_ne!(scrambled, again, "another draw lies elsewhere");
        let mean = scrambled.values.iter().sum::<f32>() / scrambled.values.len() as f32;
        assert!(mean.abs() < 0.02, "{mean}");
    }
}
