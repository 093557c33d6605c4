//! Patch sub-sampling (PAPER §7): a sparse grid of pixels that stands for a whole view.

use rand::RngExt;
use rand_pcg::Pcg64;

/// Part of the strides that still shows enough of the view: ½ down, ⅓ across.
const LEAST_STRIDE: [usize; 2] = [2, 3];

/// A grid of pixels: rows `top + i · down`, columns `left + j · across`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patch {
    /// Rows and columns of the grid.
    pub size: [usize; 2],
    /// First row.
    pub top: usize,
    /// First column.
    pub left: usize,
    /// Row stride.
    pub down: usize,
    /// Column stride.
    pub across: usize,
}

impl Patch {
    /// Row-major pixel indices in an image of the given width.
    pub fn pixels(&self, width: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.size[0]).flat_map(move |i| {
            (0..self.size[1])
                .map(move |j| (self.top + i * self.down) * width + self.left + j * self.across)
        })
    }
}

/// Draws patches of one size.
#[derive(Debug, Clone, Copy)]
pub struct PatchSampler {
    /// Rows and columns of a patch.
    pub size: [usize; 2],
}

impl PatchSampler {
    /// A random patch of an image, or `None` if the image is smaller than the patch.
    pub fn draw(&self, height: usize, width: usize, rng: &mut Pcg64) -> Option<Patch> {
        let extent = [height, width];
        let mut stride = [1; 2];
        let mut offset = [0; 2];
        for axis in 0..2 {
            let most = extent[axis] / self.size[axis].max(1);
            if most == 0 {
                return None;
            }
            let least = (most / LEAST_STRIDE[axis]).max(1);
            stride[axis] = rng.random_range(least..=most);
            let covered = (self.size[axis] - 1) * stride[axis] + 1;
            offset[axis] = rng.random_range(0..=extent[axis] - covered);
        }
        Some(Patch {
            size: self.size,
            top: offset[0],
            left: offset[1],
            down: stride[0],
            across: stride[1],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn patches_fit_and_use_every_stride() {
        let sampler = PatchSampler { size: [67, 81] };
        let mut rng = Pcg64::seed_from_u64(1);
        let mut strides = std::collections::BTreeSet::new();
        for _ in 0..2000 {
            let patch = sampler.draw(368, 244, &mut rng).unwrap();
            assert_eq!(patch.pixels(244).count(), 67 * 81);
            assert!(patch.pixels(244).max().unwrap() < 368 * 244);
            let last_column = patch.left + 80 * patch.across;
            assert!(last_column < 244, "rows must not wrap around");
            strides.insert((patch.down, patch.across));
        }
        let expected = (2..=5).flat_map(|d| (1..=3).map(move |a| (d, a))).collect();
        assert_eq!(strides, expected);
    }

    #[test]
    fn refuses_images_smaller_than_a_patch() {
        let sampler = PatchSampler { size: [67, 81] };
        let mut rng = Pcg64::seed_from_u64(1);
        assert_eq!(sampler.draw(66, 500, &mut rng), None);
        assert!(sampler.draw(67, 81, &mut rng).is_some());
    }
}
