//! How a scene is painted: coats of paint, one over the other, each with its paintings, its strength,
//! whose colours it has and where it goes.

mod mask;
mod region;
mod spec;
mod view;

pub use mask::{MaskSpec, Shape};
pub use spec::{CoatError, CoatSpec, Coats, Keep, PaintingSpec};
pub use view::PreparedView;

pub(crate) use mask::Mask;
pub(crate) use region::Surroundings;

use crate::model::Look;

/// One coat of paint, ready: a look, and how and where it goes.
#[derive(Debug, Clone)]
pub struct Coat {
    pub(crate) look: Look,
    /// From what is below (0) to the look (1).
    pub(crate) strength: f32,
    pub(crate) keep: Keep,
    pub(crate) mask: Option<Mask>,
}

impl Coat {
    /// A look all over the scene, nothing else.
    pub fn plain(look: Look) -> Self {
        Self {
            look,
            strength: 1.0,
            keep: Keep::None,
            mask: None,
        }
    }

    /// Whether something of what is below can be seen.
    pub(crate) fn is_thin(&self) -> bool {
        self.strength < 1.0 || self.mask.is_some() || self.keep == Keep::Luminance
    }
}

/// Rays that were coloured, and what a coat needs to know of them.
pub(crate) struct Coated<'a> {
    /// Camera centres and directions, of length 1 along the camera's axis.
    pub(crate) rays: &'a impasto_field::RayBatch,
    /// Along the camera's axis.
    pub(crate) depth: &'a [f32],
    /// `rays × 3` in the photo's look; may be empty where the first coat hides it all.
    pub(crate) photo: &'a [f32],
}

impl Coated<'_> {
    /// Puts a coat on `below`, `rays × 3`; `painted` are the rays in its look.
    pub(crate) fn put_on(&self, below: &mut [f32], coat: &Coat, painted: &[f32]) {
        for (ray, (below, painted)) in below
            .chunks_exact_mut(3)
            .zip(painted.chunks_exact(3))
            .enumerate()
        {
            let share = match &coat.mask {
                None => coat.strength,
                Some(mask) => {
                    let (origin, direction) = (self.rays.origins[ray], self.rays.directions[ray]);
                    coat.strength * mask.share(origin, direction, self.depth[ray])
                }
            };
            let moved = match coat.keep {
                Keep::None | Keep::Palette => [painted[0], painted[1], painted[2]],
                Keep::Luminance => relit(&self.photo[3 * ray..3 * ray + 3], painted),
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
