//! Squared differences as colours.

use crate::record::WorstPair;
use image::{Rgb, RgbImage};

/// Colours from no difference to [`HOTTEST`], equally far apart on the scale.
const RAMP: [[u8; 3]; 5] = [
    [16, 10, 40],
    [92, 20, 110],
    [196, 54, 82],
    [248, 142, 38],
    [253, 242, 170],
];
/// Squared difference from which on the last colour is used: a fifth of the range from black to
/// white. The same in all reports, so that their maps can be compared.
const HOTTEST: f32 = 0.04;
/// Width in pixels of the stripes that stand for what does not count, and their colours, which the
/// ramp does not have.
const STRIPE: u32 = 4;
const STRIPES: [[u8; 3]; 2] = [[128, 134, 140], [150, 156, 162]];

/// The colour of a squared difference. The scale is that of the difference itself, so that small
/// ones can be told from none.
fn colour(square: f32) -> [u8; 3] {
    let last = RAMP.len() - 1;
    let at = (square / HOTTEST).sqrt().clamp(0.0, 1.0) * last as f32;
    let left = (at as usize).min(last - 1);
    let share = at - left as f32;
    std::array::from_fn(|c| {
        let [from, to] = [left, left + 1].map(|i| f32::from(RAMP[i][c]));
        (from + share * (to - from)).round() as u8
    })
}

fn stripe(x: u32, y: u32) -> Rgb<u8> {
    Rgb(STRIPES[((x + y) / STRIPE % 2) as usize])
}

/// The second frame as the first would see it, and where the two differ; pixels that do not count
/// are striped in both.
pub(super) fn maps(pair: &WorstPair) -> [RgbImage; 2] {
    let (mut warped, mut heat) = (pair.warped.clone(), pair.warped.clone());
    let pixels = warped.enumerate_pixels_mut().zip(heat.pixels_mut());
    for (((x, y, warped), heat), square) in pixels.zip(&pair.squares) {
        match square {
            Some(square) => *heat = Rgb(colour(*square)),
            None => (*warped, *heat) = (stripe(x, y), stripe(x, y)),
        }
    }
    [warped, heat]
}

/// The scale: a bar of the ramp's colours with E × 100 at each of them.
pub(super) fn scale() -> String {
    let colours = RAMP.map(|[r, g, b]| format!("rgb({r} {g} {b})"));
    let last = (RAMP.len() - 1) as f32;
    let ticks = (0..RAMP.len()).map(|i| {
        let square = 100.0 * HOTTEST * (i as f32 / last).powi(2);
        let more = if i + 1 == RAMP.len() { "+" } else { "" };
        format!("<span>{square}{more}</span>")
    });
    let [dark, light] = STRIPES.map(|[r, g, b]| format!("rgb({r} {g} {b})"));
    format!(
        "<div class=\"scale\"><div class=\"bar\" style=\"background:linear-gradient(to right,{})\">\
         </div><div class=\"ticks\">{}</div><p>squared difference × 100</p></div>\n\
         <p class=\"swatch\"><span style=\"background:repeating-linear-gradient(135deg,{dark} 0 4px,\
         {light} 4px 8px)\"></span> does not count: hidden in the other frame, outside of it, or at \
         a motion boundary</p>\n",
        colours.join(","),
        ticks.collect::<String>(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hotter_is_brighter_and_masked_is_neither() {
        let luma = |square| colour(square).map(u32::from).iter().sum::<u32>();
        let rising = [0.0, 0.0025, 0.01, 0.0225, 0.04].map(luma);
        assert!(rising.is_sorted_by(|a, b| a < b), "{rising:?}");
        assert_eq!(colour(9.0), RAMP[4]);
        assert_eq!(colour(0.01), RAMP[2], "half the difference, half the scale");
        let pair = WorstPair {
            painting: None,
            frames: [1, 0],
            square: 0.0,
            coverage: 0.5,
            first: RgbImage::new(2, 1),
            warped: RgbImage::from_pixel(2, 1, Rgb([9, 9, 9])),
            squares: vec![Some(0.0), None],
        };
        let [warped, heat] = maps(&pair);
        let row = |image: &RgbImage| [0, 1].map(|x| image.get_pixel(x, 0).0);
        assert_eq!(row(&warped), [[9; 3], STRIPES[0]]);
        assert_eq!(row(&heat), [RAMP[0], STRIPES[0]]);
    }
}
