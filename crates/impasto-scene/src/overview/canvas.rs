//! A canvas for plain shapes, in pixels with the origin at its top left.

use glam::DVec2;
use image::{Rgb, RgbImage};

use crate::photo::downscale;

/// Pixels are drawn this many times finer along each side and averaged: edges become smooth.
const FINER: u32 = 3;

/// A picture in the making.
pub(super) struct Canvas {
    fine: RgbImage,
}

/// A part of the canvas that is drawn on: from its first corner up to its last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
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

impl Canvas {
    pub(super) fn new((width, height): (u32, u32), ground: [u8; 3]) -> Self {
        Self {
            fine: RgbImage::from_pixel(width * FINER, height * FINER, Rgb(ground)),
        }
    }

    /// The finished picture.
    pub(super) fn picture(&self) -> RgbImage {
        downscale(&self.fine, FINER)
    }

    pub(super) fn disc(&mut self, frame: &Frame, centre: DVec2, radius: f64, ink: Ink) {
        let reach = DVec2::splat(radius);
        self.fill(frame, (centre - reach, centre + reach), ink, |at| {
            at.distance_squared(centre) <= radius * radius
        });
    }

    /// A circle as a line of the given width.
    pub(super) fn circle(
        &mut self,
        frame: &Frame,
        centre: DVec2,
        (radius, width): (f64, f64),
        ink: Ink,
    ) {
        let reach = DVec2::splat(radius + width);
        self.fill(frame, (centre - reach, centre + reach), ink, |at| {
            (at.distance(centre) - radius).abs() <= 0.5 * width
        });
    }

    pub(super) fn line(&mut self, frame: &Frame, [from, to]: [DVec2; 2], width: f64, ink: Ink) {
        let half = 0.5 * width;
        let along = to - from;
        let length = along.length_squared().max(1e-12);
        let corners = (
            from.min(to) - DVec2::splat(half),
            from.max(to) + DVec2::splat(half),
        );
        self.fill(frame, corners, ink, |at| {
            let share = ((at - from).dot(along) / length).clamp(0.0, 1.0);
            at.distance_squared(from + along * share) <= half * half
        });
    }

    pub(super) fn triangle(&mut self, frame: &Frame, [a, b, c]: [DVec2; 3], ink: Ink) {
        let side = |from: DVec2, to: DVec2, at: DVec2| (to - from).perp_dot(at - from);
        let corners = (a.min(b).min(c), a.max(b).max(c));
        self.fill(frame, corners, ink, |at| {
            let sides = [side(a, b, at), side(b, c, at), side(c, a, at)];
            sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
        });
    }

    /// Fills what lies in `inside`, within two corners and the frame.
    fn fill(
        &mut self,
        frame: &Frame,
        (least, most): (DVec2, DVec2),
        ink: Ink,
        inside: impl Fn(DVec2) -> bool,
    ) {
        let finer = f64::from(FINER);
        // Casts saturate, so that what lies outside the canvas costs nothing.
        let first = (least.max(frame.from) * finer).floor();
        let last = (most.min(frame.to) * finer).ceil();
        let end = (
            (last.x as u32).min(self.fine.width()),
            (last.y as u32).min(self.fine.height()),
        );
        for y in first.y as u32..end.1 {
            for x in first.x as u32..end.0 {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / finer;
                if inside(at) {
                    let pixel = self.fine.get_pixel_mut(x, y);
                    for (below, ink_value) in pixel.0.iter_mut().zip(ink.colour) {
                        let mixed = f64::from(*below)
                            + (f64::from(ink_value) - f64::from(*below)) * ink.opacity;
                        *below = mixed.round() as u8;
                    }
                }
            }
        }
    }
}
