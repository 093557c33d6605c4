//! 3×3 convolutions by Winograd's minimal filtering F(2×2, 3×3) (Lavin & Gray 2016): 16 instead of
//! 36 multiplications for every 2×2 pixels. Single precision loses about one digit of seven.

use super::padded::Padded;
use super::product::{Left, ProductTarget, Start, product};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Numbers of a transformed patch of 4×4 pixels.
const POINTS: usize = 16;
/// Output channels computed together.
const STRIP: usize = 64;
/// Most patches whose transforms lie in the second-level cache together, for 64 channels.
const PATCHES: usize = 48;

/// Transformed filters: per strip of output channels `[point][input][output of the strip]`.
#[derive(Debug, Clone)]
pub(crate) struct WinogradFilters {
    inputs: usize,
    outputs: usize,
    strips: Vec<f32>,
}

impl WinogradFilters {
    /// Filters whose weight for a tap (`3 · dy + dx`), an input and an output is
    /// `weight(tap, input, output)`.
    pub(crate) fn new(
        inputs: usize,
        outputs: usize,
        weight: impl Fn(usize, usize, usize) -> f32,
    ) -> Self {
        let mut strips = Vec::with_capacity(POINTS * inputs * outputs);
        for first in (0..outputs).step_by(STRIP) {
            let strip = first..(first + STRIP).min(outputs);
            let width = strip.len();
            let mut points = vec![0.0; POINTS * inputs * width];
            for input in 0..inputs {
                for (column, output) in strip.clone().enumerate() {
                    let taps = std::array::from_fn(|tap| weight(tap, input, output));
                    for (point, value) in transformed_filter(&taps).into_iter().enumerate() {
                        points[(point * inputs + input) * width + column] = value;
                    }
                }
            }
            strips.extend(points);
        }
        Self {
            inputs,
            outputs,
            strips,
        }
    }

    /// Convolves `input` into `out`, zeros of the same size. With a bias, relu follows. The border
    /// of `out` stays zero.
    pub(crate) fn convolve(&self, input: &Padded, bias: Option<&[f32]>, out: &mut Padded) {
        assert_eq!(input.channels, self.inputs, "channels of a convolution");
        let across = input.width.div_ceil(2);
        let wanted = (PATCHES * 64 / self.inputs.max(64)).max(across);
        let rows = (wanted / across)
            .min(input.height.div_ceil(2).div_ceil(4))
            .max(1);
        let stride = out.stride();
        // Without the first row, the border.
        out.data[stride..(input.height + 1) * stride]
            .par_chunks_mut(2 * rows * stride)
            .enumerate()
            .for_each(|(chunk, out)| {
                Arch::new().dispatch(PatchRows {
                    filters: self,
                    input,
                    bias,
                    first: chunk * rows,
                    out,
                });
            });
    }
}

/// `G g Gᵀ`.
fn transformed_filter(taps: &[f32; 9]) -> [f32; POINTS] {
    let side = |a: f32, b: f32, c: f32| [a, 0.5 * (a + b + c), 0.5 * (a - b + c), c];
    let columns: [[f32; 4]; 3] = [0, 1, 2].map(|x| side(taps[x], taps[3 + x], taps[6 + x]));
    let mut out = [0.0; POINTS];
    for y in 0..4 {
        let row = side(columns[0][y], columns[1][y], columns[2][y]);
        out[4 * y..4 * y + 4].copy_from_slice(&row);
    }
    out
}

/// Some rows of patches, from patch row `first` on.
struct PatchRows<'a> {
    filters: &'a WinogradFilters,
    input: &'a Padded,
    bias: Option<&'a [f32]>,
    first: usize,
    /// Two padded rows per patch row, the last one missing where the height is odd.
    out: &'a mut [f32],
}

