//! A raster for plain shapes, in pixels with the origin at its top left.

use glam::DVec2;
use image::{Rgb, RgbImage};

use crate::photo::downscale;

/// Pixels are drawn this many times finer along each side and averaged: edges become smooth.
const FINER: u32 = 3;

/// A picture in the making.
pub(super) struct Raster {
    fine: RgbImage,
}

/// The part of the raster that is drawn on: from its first corner up to its last.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClipBox {
    pub(super) from: DVec2,
    pub(super) to: DVec2,
}

/// How a shape is filled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ink {
    pub(super) colour: [u8; 3],
    /// From 0, nothing, to 1.
    pub(super) opacity: f64,
}

impl Ink {
    fn lay(&self, pixel: &mut Rgb<u8>) {
        for (below, above) in pixel.0.iter_mut().zip(self.colour) {
            let (from, to) = (f64::from(*below), f64::from(above));
            *below = (from + (to - from) * self.opacity).round() as u8;
        }
    }
}

impl Raster {
    pub(super) fn new([width, height]: [u32; 2], ground: [u8; 3]) -> Self {
        Self {
            fine: RgbImage::from_pixel(width * FINER, height * FINER, Rgb(ground)),
        }
    }

    /// The finished picture.
    pub(super) fn picture(&self) -> RgbImage {
        downscale(&self.fine, FINER)
    }

    pub(super) fn disc(&mut self, clip: &ClipBox, centre: DVec2, radius: f64, ink: Ink) {
        let reach = DVec2::splat(radius);
        self.fill(clip, [centre - reach, centre + reach], ink, |at| {
            at.distance_squared(centre) <= radius * radius
        });
    }

    /// A circle as a line one pixel wide.
    pub(super) fn circle(&mut self, clip: &ClipBox, centre: DVec2, radius: f64, ink: Ink) {
        let reach = DVec2::splat(radius + 1.0);
        self.fill(clip, [centre - reach, centre + reach], ink, |at| {
            (at.distance(centre) - radius).abs() <= 0.5
        });
    }

    pub(super) fn line(&mut self, clip: &ClipBox, [from, to]: [DVec2; 2], width: f64, ink: Ink) {
        let half = 0.5 * width;
        let along = to - from;
        let length = along.length_squared().max(1e-12);
        let corners = [from.min(to) - half, from.max(to) + half];
        self.fill(clip, corners, ink, |at| {
            let share = ((at - from).dot(along) / length).clamp(0.0, 1.0);
            at.distance_squared(from + along * share) <= half * half
        });
    }

    pub(super) fn triangle(&mut self, clip: &ClipBox, [a, b, c]: [DVec2; 3], ink: Ink) {
        let side = |from: DVec2, to: DVec2, at: DVec2| (to - from).perp_dot(at - from);
        let corners = [a.min(b).min(c), a.max(b).max(c)];
        self.fill(clip, corners, ink, |at| {
            let sides = [side(a, b, at), side(b, c, at), side(c, a, at)];
            sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
        });
    }

    /// Fills what lies in `inside`, between two corners and within the clip box.
    fn fill(
        &mut self,
        clip: &ClipBox,
        [least, most]: [DVec2; 2],
        ink: Ink,
        inside: impl Fn(DVec2) -> bool,
    ) {
        let finer = f64::from(FINER);
        // Casts saturate, so that what lies outside the raster costs nothing.
        let first = (least.max(clip.from) * finer).floor();
        let last = (most.min(clip.to) * finer).ceil();
        let width = (last.x as u32).min(self.fine.width());
        let height = (last.y as u32).min(self.fine.height());
        for y in first.y as u32..height {
            for x in first.x as u32..width {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / finer;
                if inside(at) {
                    ink.lay(self.fine.get_pixel_mut(x, y));
                }
            }
        }
    }
}
