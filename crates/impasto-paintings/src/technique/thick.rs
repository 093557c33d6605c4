//! Paint used as matter: knife slabs and flung skeins.

use super::strokes::Pass;
use super::studio::{PaintingStudio, textured};
use crate::canvas::Brush;
use crate::maths::{direction, turned};
use crate::noise::noise;
use glam::{Vec2, Vec3};

/// Short wide slabs with ridges, coarse to fine, lit from the side.
pub(super) fn knife(studio: &mut PaintingStudio) {
    let ground = studio.pigments.tone(studio.dice.range(0.0, 0.5));
    studio.canvas.each(|_, _| ground);
    let lean = studio.dice.unit();
    let follow = studio.dice.chance(0.6);
    let seed = studio.dice.bits();
    let reach = 60.0 * studio.unit;
    let field = |s: &PaintingStudio, p: Vec2| {
        let own = s.along(p);
        let base = if follow { own } else { direction(lean) };
        turned(base, (noise(p / reach, seed) - 0.5) * 0.5)
    };
    let broken = studio.dice.range(0.4, 0.9);
    for (width, length, detail) in [(22.0, 1.4, 0.0), (13.0, 1.6, 0.07), (7.0, 1.8, 0.14)] {
        let mut pass = Pass::covering(width * studio.unit, length, detail);
        pass.brush = Brush {
            bristle: 0.22,
            relief: 0.1,
            taper: 0.0,
            square: true,
            ..pass.brush
        };
        pass.wander = 0.07;
        pass.clip = 0.5;
        pass.spacing *= 0.9;
        studio.lay(&pass, field, |s, c| s.broken(c, broken));
    }
    studio.canvas.light_relief(studio.light, 0.35, 0.3);
}

/// Skeins, drops and pools of enamel over a faint underpainting.
pub(super) fn drip(studio: &mut PaintingStudio) {
    let ground = studio.pigments.tone(studio.dice.range(0.5, 1.0));
    let under = if studio.dice.chance(0.5) {
        studio.dice.range(0.2, 0.9)
    } else {
        0.0
    };
    let seed = studio.dice.bits();
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let c = ground.lerp(sketch.at(p), under);
        textured(c, noise(p * 0.6, seed), 0.08)
    });
    let u = studio.unit;
    let gloss = studio.dice.range(0.0, 0.5);
    let skeins = (studio.area() * studio.dice.range(50.0, 150.0)) as usize + 1;
    let colours = studio.picks(studio.dice.count(3, 6));
    let size = studio.size();
    for _ in 0..skeins {
        let start = Vec2::new(studio.dice.range(-0.1, 1.1), studio.dice.range(-0.1, 1.1)) * size;
        let c = colours[studio.dice.index(colours.len())];
        skein(studio, start, c);
    }
    for _ in 0..skeins * 5 {
        let p = studio.anywhere();
        let c = colours[studio.dice.index(colours.len())];
        let t = studio.dice.unit();
        let radius = (0.6 + 5.0 * t * t * t * t) * u;
        studio.canvas.disc(p, radius, c, 0.95);
    }
    studio.canvas.light_relief(studio.light, gloss * 0.6, gloss);
}

/// One thrown line: curls with a changing curvature, thins and thickens, sheds drops.
fn skein(studio: &mut PaintingStudio, start: Vec2, c: Vec3) {
    let u = studio.unit;
    let (mut p, mut turn) = (start, studio.dice.unit());
    let mut curl = studio.dice.sway() * 0.05;
    let loose = studio.dice.range(0.006, 0.03);
    let mut width = studio.dice.range(1.2, 5.0) * u;
    for _ in 0..studio.dice.count(4, 14) {
        let mut path = vec![p];
        for _ in 0..5 {
            curl = curl * 0.92 + studio.dice.sway() * loose;
            turn += curl;
            p += direction(turn) * 5.0 * u;
            path.push(p);
        }
        width = (width * studio.dice.range(0.6, 1.55)).clamp(0.7 * u, 9.0 * u);
        let brush = Brush {
            width,
            bristle: 0.1,
            taper: 0.0,
            relief: 0.3,
            ..Brush::round(width)
        };
        studio.stroke(&path, &brush, c);
        if studio.dice.chance(0.3) {
            let aside = p + studio.dice.heading() * width * 3.0;
            let radius = width * studio.dice.range(0.2, 0.7);
            studio.canvas.disc(aside, radius, c, 1.0);
        }
    }
}