impl WithSimd for PatchRows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            filters,
            input,
            bias,
            first,
            out,
        } = self;
        let (inputs, outputs) = (filters.inputs, filters.outputs);
        let across = input.width.div_ceil(2);
        let stride = (input.width + 2) * outputs;
        let patch_rows = (out.len() / stride).div_ceil(2);
        let patches = patch_rows * across;
        let mut seen = vec![0.0; POINTS * patches * inputs];
        for patch in 0..patches {
            let (y, x) = (2 * (first + patch / across), 2 * (patch % across));
            transform_patch(input, y, x, &mut seen[patch * inputs..], patches * inputs);
        }
        let mut found = vec![0.0; POINTS * patches * STRIP];
        let strips = filters.strips.chunks(POINTS * inputs * STRIP).enumerate();
        for (strip, weights) in strips {
            let width = weights.len() / (POINTS * inputs);
            let found = &mut found[..POINTS * patches * width];
            for point in 0..POINTS {
                let rows = &seen[point * patches * inputs..][..patches * inputs];
                let weights = &weights[point * inputs * width..][..inputs * width];
                let found = &mut found[point * patches * width..][..patches * width];
                let rows = Left::new(rows, patches, inputs);
                let found = ProductTarget::new(found, Start::Zero, width);
                product(simd, found, rows, weights);
            }
            let channel = strip * STRIP;
            let bias = bias.map(|b| &b[channel..channel + width]);
            for patch in 0..patches {
                let (y, x) = (2 * (patch / across), 2 * (patch % across));
                let result = finished_patch(&found[patch * width..], patches * width, width, bias);
                for (i, values) in result.iter().enumerate() {
                    let (y, x) = (y + i / 2, x + i % 2);
                    let at = y * stride + (x + 1) * outputs + channel;
                    if x < input.width && (y + 1) * stride <= out.len() {
                        out[at..at + width].copy_from_slice(&values[..width]);
                    }
                }
            }
        }
    }
}

/// Writes `Bᵀ d B` of the 4×4 pixels from (`y`, `x`) of the padded image on, channel by channel,
/// points `apart` numbers from each other.
#[inline(always)]
fn transform_patch(input: &Padded, y: usize, x: usize, out: &mut [f32], apart: usize) {
    let channels = input.channels;
    let zeros = [0.0; STRIP];
    for start in (0..channels).step_by(STRIP) {
        let width = STRIP.min(channels - start);
        let mut columns = [[[0f32; STRIP]; 4]; 4];
        for (dx, column) in columns.iter_mut().enumerate() {
            let pixel = |dy: usize| {
                let pixel = input.bordered(y + dy, x + dx);
                pixel.map_or(&zeros[..width], |p| &p[start..start + width])
            };
            let d = [pixel(0), pixel(1), pixel(2), pixel(3)];
            let [a, b, c, e] = column;
            for i in 0..width {
                a[i] = d[0][i] - d[2][i];
                b[i] = d[1][i] + d[2][i];
                c[i] = d[2][i] - d[1][i];
                e[i] = d[1][i] - d[3][i];
            }
        }
        for dy in 0..4 {
            let d = columns.each_ref().map(|column| &column[dy]);
            let point = |dx: usize| (4 * dy + dx) * apart + start;
            let mut results = [[0f32; STRIP]; 4];
            let [a, b, c, e] = &mut results;
            for i in 0..STRIP {
                a[i] = d[0][i] - d[2][i];
                b[i] = d[1][i] + d[2][i];
                c[i] = d[2][i] - d[1][i];
                e[i] = d[1][i] - d[3][i];
            }
            for (dx, result) in results.iter().enumerate() {
                out[point(dx)..point(dx) + width].copy_from_slice(&result[..width]);
            }
        }
    }
}

