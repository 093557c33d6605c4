//! Dots and dry sticks: pointillism, pastel, chalk drawing.

use super::contours::Contour;
use super::strokes::Pass;
use super::studio::{PaintingStudio, textured};
use crate::canvas::Brush;
use crate::colour::{hue_turned, saturated};
use crate::maths::{direction, smoothstep};
use crate::noise::fractal;
use glam::{Vec2, Vec3};

/// Dots of near-pure pigment whose average is the sketch.
pub(super) fn pointillism(studio: &mut PaintingStudio) {
    let ground = studio.pigments.paper(0.75);
    let sketch = &studio.sketch;
    let show = studio.dice.range(0.15, 0.6);
    studio.canvas.each(|p, _| ground.lerp(sketch.at(p), show));
    let (purity, dash) = (studio.dice.range(0.25, 0.6), studio.dice.range(0.05, 0.9));
    let size = studio.dice.range(3.6, 6.2);
    for (width, spacing) in [(1.25, 0.92), (1.0, 0.95), (0.75, 1.2)] {
        let w = width * size * studio.unit;
        for p in studio.scatter(spacing * w) {
            let want = studio.sketch.at(p);
            let c = divided(studio, want, purity);
            let along = studio.along(p);
            let half = along * w * 0.5 * dash;
            let brush = Brush {
                bristle: 0.1,
                taper: 0.0,
                relief: 0.12,
                ..Brush::round(w * studio.dice.range(0.7, 1.15))
            };
            studio.stroke(&[p - half, p + half], &brush, c);
        }
    }
    studio.canvas.light_relief(studio.light, 0.3, 0.1);
}

/// A pure colour standing for `want`: warmer, cooler, lighter or darker, now and then its complement.
fn divided(studio: &PaintingStudio, want: Vec3, purity: f32) -> Vec3 {
    let dice = &studio.dice;
    let pure = match dice.index(8) {
        0 => hue_turned(want, 0.5),
        1 | 2 => hue_turned(want, 0.09),
        3 | 4 => hue_turned(want, -0.09),
        5 => studio.pigments.pick(dice),
        _ => studio.pigments.nearest(want),
    };
    let pure = saturated(pure, 1.4).clamp(Vec3::ZERO, Vec3::ONE);
    let c = want.lerp(pure, purity * dice.range(0.4, 1.4));
    (c * dice.range(0.85, 1.18)).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Grainy strokes in many directions on toned paper, with rubbed passages underneath.
pub(super) fn pastel(studio: &mut PaintingStudio) {
    let paper = studio.pigments.tone(studio.dice.range(0.1, 0.9));
    let (seed, unit, rub) = (studio.dice.bits(), studio.unit, studio.dice.range(0.2, 0.7));
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let c = paper.lerp(sketch.at(p), rub);
        textured(c, fractal(p * 0.5, 2, seed), 0.1)
    });
    studio.canvas.blur((2.0 * unit) as usize);
    let slant = direction(studio.dice.unit());
    let loyal = studio.dice.range(0.2, 1.0);
    for (width, grain, detail) in [(8.0, 0.5, 0.0), (5.5, 0.55, 0.06), (3.2, 0.5, 0.12)] {
        let mut pass = Pass::covering(width * unit, 5.0, detail);
        pass.brush = Brush {
            grain,
            bristle: 0.3,
            opacity: 0.9,
            taper: 0.3,
            ..pass.brush
        };
        pass.clip = 0.3;
        pass.wander = 0.03;
        let field = |s: &PaintingStudio, p: Vec2| slant.lerp(s.along(p), loyal).normalize_or(slant);
        studio.lay(&pass, field, |s, c| s.broken(c, 0.6));
    }
}

/// Contours, parallel hatching for shade, white heightening, one chalk on toned paper.
pub(super) fn drawing(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let chalk = if studio.dice.chance(0.6) {
        studio.pigments.ink(0.25)
    } else {
        studio.pigments.accent() * 0.75
    };
    let paper = studio.pigments.paper(studio.dice.range(0.55, 0.92));
    let (seed, tint) = (studio.dice.bits(), studio.dice.unit() * 0.35);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let c = textured(paper, fractal(p * 0.12, 4, seed), 0.09);
        c * Vec3::ONE.lerp(sketch.at(p), tint)
    });
    studio.canvas.blur((2.5 * u) as usize);
    let tones = studio.stretched_tones();
    let mean = tones.iter().sum::<f32>() / tones.len() as f32;
    let slant = direction(studio.dice.range(0.1, 0.4));
    let width = studio.dice.range(1.5, 3.0) * u;
    let straight = slant.normalize_or(slant);
    hatch(studio, straight, width, mean + 0.05, &tones, chalk);
    let crossed = (slant + slant.perp() * 0.6).normalize_or(slant);
    hatch(studio, crossed, width, mean - 0.12, &tones, chalk);
    if studio.dice.chance(0.5) {
        let white = paper.lerp(Vec3::ONE, 0.8);
        heighten(studio, slant.perp(), mean + 0.2, &tones, white);
    }
    outlines(studio, chalk, 1.3 * u);
}

/// Parallel strokes along `heading`, denser and stronger the more the tone is below `limit`.
fn hatch(
    studio: &mut PaintingStudio,
    heading: Vec2,
    width: f32,
    limit: f32,
    tones: &[f32],
    chalk: Vec3,
) {
    let u = studio.unit;
    for p in studio.scatter(width * 2.0) {
        let dark = smoothstep(limit, limit - 0.35, tones[studio.sketch.index(p)]);
        if !studio.dice.chance(dark) {
            continue;
        }
        let half = heading * studio.dice.range(5.0, 11.0) * u;
        let bend = heading.perp() * studio.dice.sway() * 1.5 * u;
        let brush = Brush {
            grain: 0.5,
            opacity: 0.35 + 0.5 * dark,
            ..Brush::round(width)
        };
        studio.stroke(&[p - half, p + bend, p + half], &brush, chalk);
    }
}

/// Light strokes along `heading` where the tone is above `limit`.
fn heighten(studio: &mut PaintingStudio, heading: Vec2, limit: f32, tones: &[f32], white: Vec3) {
    let u = studio.unit;
    let brush = Brush {
        grain: 0.5,
        opacity: 0.7,
        ..Brush::round(2.5 * u)
    };
    for p in studio.scatter(4.0 * u) {
        if tones[studio.sketch.index(p)] > limit {
            let half = heading * studio.dice.range(3.0, 8.0) * u;
            studio.stroke(&[p - half, p + half], &brush, white);
        }
    }
}

/// Searching contour lines of uneven weight.
fn outlines(studio: &mut PaintingStudio, chalk: Vec3, width: f32) {
    let brush = Brush {
        grain: 0.35,
        opacity: 0.85,
        taper: 0.5,
        ..Brush::round(width)
    };
    let length = studio.dice.range(18.0, 60.0) * studio.unit;
    let contour = Contour {
        least: 2.0,
        length,
        share: 0.92,
        brush,
        heaviest: 2.4,
    };
    studio.draw_contours(&contour, chalk);
}
