//! One function per family: paints the sketch onto the canvas in the family's technique.

mod chalk;
mod contours;
mod flat;
mod lines;
mod ornament;
mod strokes;
mod thick;
mod tiles;
mod washes;

use crate::canvas::Canvas;
use crate::colour::{Pigments, saturated};
use crate::dice::Dice;
use crate::maths::mix;
use crate::noise::hash_unit;
use crate::recipe::Family;
use crate::sketch::Sketch;
use glam::{Vec2, Vec3};

/// Everything a technique works with.
pub(crate) struct Studio {
    pub canvas: Canvas,
    pub sketch: Sketch,
    pub pigments: Pigments,
    pub dice: Dice,
    /// Where the light comes from, in the picture's plane.
    pub light: Vec2,
    /// Pixels that one pixel of a 256-pixel picture at scale 1 becomes.
    pub unit: f32,
}

/// The technique of a family.
pub(crate) fn of(family: Family) -> fn(&mut Studio) {
    match family {
        Family::Impressionist => strokes::impressionist,
        Family::Swirl => strokes::swirl,
        Family::Fauvist => strokes::fauvist,
        Family::Expressionist => strokes::expressionist,
        Family::OldMaster => strokes::old_master,
        Family::Gouache => strokes::gouache,
        Family::Knife => thick::knife,
        Family::Drip => thick::drip,
        Family::Pointillism => chalk::pointillism,
        Family::Pastel => chalk::pastel,
        Family::Drawing => chalk::drawing,
        Family::Woodblock => lines::woodblock,
        Family::Engraving => lines::engraving,
        Family::Linocut => lines::linocut,
        Family::InkWash => washes::ink_wash,
        Family::Watercolour => washes::watercolour,
        Family::Fresco => washes::fresco,
        Family::Mosaic => tiles::mosaic,
        Family::StainedGlass => tiles::stained_glass,
        Family::Cubist => tiles::cubist,
        Family::Tapestry => tiles::tapestry,
        Family::CutPaper => flat::cut_paper,
        Family::Geometric => flat::geometric,
        Family::GoldLeaf => ornament::gold_leaf,
    }
}

/// Age and photography: contrast, saturation, vignette, warm varnish and grain, all by chance.
pub(crate) fn finish(studio: &mut Studio) {
    let dice = &studio.dice;
    let contrast = dice.range(-0.15, 0.75);
    let saturation = dice.range(0.85, 1.2);
    let vignette = dice.unit() * dice.unit() * 0.35;
    let varnish = dice.unit() * dice.unit() * 0.3;
    let grain = dice.range(0.0, 0.03);
    let size = Vec2::new(studio.canvas.width as f32, studio.canvas.height as f32);
    let seed = dice.bits();
    studio.canvas.each(|p, c| {
        let c = saturated(c, saturation).clamp(Vec3::ZERO, Vec3::ONE);
        // A gentle S-curve: fixed at 0, ½ and 1.
        let c = c + contrast * 2.0 * c * (Vec3::ONE - c) * (c - 0.5);
        let off = (p / size - 0.5).length_squared() * 2.0;
        let c = c * (1.0 - vignette * off) * Vec3::ONE.lerp(Vec3::new(1.0, 0.9, 0.68), varnish);
        let speck = hash_unit(p.x as i32, p.y as i32, seed) - 0.5;
        (c + speck * grain).clamp(Vec3::ZERO, Vec3::ONE)
    });
}

impl Studio {
    /// Points of a jittered grid `spacing` pixels apart that covers the picture, in random order.
    pub(crate) fn scatter(&self, spacing: f32) -> Vec<Vec2> {
        let step = spacing.max(0.5);
        let (w, h) = (self.canvas.width as f32, self.canvas.height as f32);
        let (columns, rows) = (
            (w / step).ceil() as usize + 1,
            (h / step).ceil() as usize + 1,
        );
        let mut points = Vec::with_capacity(columns * rows);
        for k in 0..columns * rows {
            let home = Vec2::new((k % columns) as f32, (k / columns) as f32) * step;
            let stray = Vec2::new(self.dice.sway(), self.dice.sway()) * step * 0.5;
            points.push(home + stray);
        }
        self.dice.shuffle(&mut points);
        points
    }

    /// The flat colour of every region, moved `snap` of the way to the nearest pigment.
    pub(crate) fn flats(&self, snap: f32) -> Vec<Vec3> {
        let means = self.sketch.region_means();
        means
            .iter()
            .map(|c| c.lerp(self.pigments.nearest(*c), snap))
            .collect()
    }

    /// Distance of every pixel to the nearest outline of things at least `least` marks across.
    pub(crate) fn outlines(&self, least: f32) -> Vec<f32> {
        let side = least * self.unit;
        self.sketch.outline_distance(side * side)
    }

    /// The sketch's tones stretched to fill `[0, 1]`, with a few outliers clipped.
    pub(crate) fn stretched_tones(&self) -> Vec<f32> {
        let mut tones = self.sketch.tones();
        let mut sorted = tones.clone();
        sorted.sort_by(f32::total_cmp);
        let low = sorted[sorted.len() / 25];
        let high = sorted[sorted.len() - 1 - sorted.len() / 25];
        for t in &mut tones {
            *t = ((*t - low) / (high - low).max(0.05)).clamp(0.0, 1.0);
        }
        tones
    }
}

/// Multiplies `c` by a small brightness noise around 1: paper or stone texture.
pub(crate) fn textured(c: Vec3, noise: f32, strength: f32) -> Vec3 {
    c * mix(1.0 - strength, 1.0 + strength, noise)
}
