//! What every technique works with.

use crate::canvas::{Brush, Canvas, box_blur};
use crate::colour::Pigments;
use crate::dice::Dice;
use crate::maths::mix;
use crate::sketch::Sketch;
use glam::{Vec2, Vec3};

/// Everything a technique works with.
pub(crate) struct PaintingStudio {
    pub canvas: Canvas,
    pub sketch: Sketch,
    pub pigments: Pigments,
    pub dice: Dice,
    /// Where the light comes from, in the picture's plane.
    pub light: Vec2,
    /// Pixels that one pixel of a 256-pixel picture at scale 1 becomes.
    pub unit: f32,
}

impl PaintingStudio {
    /// Width and height of the canvas in pixels.
    pub(crate) fn size(&self) -> Vec2 {
        Vec2::new(self.canvas.width as f32, self.canvas.height as f32)
    }

    /// Its area, in those of a picture 256 pixels long at scale 1.
    pub(crate) fn area(&self) -> f32 {
        (self.canvas.width * self.canvas.height) as f32 / (self.unit * self.unit) / 65_536.0
    }

    /// A point anywhere on the canvas.
    pub(crate) fn anywhere(&self) -> Vec2 {
        Vec2::new(self.dice.unit(), self.dice.unit()) * self.size()
    }

    /// A pigment at random.
    pub(crate) fn pick(&self) -> Vec3 {
        self.pigments.pick(&self.dice)
    }

    /// As many of them.
    pub(crate) fn picks(&self, count: usize) -> Vec<Vec3> {
        (0..count).map(|_| self.pick()).collect()
    }

    /// A colour [broken](Pigments::broken) by `amount`.
    pub(crate) fn broken(&self, c: Vec3, amount: f32) -> Vec3 {
        self.pigments.broken(c, amount, &self.dice)
    }

    /// A stroke with bristles of its own.
    pub(crate) fn stroke(&mut self, path: &[Vec2], brush: &Brush, c: Vec3) {
        self.canvas.stroke(path, brush, c, self.dice.bits());
    }

    /// The direction of strokes at a point.
    pub(crate) fn along(&self, p: Vec2) -> Vec2 {
        self.sketch.flow[self.sketch.index(p)]
    }

    /// The sketch's colours, run into each other over `radius` pixels.
    pub(crate) fn soaked(&self, radius: f32) -> Vec<Vec3> {
        let mut colours = self.sketch.colour.clone();
        let (width, height) = (self.sketch.width, self.sketch.height);
        box_blur(&mut colours, width, height, radius as usize);
        colours
    }

    /// Points of a jittered grid `spacing` pixels apart that covers the picture, in random order.
    pub(crate) fn scatter(&self, spacing: f32) -> Vec<Vec2> {
        let step = spacing.max(0.5);
        let counts = (self.size() / step).ceil();
        let (columns, rows) = (counts.x as usize + 1, counts.y as usize + 1);
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
