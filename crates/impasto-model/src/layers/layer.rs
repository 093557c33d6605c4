//! One layer of paint, ready to be blended over what is below it.

use crate::appearance::StyledAppearance;
use crate::layers::mask::LayerMask;
use crate::layers::spec::ColorPreservation;
use impasto_field::RayBatch;

/// One layer of paint, ready: an appearance, and how and where it goes.
#[derive(Debug, Clone)]
pub struct StyleLayer {
    pub(crate) appearance: StyledAppearance,
    /// From what is below (0) to the paint (1).
    pub(crate) strength: f32,
    pub(crate) keep: ColorPreservation,
    pub(crate) mask: Option<LayerMask>,
}

impl StyleLayer {
    /// An appearance all over the scene, nothing else.
    pub fn plain(appearance: StyledAppearance) -> Self {
        Self {
            appearance,
            strength: 1.0,
            keep: ColorPreservation::None,
            mask: None,
        }
    }

    /// Whether something of what is below can be seen.
    pub(crate) fn is_translucent(&self) -> bool {
        self.strength < 1.0 || self.mask.is_some() || self.keep == ColorPreservation::Luminance
    }
}

/// Rays to be painted, and what a layer needs to know of them.
pub(crate) struct BlendTarget<'a> {
    /// Camera centres and directions, of length 1 along the camera's axis.
    pub(crate) rays: &'a RayBatch,
    /// Along the camera's axis.
    pub(crate) depth: &'a [f32],
    /// `rays × 3` as photographed; may be empty where the first layer hides it all.
    pub(crate) photo: &'a [f32],
}

impl BlendTarget<'_> {
    /// Blends a layer over `below`, `rays × 3`; `painted` are the rays in its appearance.
    pub(crate) fn blend(&self, below: &mut [f32], layer: &StyleLayer, painted: &[f32]) {
        for (ray, (below, painted)) in below
            .chunks_exact_mut(3)
            .zip(painted.chunks_exact(3))
            .enumerate()
        {
            let share = match &layer.mask {
                None => layer.strength,
                Some(mask) => {
                    let (origin, direction) = (self.rays.origins[ray], self.rays.directions[ray]);
                    layer.strength * mask.share(origin, direction, self.depth[ray])
                }
            };
            let moved = match layer.keep {
                ColorPreservation::None | ColorPreservation::Palette => {
                    [painted[0], painted[1], painted[2]]
                }
                ColorPreservation::Luminance => relit(&self.photo[3 * ray..3 * ray + 3], painted),
            };
            for (below, painted) in below.iter_mut().zip(moved) {
                *below += share * (painted - *below);
            }
        }
    }
}

/// Rec. 601's weights of red, green and blue in how light a colour is.
const LIGHTNESS: [f32; 3] = [0.299, 0.587, 0.114];

/// A colour made as light as another, its red and blue differences kept as far as RGB has room.
fn relit(colour: &[f32], like: &[f32]) -> [f32; 3] {
    let lightness = |rgb: &[f32]| -> f32 { rgb.iter().zip(LIGHTNESS).map(|(x, w)| x * w).sum() };
    let (now, wanted) = (lightness(colour), lightness(like));
    // Towards grey until all channels fit: hue stays, and so does the lightness.
    let room = colour.iter().fold(1.0f32, |room, x| {
        let off = x - now;
        let most = if off > 0.0 { 1.0 - wanted } else { wanted };
        if off.abs() > 1e-6 {
            room.min(most / off.abs())
        } else {
            room
        }
    });
    [0, 1, 2].map(|c| (wanted + room.max(0.0) * (colour[c] - now)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relit_colour_is_as_light_as_asked_and_keeps_its_hue() {
        let colour = [0.2, 0.5, 0.8];
        let lightness =
            |rgb: &[f32]| -> f32 { rgb.iter().zip(LIGHTNESS).map(|(x, w)| x * w).sum() };
        for like in [[0.5, 0.5, 0.5], [0.9, 0.95, 1.0], [0.0, 0.0, 0.0], [1.0; 3]] {
            let found = relit(&colour, &like);
            assert!(
                (lightness(&found) - lightness(&like)).abs() < 1e-5,
                "{found:?}"
            );
            // Channels keep their order and the ratio of their differences.
            let (a, b) = (found[1] - found[0], found[2] - found[1]);
            assert!(a >= 0.0 && (a - b).abs() < 1e-5, "{found:?}");
        }
        assert_eq!(
            relit(&[0.3; 3], &[0.6; 3]).map(|x| (10.0 * x).round()),
            [6.0; 3]
        );
    }
}
