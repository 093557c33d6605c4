//! How close a picture is to another one, and how restless it is.

mod affine;
mod grain;

pub use affine::affine_fit;
pub use grain::{second_differences, wrong_pixels};

/// Side of the window of [`ssim`], in pixels.
const WINDOW: usize = 11;
/// Standard deviation of the window's weights, in pixels.
const SIGMA: f64 = 1.5;
/// Keeps the comparison of means stable where both are dark: (K₁ · range)², K₁ = 0.01.
const C1: f64 = 0.01 * 0.01;
/// Keeps the comparison of structure stable where both are flat: (K₂ · range)², K₂ = 0.03.
const C2: f64 = 0.03 * 0.03;

/// What pixels that do not count look like.
const HIDDEN: f32 = 0.5;

/// Peak signal-to-noise ratio in dB of values in `[0, 1]`: `−10 log₁₀` of the mean squared
/// difference. Infinite for equal pictures; NaN when the lengths differ or are zero.
pub fn psnr(a: &[f32], b: &[f32]) -> f64 {
    if a.len() != b.len() || a.is_empty() {
        return f64::NAN;
    }
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / a.len() as f64).log10()
}

/// [`psnr`] of some pixels only: `used` has one entry for each pixel, whose channels lie side by
/// side. NaN when none is used.
pub fn psnr_of(a: &[f32], b: &[f32], used: &[bool]) -> f64 {
    let pixels = used.len().max(1);
    let channels = a.len() / pixels;
    if a.len() != b.len() || channels * used.len() != a.len() {
        return f64::NAN;
    }
    let chosen = |values: &[f32]| -> Vec<f32> {
        let pixels = values.chunks_exact(channels.max(1)).zip(used);
        pixels
            .filter(|(_, used)| **used)
            .flat_map(|(p, _)| p.to_vec())
            .collect()
    };
    psnr(&chosen(a), &chosen(b))
}

/// [`ssim`] of some pixels only: the mean over windows around used pixels, in which unused ones
/// are grey in both pictures. `used` has one entry for each pixel; NaN also when none that
/// has a whole window is used.
pub fn ssim_of(
    a: &[f32],
    b: &[f32],
    width: usize,
    height: usize,
    channels: usize,
    used: &[bool],
) -> f64 {
    if a.len() != b.len() || used.len() != width * height || width.min(height) < WINDOW {
        return f64::NAN;
    }
    // Of one value, so that nothing depends on what is hidden there.
    let filled = |picture: &[f32]| -> Vec<f32> {
        let pixels = picture.chunks_exact(channels.max(1)).zip(used);
        let shown = |value: &f32, used: bool| if used { *value } else { HIDDEN };
        pixels
            .flat_map(|(pixel, used)| pixel.iter().map(move |value| shown(value, *used)))
            .collect()
    };
    let (a, b) = (filled(a), filled(b));
    let inner = |side: usize| WINDOW / 2..side - WINDOW / 2;
    let centres: Vec<bool> = inner(height)
        .flat_map(|y| inner(width).map(move |x| used[y * width + x]))
        .collect();
    mean_similarity(&a, &b, width, height, channels, Some(&centres))
}

/// Mean structural similarity (Wang et al. 2004) of two pictures, `height × width × channels`
/// with values in `[0, 1]`; 1 for equal pictures.
///
/// Gaussian window of 11×11 pixels with σ = 1.5, K₁ = 0.01, K₂ = 0.03, population covariance;
/// averaged over the pixels whose window lies inside the picture, then over channels. NaN when a
/// length is not `height · width · channels` or a side is shorter than the window.
pub fn ssim(a: &[f32], b: &[f32], width: usize, height: usize, channels: usize) -> f64 {
    mean_similarity(a, b, width, height, channels, None)
}

