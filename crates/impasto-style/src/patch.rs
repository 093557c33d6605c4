//! Patch sub-sampling (PAPER §7): a sparse grid of pixels that stands for a view, or for a part.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// How far apart a patch's pixels lie.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PatchStrides {
    /// The paper's: each axis for itself, from half (down) or a third (across) of the largest
    /// stride that fits to all of it. Shows most of a view, coarsely, and stretched.
    Paper,
    /// One stride for both axes: a random multiple, within these bounds, of the stride at which
    /// the photo's shorter side has as many pixels as the pictures that paintings are measured on.
    /// Shows a part of a view at the scale at which its strokes are judged.
    Scale([f32; 2]),
}

/// Part of the largest stride that the paper's rule goes down to: ½ down, ⅓ across.
const PAPER_LEAST: [usize; 2] = [2, 3];

/// A grid of pixels: rows `top + i · down`, columns `left + j · across`, rounded down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Rows and columns of the grid.
    pub size: [usize; 2],
    /// First row.
    pub top: usize,
    /// First column.
    pub left: usize,
    /// Row stride, at least 1.
    pub down: f32,
    /// Column stride, at least 1.
    pub across: f32,
}

impl Patch {
    /// Row-major pixel indices in an image of the given width.
    pub fn pixels(&self, width: usize) -> impl Iterator<Item = usize> + '_ {
        let step = |i: usize, stride: f32| (i as f32 * stride) as usize;
        (0..self.size[0]).flat_map(move |i| {
            let row = (self.top + step(i, self.down)) * width + self.left;
            (0..self.size[1]).map(move |j| row + step(j, self.across))
        })
    }
}

/// Draws patches of one size.
#[derive(Debug, Clone, Copy)]
pub struct PatchSampler {
    /// Rows and columns of a patch.
    pub size: [usize; 2],
    /// Strides.
    pub strides: PatchStrides,
    /// Shorter side, in pixels, of the pictures that paintings are measured on.
    pub reference: usize,
}

impl PatchSampler {
    /// A random patch of an image, or `None` if the image is smaller than the patch.
    pub fn draw(&self, height: usize, width: usize, rng: &mut Pcg64) -> Option<Patch> {
        let extent = [height, width];
        let most = [0, 1].map(|axis| extent[axis] / self.size[axis].max(1));
        if most.contains(&0) {
            return None;
        }
        let [down, across] = match self.strides {
            PatchStrides::Paper => [0, 1].map(|axis| {
                let least = (most[axis] / PAPER_LEAST[axis]).max(1);
                rng.random_range(least..=most[axis]) as f32
            }),
            PatchStrides::Scale([least, greatest]) => {
                let unit = height.min(width) as f32 / self.reference.max(1) as f32;
                let fits = [0, 1].map(|axis| extent[axis] as f32 / self.size[axis] as f32);
                let stride = unit * (least + (greatest - least) * rng.random::<f32>());
                [stride.min(fits[0]).min(fits[1]).max(1.0); 2]
            }
        };
        let mut offset = |axis: usize, stride: f32| {
            let covered = ((self.size[axis] - 1) as f32 * stride) as usize + 1;
            rng.random_range(0..=extent[axis] - covered)
        };
        Some(Patch {
            size: self.size,
            top: offset(0, down),
            left: offset(1, across),
            down,
            across,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn sampler(strides: PatchStrides) -> PatchSampler {
        PatchSampler {
            size: [67, 81],
            strides,
            reference: 160,
        }
    }

    #[test]
    fn the_papers_patches_fit_and_use_every_stride() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut strides = std::collections::BTreeSet::new();
        for _ in 0..2000 {
            let patch = sampler(PatchStrides::Paper)
                .draw(368, 244, &mut rng)
                .unwrap();
            assert_eq!(patch.pixels(244).count(), 67 * 81);
            assert!(patch.pixels(244).max().unwrap() < 368 * 244);
            let last_column = patch.left + 80 * patch.across as usize;
            assert!(last_column < 244, "rows must not wrap around");
            strides.insert((patch.down as usize, patch.across as usize));
        }
        let expected = (2..=5).flat_map(|d| (1..=3).map(move |a| (d, a))).collect();
        assert_eq!(strides, expected);
    }

    #[test]
    fn scaled_patches_are_square_meshed_and_fit() {
        let mut rng = Pcg64::seed_from_u64(1);
        for (height, width) in [(368, 244), (90, 160), (67, 81), (1000, 82)] {
            for _ in 0..500 {
                let patch = sampler(PatchStrides::Scale([0.8, 1.4]))
                    .draw(height, width, &mut rng)
                    .unwrap();
                assert!(patch.down == patch.across && patch.down >= 1.0);
                assert!(patch.left + ((80.0 * patch.across) as usize) < width);
                assert!(patch.pixels(width).max().unwrap() < height * width);
            }
        }
    }

    #[test]
    fn refuses_images_smaller_than_a_patch() {
        let mut rng = Pcg64::seed_from_u64(1);
        for strides in [PatchStrides::Paper, PatchStrides::Scale([0.5, 1.0])] {
            assert_eq!(sampler(strides).draw(66, 500, &mut rng), None);
            assert!(sampler(strides).draw(67, 81, &mut rng).is_some());
        }
    }
}
