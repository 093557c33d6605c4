//! Flow estimated from two pictures alone, as papers without geometry do: dense inverse search
//! (Kroeger et al. 2016) without its variational refinement.

use crate::flow::Flow;
use crate::grid::Grid;
use image::RgbImage;
use rayon::prelude::*;
use std::iter::successors;

/// Side of a patch, and distance between two, in pixels of their level.
const PATCH: usize = 8;
const STRIDE: usize = 4;
/// The coarsest level has at least this many pixels a side.
const LEAST_SIDE: usize = 24;
/// Steps of a patch's search, and the step under which it ends.
const STEPS: usize = 16;
const SMALL_STEP: f32 = 0.01;
/// Added to a patch's structure tensor: flat patches stay where the coarser level put them.
const DAMPING: f32 = 1e-3;

/// Flow from one picture to another of the same size; `None` where it leaves the picture.
///
/// # Panics
/// If the sizes differ.
pub fn estimated(from: &RgbImage, to: &RgbImage) -> Flow {
    assert_eq!(from.dimensions(), to.dimensions(), "two frames of a path");
    let finest = [Grid::brightness(from), Grid::brightness(to)];
    let levels = successors(Some(finest), |finer| {
        let large = finer[0].width.min(finer[0].height) >= 2 * LEAST_SIDE;
        large.then(|| finer.each_ref().map(Grid::halved))
    });
    let levels: Vec<[Brightness; 2]> = levels.collect();
    let mut motion: Option<Motion> = None;
    for [from, to] in levels.iter().rev() {
        motion = Some(level(from, to, motion.as_ref()));
    }
    let (width, height) = (from.width() as usize, from.height() as usize);
    let vectors = motion.map_or_else(Vec::new, |m| m.values);
    let inside = vectors.into_iter().enumerate().map(|(i, [dx, dy])| {
        let (x, y) = ((i % width) as f32 + 0.5 + dx, (i / width) as f32 + 0.5 + dy);
        let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        inside.then_some([dx, dy])
    });
    Flow {
        width,
        height,
        vectors: inside.collect(),
    }
}

/// A level of a picture.
type Brightness = Grid<f32>;
/// Motion of every pixel of a level.
type Motion = Grid<[f32; 2]>;

/// A patch of the first picture, and where its content went.
struct Patch {
    x: usize,
    y: usize,
    motion: [f32; 2],
}

fn level(from: &Brightness, to: &Brightness, coarser: Option<&Motion>) -> Motion {
    let places = |side: usize| {
        let last = side.saturating_sub(PATCH);
        (0..last).step_by(STRIDE).chain([last])
    };
    let corners: Vec<[usize; 2]> = places(from.height)
        .flat_map(|y| places(from.width).map(move |x| [x, y]))
        .collect();
    let patches: Vec<Patch> = corners
        .into_par_iter()
        .map(|[x, y]| {
            let first = coarser.map_or([0.0; 2], |motion| {
                let place = |at: usize, side: usize| ((at + PATCH / 2) / 2).min(side - 1);
                let (cx, cy) = (place(x, motion.width), place(y, motion.height));
                motion.values[cy * motion.width + cx].map(|v| 2.0 * v)
            });
            let motion = search(from, to, [x, y], first);
            Patch { x, y, motion }
        })
        .collect();
    densified(from, to, &patches)
}

