//! A painting's own detail, to be laid over surfaces.

use crate::color::ColorStatistics;
use image::RgbImage;
use impasto_kernels::cpu::exemplar::{FEATURES, PARAMS, SIDE};
use impasto_style::{picture, square_crop};

/// Radii, in texels, of the means that a picture is split into bands by.
const BANDS: [usize; 3] = [1, 4, 10];
/// Whitened colours farther out are the lights and darks of a few pixels.
const FARTHEST: f32 = 3.0;
/// Of most paintings.
const MEAN_STRENGTH: f32 = 0.8;

/// A painting's own detail: of its middle square, in whitened colours, bands that means over about three, nine
/// and 21 texels split, three numbers each from fine to coarse; then how much there is of every band
/// around. See [`impasto_kernels::cpu::exemplar`].
///
/// # Shapes
/// Result: [`PARAMS`], `[y][x][feature]`.
pub fn exemplar(painting: &RgbImage) -> Vec<f32> {
    let side = SIDE as u32;
    if painting.dimensions() == (side, side) {
        return of_pixels(&picture(painting));
    }
    of_pixels(&picture(&square_crop(painting, 1.0, (0.5, 0.5), side)))
}

/// Weighted sum of exemplars, those of positive weight, as strong as each: their detail has nothing to do
/// with each other.
pub fn mixed_exemplars<'a>(all: impl Iterator<Item = (&'a [f32], f32)> + Clone) -> Vec<f32> {
    let seen = all.filter(|(_, weight)| *weight > 0.0);
    let length = seen.clone().map(|(_, w)| w * w).sum::<f32>().sqrt();
    let mut sum = vec![0.0; PARAMS];
    for (one, weight) in seen {
        let share = weight / length;
        sum.iter_mut()
            .zip(one)
            .for_each(|(sum, x)| *sum += share * x);
    }
    sum
}

fn of_pixels(pixels: &[f32]) -> Vec<f32> {
    let colors = ColorStatistics::of(pixels.chunks_exact(3));
    let white = colors.palette_of(&colors).whitened;
    let whitened = pixels.chunks_exact(3).map(|c| {
        white.map(|row| {
            let u = row[0] * c[0] + row[1] * c[1] + row[2] * c[2] + row[3];
            u.clamp(-FARTHEST, FARTHEST)
        })
    });
    let whitened: Vec<[f32; 3]> = whitened.collect();
    let [fine, middle, coarse] = BANDS.map(|radius| smoothed(&whitened, radius));
    let bands = [(&whitened, &fine), (&fine, &middle), (&middle, &coarse)];
    let bands = bands.map(|(of, mean)| {
        let off = of.iter().zip(mean);
        off.map(|(x, m)| [x[0] - m[0], x[1] - m[1], x[2] - m[2]])
            .collect::<Vec<_>>()
    });
    let strength: Vec<[f32; 3]> = (0..SIDE * SIDE)
        .map(|i| std::array::from_fn(|band| bands[band][i].iter().map(|x| x.abs()).sum()))
        .collect();
    let strength = smoothed(&strength, BANDS[1]);
    let texel = |i: usize| -> [f32; FEATURES] {
        std::array::from_fn(|f| match bands.get(f / 3) {
            Some(band) => band[i][f % 3],
            None => strength[i][f % 3] - MEAN_STRENGTH,
        })
    };
    (0..SIDE * SIDE).flat_map(texel).collect()
}

/// Means over squares, twice, which is about a bell; beyond the border the outermost pixels count again.
fn smoothed(pixels: &[[f32; 3]], radius: usize) -> Vec<[f32; 3]> {
    let reach = radius as isize;
    let share = 1.0 / (2 * radius + 1) as f32;
    let mut out = pixels.to_vec();
    for step in [1, SIDE, 1, SIDE] {
        let across = if step == 1 { SIDE } else { 1 };
        let before = out.clone();
        for line in 0..SIDE {
            let at = |i: isize| line * across + i.clamp(0, SIDE as isize - 1) as usize * step;
            let mut sum = [0f32; 3];
            for i in -reach..=reach {
                (0..3).for_each(|c| sum[c] += before[at(i)][c]);
            }
            for i in 0..SIDE as isize {
                out[at(i)] = sum.map(|x| x * share);
                let (gone, new) = (before[at(i - reach)], before[at(i + reach + 1)]);
                (0..3).for_each(|c| sum[c] += new[c] - gone[c]);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn striped() -> RgbImage {
        let side = SIDE as u32;
        RgbImage::from_fn(side, side, |x, y| {
            let wave = |length: f32| (x as f32 / length).sin() * 40.0 + 128.0;
            image::Rgb([wave(1.0) as u8, wave(9.0) as u8, (y / 2) as u8 + 60])
        })
    }

    #[test]
    fn bands_are_what_a_mean_leaves() {
        let pixels = picture(&striped());
        let colors = ColorStatistics::of(pixels.chunks_exact(3));
        let white = colors.palette_of(&colors).whitened;
        let whitened = pixels
            .chunks_exact(3)
            .map(|c| white.map(|row| row[0] * c[0] + row[1] * c[1] + row[2] * c[2] + row[3]));
        let whitened: Vec<[f32; 3]> = whitened.collect();
        let mean = smoothed(&whitened, BANDS[2]);
        let found = exemplar(&striped());
        for (i, texel) in found.chunks_exact(FEATURES).enumerate() {
            for c in 0..3 {
                let sum = texel[c] + texel[3 + c] + texel[6 + c];
                let wanted = whitened[i][c] - mean[i][c];
                assert!((sum - wanted).abs() < 1e-3, "{i}: {sum} {wanted}");
            }
        }
        // Red waves are fine, green ones coarser; blue only grows.
        let middle = SIDE * SIDE / 2 + SIDE / 2;
        let strength = |f: usize| {
            let row = (0..64).map(|x| found[(middle - 32 + x) * FEATURES + f].abs());
            row.sum::<f32>()
        };
        assert!(strength(0) > 2.0 * strength(1), "fine red");
        assert!(strength(7) > 2.0 * strength(6), "coarse green");
    }

    #[test]
    fn a_plain_picture_has_no_detail() {
        let plain = RgbImage::from_pixel(40, 90, image::Rgb([200, 90, 30]));
        for texel in exemplar(&plain).chunks_exact(FEATURES) {
            assert!(texel[..9].iter().all(|x| x.abs() < 1e-3), "{texel:?}");
        }
    }

    #[test]
    fn mixed_detail_is_as_strong_as_each() {
        let one: Vec<f32> = (0..PARAMS)
            .map(|i| if i % 2 == 0 { 1.0 } else { 0.0 })
            .collect();
        let other: Vec<f32> = one.iter().map(|x| 1.0 - x).collect();
        let mixed = mixed_exemplars([(&*one, 0.5), (&*other, 0.5), (&*one, 0.0)].into_iter());
        let squares = mixed.iter().map(|x| x * x).sum::<f32>() / PARAMS as f32;
        assert!((squares - 0.5).abs() < 1e-4, "{squares}");
        assert_eq!(mixed_exemplars([(&*one, 0.3)].into_iter()), one);
    }
}