/// `Aᵀ m A` plus bias: the 2×2 pixels of a patch, row by row.
#[inline(always)]
fn finished_patch(
    found: &[f32],
    apart: usize,
    width: usize,
    bias: Option<&[f32]>,
) -> [[f32; STRIP]; 4] {
    let mut halves = [[[0f32; STRIP]; 4]; 2];
    for dx in 0..4 {
        let point = |dy: usize| &found[(4 * dy + dx) * apart..][..width];
        let m = [point(0), point(1), point(2), point(3)];
        let [upper, lower] = &mut halves;
        for i in 0..width {
            upper[dx][i] = m[0][i] + m[1][i] + m[2][i];
            lower[dx][i] = m[1][i] - m[2][i] - m[3][i];
        }
    }
    let mut out = [[0f32; STRIP]; 4];
    for (half, out) in halves.iter().zip(out.as_chunks_mut::<2>().0) {
        let [left, right] = out;
        for i in 0..STRIP {
            left[i] = half[0][i] + half[1][i] + half[2][i];
            right[i] = half[1][i] - half[2][i] - half[3][i];
        }
    }
    if let Some(bias) = bias {
        for pixel in &mut out {
            for (v, b) in pixel.iter_mut().zip(bias) {
                let sum = *v + b;
                // Not `max`, which would turn NaN into 0 and hide a broken input.
                *v = if sum < 0.0 { 0.0 } else { sum };
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn numbers(seed: u64, count: usize) -> Vec<f32> {
        let mut rng = Pcg64::seed_from_u64(seed);
        (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
    }

    #[test]
    fn equals_nine_taps_for_every_pixel() {
        for (height, width) in [(1, 1), (2, 2), (3, 5), (8, 7), (13, 20)] {
            for (inputs, outputs) in [(1, 1), (3, 70), (70, 3), (64, 128)] {
                let mut padded = Padded::zeros(height, width, inputs);
                let image = numbers(1, height * width * inputs);
                for y in 0..height {
                    let at = padded.at(y, 0);
                    padded.data[at..at + width * inputs]
                        .copy_from_slice(&image[y * width * inputs..][..width * inputs]);
                }
                let weights = numbers(2, 9 * inputs * outputs);
                let weight =
                    |tap: usize, i: usize, o: usize| weights[(tap * inputs + i) * outputs + o];
                let bias = numbers(3, outputs);
                let filters = WinogradFilters::new(inputs, outputs, weight);
                for bias in [None, Some(&*bias)] {
                    let mut out = Padded::zeros(height, width, outputs);
                    filters.convolve(&padded, bias, &mut out);
                    for (at, found) in out.data.iter().enumerate() {
                        let (pixel, o) = (at / outputs, at % outputs);
                        let (y, x) = (pixel / (width + 2), pixel % (width + 2));
                        let inside = (1..=height).contains(&y) && (1..=width).contains(&x);
                        let mut wanted = 0.0;
                        if inside {
                            for tap in 0..9 {
                                let (y, x) = (y + tap / 3 - 1, x + tap % 3 - 1);
                                for i in 0..inputs {
                                    let d = padded.data[(y * (width + 2) + x) * inputs + i];
                                    wanted += f64::from(d) * f64::from(weight(tap, i, o));
                                }
                            }
                            if let Some(bias) = bias {
                                wanted = (wanted + f64::from(bias[o])).max(0.0);
                            }
                        }
                        assert!(
                            (f64::from(*found) - wanted).abs() < 1e-4,
                            "{height}×{width}, {inputs} to {outputs}, ({y}, {x}): {found} {wanted}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_no_number_stays_in_its_neighbourhood() {
        let (height, width, channels) = (9, 9, 2);
        let mut padded = Padded::zeros(height, width, channels);
        let at = padded.at(4, 4);
        padded.data[at] = f32::NAN;
        let filters = WinogradFilters::new(channels, channels, |tap, _, _| tap as f32);
        let mut out = Padded::zeros(height, width, channels);
        filters.convolve(&padded, Some(&[1.0, 1.0]), &mut out);
        let spoilt = |y: usize, x: usize| out.data[(y * (width + 2) + x) * channels].is_nan();
        assert!(spoilt(5, 5) && spoilt(4, 4) && spoilt(6, 6));
        // A patch of two by two pixels sees four by four.
        assert!(!spoilt(2, 5) && !spoilt(5, 2) && !spoilt(8, 5) && !spoilt(5, 8));
    }
}