/// The mean over windows, all of them or those whose centre is chosen, then over channels.
fn mean_similarity(
    a: &[f32],
    b: &[f32],
    width: usize,
    height: usize,
    channels: usize,
    centres: Option<&[bool]>,
) -> f64 {
    let length = width * height * channels;
    if a.len() != length || b.len() != length || width.min(height) < WINDOW || channels == 0 {
        return f64::NAN;
    }
    let weights = window();
    let sum: f64 = (0..channels)
        .map(|channel| {
            let plane = |picture: &[f32]| -> Vec<f64> {
                let values = picture.iter().skip(channel).step_by(channels);
                values.map(|&v| f64::from(v)).collect()
            };
            let similarities = similarities(&plane(a), &plane(b), width, &weights);
            let all = similarities.iter().enumerate();
            let chosen = all.filter(|(i, _)| centres.is_none_or(|centres| centres[*i]));
            let (sum, count) = chosen.fold((0.0, 0usize), |(s, n), (_, v)| (s + v, n + 1));
            sum / count as f64
        })
        .sum();
    sum / channels as f64
}

/// The window's weights along one axis; they sum to 1.
fn window() -> [f64; WINDOW] {
    let mut weights = [0.0; WINDOW];
    for (i, weight) in weights.iter_mut().enumerate() {
        let offset = i as f64 - (WINDOW / 2) as f64;
        *weight = (-0.5 * (offset / SIGMA).powi(2)).exp();
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

/// Similarity of two planes of equal size, window by window.
fn similarities(a: &[f64], b: &[f64], width: usize, weights: &[f64; WINDOW]) -> Vec<f64> {
    let smooth = |f: fn(f64, f64) -> f64| {
        let plane: Vec<f64> = a.iter().zip(b).map(|(&a, &b)| f(a, b)).collect();
        filter(&plane, width, weights)
    };
    let (mean_a, mean_b) = (smooth(|a, _| a), smooth(|_, b| b));
    let (aa, bb) = (smooth(|a, _| a * a), smooth(|_, b| b * b));
    let ab = smooth(|a, b| a * b);
    (0..mean_a.len())
        .map(|i| {
            let (ma, mb) = (mean_a[i], mean_b[i]);
            let (var_a, var_b, covariance) = (aa[i] - ma * ma, bb[i] - mb * mb, ab[i] - ma * mb);
            let means = (2.0 * ma * mb + C1) / (ma * ma + mb * mb + C1);
            means * (2.0 * covariance + C2) / (var_a + var_b + C2)
        })
        .collect()
}

/// Separable convolution; the result has `WINDOW − 1` fewer rows and columns.
fn filter(plane: &[f64], width: usize, weights: &[f64; WINDOW]) -> Vec<f64> {
    let out_width = width - WINDOW + 1;
    let mean = |window: &[f64]| window.iter().zip(weights).map(|(v, k)| v * k).sum();
    let rows = plane.chunks_exact(width);
    let narrow: Vec<f64> = rows.flat_map(|row| row.windows(WINDOW).map(mean)).collect();
    let out_height = plane.len() / width - WINDOW + 1;
    let mut out = vec![0.0; out_width * out_height];
    for (y, row) in out.chunks_exact_mut(out_width).enumerate() {
        for (k, weight) in weights.iter().enumerate() {
            let from = &narrow[(y + k) * out_width..][..out_width];
            for (sum, value) in row.iter_mut().zip(from) {
                *sum += weight * value;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two pictures that differ a little, 19×14×3, in values that need no rounding rule.
    fn pictures() -> (Vec<f32>, Vec<f32>) {
        let value = |i: usize, bent: bool| {
            let (x, y, c) = ((i / 3) % 19, i / 57, i % 3);
            let bend = if bent { (x * y + c) % 5 } else { 0 };
            ((x * 7 + y * 13 + c * 5 + bend) % 32) as f32 / 31.0
        };
        let picture = |bent| (0..19 * 14 * 3).map(|i| value(i, bent)).collect();
        (picture(false), picture(true))
    }

    #[test]
    fn psnr_of_a_known_difference() {
        assert!((psnr(&[0.5; 6], &[0.6; 6]) - 20.0).abs() < 1e-5);
        assert!((psnr(&[0.0, 1.0], &[0.0, 0.0]) - 3.010_299_956_639_812).abs() < 1e-12);
        assert_eq!(psnr(&[0.3; 4], &[0.3; 4]), f64::INFINITY);
        assert!(psnr(&[0.0; 3], &[0.0; 4]).is_nan() && psnr(&[], &[]).is_nan());
    }

    #[test]
    fn unused_pixels_do_not_count() {
        let (mut a, mut b) = pictures();
        let (whole, all) = (ssim(&a, &b, 19, 14, 3), vec![true; 19 * 14]);
        assert_eq!(ssim_of(&a, &b, 19, 14, 3, &all), whole);
        assert_eq!(psnr_of(&a, &b, &all), psnr(&a, &b));
        let used: Vec<bool> = (0..19 * 14).map(|i| i % 19 < 11).collect();
        let measured =
            |a: &[f32], b: &[f32]| (psnr_of(a, b, &used), ssim_of(a, b, 19, 14, 3, &used));
        let before = measured(&a, &b);
        let hidden = b.chunks_exact_mut(3).zip(&used);
        hidden
            .filter(|(_, used)| !**used)
            .for_each(|(pixel, _)| pixel.fill(0.1));
        for (pixel, _) in a.chunks_exact_mut(3).zip(&used).filter(|(_, used)| !**used) {
            pixel.fill(0.9);
        }
        assert_eq!(measured(&a, &b), before);
        a[0] = 1.0;
        assert_ne!(measured(&a, &b).0, before.0);
        assert!(psnr_of(&a, &b, &[false; 19 * 14]).is_nan());
        assert!(ssim_of(&a, &b, 19, 14, 3, &[false; 19 * 14]).is_nan());
    }

    #[test]
    fn ssim_of_flat_pictures_compares_their_means() {
        let expected = (2.0 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4);
        let (a, b) = (vec![0.5; 12 * 11 * 3], vec![0.25; 12 * 11 * 3]);
        assert!((ssim(&a, &b, 12, 11, 3) - expected).abs() < 1e-12);
    }

    #[test]
    fn ssim_agrees_with_a_direct_sum_over_windows() {
        let (a, b) = pictures();
        assert!((ssim(&a, &a, 19, 14, 3) - 1.0).abs() < 1e-12);
        // Computed by a separate Python program: two-dimensional weights, deviations from the
        // window's mean, no shortcuts.
        assert!(
            (ssim(&a, &b, 19, 14, 3) - 0.641_719_208_343_767_4).abs() < 1e-6,
            "{}",
            ssim(&a, &b, 19, 14, 3)
        );
        assert_eq!(ssim(&a, &b, 19, 14, 3), ssim(&b, &a, 19, 14, 3));
    }

    /// One of three pairs of 8-bit pictures: other noise, less contrast, other brightness.
    fn bytes(kind: usize, width: usize, height: usize) -> [Vec<f32>; 2] {
        let pairs = (0..width * height * 3).map(|i| {
            let (x, y, c) = (i / 3 % width, i / 3 / width, i % 3);
            let a = (x * x * (kind + 1) + y * (17 + 5 * c) + x * y * kind + 31 * c) % 256;
            let b = match kind {
                0 => (a + (x * 7 + y * 3 + c * 11) % 41) % 256,
                1 => (a * 3 + 255) / 4,
                _ => (a + 40).saturating_sub((x * y + c) % 9 * 10).min(255),
            };
            (a as f32 / 255.0, b as f32 / 255.0)
        });
        let (a, b) = pairs.unzip();
        [a, b]
    }

    /// Values of scikit-image 0.26.0 for the same pictures in double precision:
    /// `structural_similarity(a, b, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
    /// data_range=1, channel_axis=2)`. It too leaves out the border of half a window in its mean.
    #[test]
    fn ssim_agrees_with_scikit_image() {
        let cases = [
            (16, 12, 0.646_128_596_047_808_9),
            (23, 17, 0.935_279_692_051_366_7),
            (32, 24, 0.945_138_231_108_853_3),
        ];
        for (kind, (width, height, wanted)) in cases.into_iter().enumerate() {
            let [a, b] = bytes(kind, width, height);
            let found = ssim(&a, &b, width, height, 3);
            assert!((found - wanted).abs() < 1e-6, "pair {kind}: {found}");
        }
    }

    #[test]
    fn ssim_needs_a_whole_window() {
        assert!(ssim(&[0.0; 300], &[0.0; 300], 10, 10, 3).is_nan());
        assert!(ssim(&[0.0; 5], &[0.0; 363], 11, 11, 3).is_nan());
    }
}
