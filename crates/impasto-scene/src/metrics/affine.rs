//! Pictures brought to the colours of others.

use crate::colors::ColorPairs;

/// How much a change counts beside a difference that it removes.
const LEAST_CHANGE: f64 = 1e-6;

/// `from` after the one affine map of its colours that brings it nearest to `to` (least squares
/// over the pixels that `used` says, all without; of equally near ones the least change): what
/// differs then is no matter of exposure or white balance.
///
/// # Shapes
/// Pixels of three channels, as many in both.
pub fn affine_fit(from: &[f32], to: &[f32], used: Option<&[bool]>) -> Vec<f32> {
    let colours = |picture: &'_ [f32]| picture.as_chunks::<3>().0.to_vec();
    let (from, to) = (colours(from), colours(to));
    let mut pairs = ColorPairs::NONE;
    for (i, (from, to)) in from.iter().zip(&to).enumerate() {
        if used.is_none_or(|used| used[i]) {
            pairs.add(*from, *to);
        }
    }
    let map = pairs.fit(LEAST_CHANGE);
    from.iter().flat_map(|colour| map.apply(*colour)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_affine_change_is_undone_and_hidden_pixels_do_not_count() {
        let from: Vec<f32> = (0..60).map(|i| ((i * 37) % 101) as f32 / 101.0).collect();
        let changed = |p: &[f32]| [0.5 * p[0] + 0.1, 0.9 * p[1] + 0.2 * p[0], 0.7 * p[2] - 0.05];
        let mut to: Vec<f32> = from.chunks(3).flat_map(changed).collect();
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(near(&affine_fit(&from, &to, None), &to));
        let wanted = to.clone();
        to[..3].fill(9.0);
        let used: Vec<bool> = (0..20).map(|i| i > 0).collect();
        assert!(near(&affine_fit(&from, &to, Some(&used)), &wanted));
    }
}
