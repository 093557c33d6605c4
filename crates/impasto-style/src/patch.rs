//! Patch sub-sampling (PAPER §7): a sparse grid of pixels that stands for a view, or for a part.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// How far apart a patch's pixels lie.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PatchStrides {
    /// The paper's: each axis for itself, down and across, from the largest stride that fits
    /// divided by these (1/Λ, `[2, 3]` in the paper) to all of it. Shows most of a view, coarsely,
    /// and stretched.
    Paper([usize; 2]),
    /// One stride for both axes: a random multiple, within these bounds, of the stride at which
    /// the photo's shorter side has as many pixels as the pictures that paintings are measured on.
    /// Shows a part of a view at the scale at which its strokes are judged.
    Scale([f32; 2]),
}

/// A grid of cells: rows from `top + i · down`, columns from `left + j · across`, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Rows and columns of the grid.
    pub size: [usize; 2],
    /// Upper edge.
    pub top: usize,
    /// Left edge.
    pub left: usize,
    /// Row stride, at least 1.
    pub down: f32,
    /// Column stride, at least 1.
    pub across: f32,
}

impl Patch {
    /// Points of the image plane, `[x, y]` in pixels: `times × times` in every cell, row by row of
    /// the finer grid. Pixel (0, 0) covers `[0, 1) × [0, 1)`.
    pub fn points(&self, times: usize) -> impl Iterator<Item = [f32; 2]> + '_ {
        let at = move |start: usize, i: usize, stride: f32| {
            start as f32 + (i as f32 + 0.5) / times as f32 * stride
        };
        (0..self.size[0] * times).flat_map(move |i| {
            let y = at(self.top, i, self.down);
            (0..self.size[1] * times).map(move |j| [at(self.left, j, self.across), y])
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
            PatchStrides::Paper(parts) => [0, 1].map(|axis| {
                let least = (most[axis] / parts[axis].max(1)).max(1);
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
            let covered = ((self.size[axis] as f32 * stride).ceil() as usize).min(extent[axis]);
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

    /// Whether all points lie inside an image.
    fn fits(patch: &Patch, times: usize, height: usize, width: usize) -> bool {
        patch
            .points(times)
            .all(|[x, y]| x > 0.0 && x < width as f32 && y > 0.0 && y < height as f32)
    }

    #[test]
    fn fine_points_fit_and_average_to_the_cells_middles() {
        let mut rng = Pcg64::seed_from_u64(4);
        for strides in [PatchStrides::Paper([2, 3]), PatchStrides::Scale([0.8, 1.4])] {
            for (height, width) in [(67, 81), (244, 369), (369, 244), (700, 1000)] {
                let patch = sampler(strides).draw(height, width, &mut rng).unwrap();
                assert!(fits(&patch, 2, height, width) && fits(&patch, 1, height, width));
                let fine: Vec<[f32; 2]> = patch.points(2).collect();
                assert_eq!(fine.len(), 4 * 67 * 81);
                let middle = patch.points(1).nth(81 + 1).unwrap();
                let (above, below) = (2 * 162 + 2, 3 * 162 + 2);
                for axis in [0, 1] {
                    let four = [above, above + 1, below, below + 1].map(|i| fine[i][axis]);
                    assert!((four.iter().sum::<f32>() / 4.0 - middle[axis]).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn the_papers_patches_fit_and_use_every_stride() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut strides = std::collections::BTreeSet::new();
        for _ in 0..2000 {
            let patch = sampler(PatchStrides::Paper([2, 3]))
                .draw(368, 244, &mut rng)
                .unwrap();
            assert_eq!(patch.points(1).count(), 67 * 81);
            assert!(fits(&patch, 1, 368, 244));
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
                assert!(fits(&patch, 1, height, width));
            }
        }
    }

    #[test]
    fn refuses_images_smaller_than_a_patch() {
        let mut rng = Pcg64::seed_from_u64(1);
        for strides in [PatchStrides::Paper([2, 3]), PatchStrides::Scale([0.5, 1.0])] {
            assert_eq!(sampler(strides).draw(66, 500, &mut rng), None);
            assert!(sampler(strides).draw(67, 81, &mut rng).is_some());
        }
    }
}