/// Inverse compositional search of one patch, both sides less their mean brightness.
fn search(from: &Brightness, to: &Brightness, [x, y]: [usize; 2], first: [f32; 2]) -> [f32; 2] {
    let side = |length: usize| PATCH.min(length);
    let (width, height) = (side(from.width), side(from.height));
    let pixels: Vec<[f32; 2]> = (0..width * height)
        .map(|i| [(x + i % width) as f32, (y + i / width) as f32])
        .collect();
    let n = pixels.len() as f32;
    let centred = |plane: &Brightness, [dx, dy]: [f32; 2]| -> Vec<f32> {
        let values: Vec<f32> = pixels
            .iter()
            .map(|[x, y]| plane.at(x + dx, y + dy))
            .collect();
        let mean = values.iter().sum::<f32>() / n;
        values.into_iter().map(|v| v - mean).collect()
    };
    let wanted = centred(from, [0.0; 2]);
    let slopes: Vec<[f32; 2]> = pixels
        .iter()
        .map(|[x, y]| {
            [
                0.5 * (from.at(x + 1.0, *y) - from.at(x - 1.0, *y)),
                0.5 * (from.at(*x, y + 1.0) - from.at(*x, y - 1.0)),
            ]
        })
        .collect();
    let sum = |f: &dyn Fn(usize) -> f32| (0..pixels.len()).map(f).sum::<f32>();
    let xx = sum(&|i| slopes[i][0] * slopes[i][0]) + DAMPING;
    let yy = sum(&|i| slopes[i][1] * slopes[i][1]) + DAMPING;
    let xy = sum(&|i| slopes[i][0] * slopes[i][1]);
    let determinant = xx * yy - xy * xy;
    let mut motion = first;
    for _ in 0..STEPS {
        let found = centred(to, motion);
        let along = |axis: usize| sum(&|i| slopes[i][axis] * (found[i] - wanted[i]));
        let (bx, by) = (along(0), along(1));
        let step = [
            (yy * bx - xy * by) / determinant,
            (xx * by - xy * bx) / determinant,
        ];
        motion = [motion[0] - step[0], motion[1] - step[1]];
        let size = |v: [f32; 2]| v[0].hypot(v[1]);
        // A patch that runs away has found nothing.
        let moved = size([motion[0] - first[0], motion[1] - first[1]]);
        if moved.is_nan() || moved >= PATCH as f32 {
            return first;
        }
        if size(step) < SMALL_STEP {
            break;
        }
    }
    motion
}

/// Every pixel's mean over the patches that cover it, the better fitting ones counting more.
fn densified(from: &Brightness, to: &Brightness, patches: &[Patch]) -> Motion {
    let mut sums = vec![[0.0f32; 3]; from.values.len()];
    for patch in patches {
        let [dx, dy] = patch.motion;
        for y in patch.y..(patch.y + PATCH).min(from.height) {
            for x in patch.x..(patch.x + PATCH).min(from.width) {
                let i = y * from.width + x;
                let found = to.at(x as f32 + dx, y as f32 + dy);
                let weight = 1.0 / (255.0 * (found - from.values[i]).abs()).max(1.0);
                sums[i][0] += weight * dx;
                sums[i][1] += weight * dy;
                sums[i][2] += weight;
            }
        }
    }
    let vectors = sums
        .into_iter()
        .map(|[x, y, weight]| [x / weight, y / weight]);
    Motion {
        width: from.width,
        height: from.height,
        values: vectors.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    /// A texture of many wavelengths, moved by `(dx, dy)`.
    fn texture(dx: f32, dy: f32) -> RgbImage {
        RgbImage::from_fn(120, 90, |x, y| {
            let (x, y) = (x as f32 - dx, y as f32 - dy);
            let wave = |a: f32, b: f32, c: f32| (a * x + b * y + c).sin();
            let sum = wave(0.21, 0.13, 0.0)
                + wave(-0.35, 0.29, 1.0)
                + wave(0.11, -0.45, 2.0)
                + wave(0.62, 0.4, 3.0)
                + wave(0.05, 0.07, 4.0);
            Rgb([(128.0 + 22.0 * sum) as u8; 3])
        })
    }

    fn median_error(dx: f32, dy: f32) -> f32 {
        let flow = estimated(&texture(0.0, 0.0), &texture(dx, dy));
        let mut errors: Vec<f32> = (0..90)
            .flat_map(|y| (0..120).map(move |x| (x, y)))
            .filter(|(x, y)| (12..108).contains(x) && (12..78).contains(y))
            .map(|(x, y)| {
                let [u, v] = flow.vectors[y * 120 + x].unwrap_or([f32::INFINITY; 2]);
                (u - dx).hypot(v - dy)
            })
            .collect();
        errors.sort_by(f32::total_cmp);
        errors[errors.len() / 2]
    }

    #[test]
    fn a_moved_texture_is_followed() {
        for (dx, dy) in [(0.0, 0.0), (0.4, -0.3), (2.3, -1.6), (-6.5, 4.0)] {
            let error = median_error(dx, dy);
            assert!(error < 0.1, "moved by ({dx}, {dy}): {error} pixels off");
        }
    }

    #[test]
    fn flat_and_tiny_pictures_do_not_move() {
        for (width, height) in [(50, 40), (3, 2), (1, 1)] {
            let flat = RgbImage::from_pixel(width, height, Rgb([7, 100, 200]));
            let flow = estimated(&flat, &flat);
            assert_eq!(flow.vectors.len(), (width * height) as usize);
            let still = |v: &Option<[f32; 2]>| v.is_some_and(|[x, y]| x == 0.0 && y == 0.0);
            assert!(flow.vectors.iter().all(still));
        }
    }
}
