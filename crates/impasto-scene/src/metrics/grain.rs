//! How restless a picture is in itself.

/// Mean squared second difference along rows and columns: the energy of grain, and of edges. 0 for
/// pictures that are narrower than three pixels.
///
/// # Shapes
/// `values`: `height × width × channels`, of rows `width` pixels long.
pub fn second_differences(values: &[f32], width: usize, channels: usize) -> f64 {
    let row = width * channels;
    let (mut sum, mut count) = (0.0, 0usize);
    let mut add = |a: f32, b: f32, c: f32| {
        sum += f64::from(a - 2.0 * b + c).powi(2);
        count += 1;
    };
    for line in values.chunks_exact(row.max(1)) {
        for i in 0..row.saturating_sub(2 * channels) {
            add(line[i], line[i + channels], line[i + 2 * channels]);
        }
    }
    for i in 0..values.len().saturating_sub(2 * row) {
        add(values[i], values[i + row], values[i + 2 * row]);
    }
    sum / count.max(1) as f64
}

/// Further from the median of its neighbourhood than this is a wrong pixel.
const WRONG: f32 = 0.2;

/// Share of pixels of which a channel differs by more than 0.2 from the median of its 3×3
/// neighbourhood; those at the border have none and do not count.
///
/// # Shapes
/// `values`: `height × width × 3` in `[0, 1]`, of rows `width` pixels long.
pub fn wrong_pixels(values: &[f32], width: usize) -> f64 {
    let height = values.len() / (3 * width).max(1);
    let at = |x: usize, y: usize, c: usize| values[3 * (y * width + x) + c];
    let is_wrong = |x: usize, y: usize, c: usize| {
        let mut around = [0.0f32; 9];
        for (i, value) in around.iter_mut().enumerate() {
            *value = at(x + i % 3 - 1, y + i / 3 - 1, c);
        }
        let (_, median, _) = around.select_nth_unstable_by(4, f32::total_cmp);
        (at(x, y, c) - *median).abs() > WRONG
    };
    let inner = |side: usize| 1..side.saturating_sub(1);
    let pixels = inner(height).flat_map(|y| inner(width).map(move |x| (x, y)));
    let wrong = pixels.filter(|(x, y)| (0..3).any(|c| is_wrong(*x, *y, c)));
    wrong.count() as f64 / (inner(height).len() * inner(width).len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 9×7 picture by its pixels.
    fn picture(value: impl Fn(usize, usize, usize) -> f32) -> Vec<f32> {
        let pixels = (0..7).flat_map(|y| (0..9).map(move |x| (x, y)));
        let values = pixels.flat_map(|(x, y)| (0..3).map(move |c| (x, y, c)));
        values.map(|(x, y, c)| value(x, y, c)).collect()
    }

    #[test]
    fn ramps_are_calm_and_checkers_are_not() {
        let ramp = picture(|x, y, c| 0.05 * x as f32 + 0.03 * y as f32 + 0.1 * c as f32);
        assert!(second_differences(&ramp, 9, 3) < 1e-12);
        let checker = picture(|x, y, _| ((x + y) % 2) as f32);
        assert!((second_differences(&checker, 9, 3) - 4.0).abs() < 1e-12);
        assert_eq!(second_differences(&[1.0, 5.0], 2, 1), 0.0);
        assert_eq!(second_differences(&[], 0, 3), 0.0);
        // One channel, one spike: three differences along each axis see it.
        let mut spike = [0.0; 63];
        spike[3 * 9 + 4] = 1.0;
        let count = (7 * 7 + 5 * 9) as f64;
        assert!((second_differences(&spike, 9, 1) - 12.0 / count).abs() < 1e-12);
    }

    #[test]
    fn one_spike_is_one_wrong_pixel_and_an_edge_is_none() {
        let share = 1.0 / 35.0;
        for (height, wanted) in [(0.19, 0.0), (0.21, share), (-0.21, share)] {
            let spiked = picture(|x, y, c| {
                let spike = (x, y, c) == (4, 3, 1);
                0.5 + if spike { height } else { 0.0 }
            });
            assert!((wrong_pixels(&spiked, 9) - wanted).abs() < 1e-12);
        }
        assert_eq!(
            wrong_pixels(&picture(|x, _, _| if x < 4 { 0.0 } else { 1.0 }), 9),
            0.0
        );
        assert_eq!(wrong_pixels(&[0.0; 12], 2), 0.0);
    }
}
