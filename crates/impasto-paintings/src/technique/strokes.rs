//! Techniques of brush strokes laid in passes, coarse to fine.

use super::contours::Contour;
use super::studio::{PaintingStudio, textured};
use crate::canvas::Brush;
use crate::colour::{hue_turned, lightness, saturated};
use crate::maths::{direction, from_whole, mix, smoothstep, turned};
use crate::noise::{cell, fractal, noise};
use glam::{Vec2, Vec3};

/// One layer of strokes over the whole picture.
pub(super) struct Pass {
    pub brush: Brush,
    /// Length of a stroke in pixels.
    pub length: f32,
    /// Distance between strokes in pixels.
    pub spacing: f32,
    /// Random turn of each stroke, in turns.
    pub wander: f32,
    /// Only where the sketch changes by at least this within a stroke's width; 0 = everywhere.
    pub detail: f32,
    /// A stroke ends where the sketch differs by more than this from its own colour.
    pub clip: f32,
}

impl Pass {
    /// Round strokes `width` wide and `length` widths long that cover the canvas, or what of it has
    /// at least some `detail`.
    pub(super) fn covering(width: f32, length: f32, detail: f32) -> Self {
        Self {
            brush: Brush::round(width),
            length: width * length,
            spacing: width * 0.75,
            wander: 0.06,
            detail,
            clip: 0.35,
        }
    }
}

impl PaintingStudio {
    /// Lays a pass. `field` gives the direction at a point; `mix_paint` the load for a sketch colour.
    pub(super) fn lay(
        &mut self,
        pass: &Pass,
        field: impl Fn(&Self, Vec2) -> Vec2,
        mix_paint: impl Fn(&Self, Vec3) -> Vec3,
    ) {
        for start in self.scatter(pass.spacing) {
            let want = self.sketch.at(start);
            if pass.detail > 0.0 && !self.dice.chance(0.06) {
                let reach = pass.brush.width * 1.3;
                if self.sketch.detail(start, reach) < pass.detail {
                    continue;
                }
            }
            let turn = self.dice.bell() * pass.wander;
            let length = pass.length * self.dice.range(0.6, 1.3);
            let path = self.trace(start, length, turn, pass, &field);
            let load = mix_paint(self, want);
            let brush = Brush {
                width: pass.brush.width * self.dice.range(0.75, 1.2),
                ..pass.brush
            };
            self.canvas.stroke(&path, &brush, load, self.dice.bits());
        }
    }

    /// Follows the field both ways from `start`, so that strokes are centred on their colour.
    fn trace(
        &self,
        start: Vec2,
        length: f32,
        turn: f32,
        pass: &Pass,
        field: impl Fn(&Self, Vec2) -> Vec2,
    ) -> Vec<Vec2> {
        let step = (pass.brush.width * 0.8).max(length / 8.0).max(0.5);
        let count = ((length * 0.5 / step).round() as usize).clamp(1, 12);
        let own = self.sketch.at(start);
        let first = turned(field(self, start), turn);
        let mut path = Vec::with_capacity(2 * count + 1);
        for sign in [-1.0, 1.0] {
            let (mut p, mut heading) = (start, first * sign);
            let mut half = Vec::with_capacity(count);
            for _ in 0..count {
                let along = turned(field(self, p), turn);
                let along = if along.dot(heading) < 0.0 {
                    -along
                } else {
                    along
                };
                heading = (heading + along * 0.8).normalize_or(heading);
                p += heading * step;
                if self.sketch.at(p).distance(own) > pass.clip {
                    break;
                }
                half.push(p);
            }
            if sign < 0.0 {
                path.extend(half.into_iter().rev());
                path.push(start);
            } else {
                path.extend(half);
            }
        }
        if path.len() == 1 {
            path.push(start + first * step * 0.7);
        }
        path
    }

    /// Brush lines along the outlines of larger things.
    fn brush_lines(&mut self, width: f32, ink: Vec3, share: f32) {
        let brush = Brush {
            bristle: 0.4,
            taper: 0.5,
            ..Brush::round(width)
        };
        let contour = Contour {
            least: 14.0,
            length: 45.0 * self.unit,
            share,
            brush,
            heaviest: 2.6,
        };
        self.draw_contours(&contour, ink);
    }
}

/// Three passes of short broken strokes with bits of the complement.
pub(super) fn impressionist(studio: &mut PaintingStudio) {
    let ground = studio.pigments.tone(studio.dice.range(0.4, 1.0));
    studio.canvas.each(|_, _| ground);
    let wander = studio.dice.range(0.02, 0.16);
    let broken = studio.dice.range(0.5, 1.0);
    let relief = studio.dice.range(0.0, 0.16);
    let length = studio.dice.range(1.6, 3.6);
    let broken_paint = move |s: &PaintingStudio, c: Vec3| {
        let c = if s.dice.chance(0.07) {
            hue_turned(c, 0.5).lerp(c, 0.3)
        } else {
            c
        };
        s.broken(c, broken)
    };
    for (width, detail) in [(12.0, 0.0), (7.5, 0.06), (4.8, 0.13)] {
        let mut pass = Pass::covering(width * studio.unit, length, detail);
        pass.brush.relief = relief;
        pass.brush.bristle = 0.4;
        pass.wander = wander;
        studio.lay(&pass, PaintingStudio::along, broken_paint);
    }
    studio.canvas.light_relief(studio.light, 0.3, 0.25);
}

/// Long thick strokes around whirls, alternating light and dark.
pub(super) fn swirl(studio: &mut PaintingStudio) {
    let size = studio.size();
    let whirls: Vec<(Vec2, f32, f32)> = (0..studio.dice.count(3, 8))
        .map(|_| {
            let centre = Vec2::new(studio.dice.unit(), studio.dice.range(0.0, 0.8)) * size;
            let spin = if studio.dice.chance(0.5) { 1.0 } else { -1.0 };
            let reach = size.min_element() * studio.dice.range(0.08, 0.22);
            (centre, reach, spin)
        })
        .collect();
    let seed = studio.dice.bits();
    let period = size.min_element() * 0.4;
    let field = |s: &PaintingStudio, p: Vec2| {
        let mut d = s.along(p) * 0.35 + direction(noise(p / period, seed) * 1.4) * 0.45;
        for (centre, reach, spin) in &whirls {
            let arm = p - *centre;
            let near = 1.0 / (1.0 + arm.length_squared() / (reach * reach));
            d += (arm.perp() * *spin + arm * 0.15).normalize_or_zero() * near * near * 4.0;
        }
        d.normalize_or(Vec2::X)
    };
    let dark = studio.pigments.tone(0.1);
    studio.canvas.each(|_, _| dark);
    let swing = studio.dice.range(0.2, 0.45);
    let length = studio.dice.range(3.5, 7.0);
    for (width, detail) in [(11.0, 0.0), (6.5, 0.0), (4.5, 0.1)] {
        let mut pass = Pass::covering(width * studio.unit, length, detail);
        pass.brush = Brush {
            bristle: 0.45,
            relief: 0.16,
            taper: 0.3,
            ..pass.brush
        };
        pass.clip = 0.4;
        pass.wander = 0.015;
        studio.lay(&pass, field, |s, c| {
            let lifted = c * (1.0 + s.dice.sway() * swing) + s.dice.sway() * 0.06;
            s.broken(lifted.clamp(Vec3::ZERO, Vec3::ONE), 0.5)
        });
    }
    studio.canvas.light_relief(studio.light, 0.3, 0.3);
}

/// Big flat patches of pure colour, gaps of bare ground, coloured contours.
pub(super) fn fauvist(studio: &mut PaintingStudio) {
    let ground = studio.pigments.paper(0.85);
    let seed = studio.dice.bits();
    studio
        .canvas
        .each(|p, _| textured(ground, noise(p * 0.7, seed), 0.05));
    let shift = studio.dice.range(-0.12, 0.12);
    let push = studio.dice.range(1.2, 1.8);
    let gaps = studio.dice.range(0.6, 0.95);
    for (width, length, detail) in [(17.0, 2.0, 0.0), (10.0, 2.0, 0.08), (5.5, 2.5, 0.14)] {
        let mut pass = Pass::covering(width * studio.unit, length, detail);
        pass.brush = Brush {
            bristle: 0.3,
            taper: 0.15,
            grain: 0.25,
            relief: 0.03,
            ..pass.brush
        };
        pass.spacing = width * studio.unit * gaps;
        pass.wander = 0.08;
        pass.clip = 0.28;
        studio.lay(&pass, PaintingStudio::along, |s, c| {
            let pure = saturated(hue_turned(c, shift), push).clamp(Vec3::ZERO, Vec3::ONE);
            let pure = pure.lerp(s.pigments.nearest(pure), 0.65);
            s.broken(pure, 0.4)
        });
    }
    let ink = studio.pigments.ink(0.22);
    let share = studio.dice.range(0.0, 0.8);
    studio.brush_lines(2.2 * studio.unit, ink, share);
    studio.canvas.light_relief(studio.light, 0.25, 0.1);
}

/// Angular slashes in clashing colours with black contours.
pub(super) fn expressionist(studio: &mut PaintingStudio) {
    let dark = studio.pigments.ink(0.15);
    studio.canvas.each(|_, _| dark);
    let (seed, size) = (studio.dice.bits(), 46.0 * studio.unit);
    let angular = |s: &PaintingStudio, p: Vec2| {
        // One direction per facet, near the form's own.
        let id = cell(p, size, 1.0, false, seed).id;
        turned(s.along(p), ((id >> 8) & 7) as f32 / 8.0 * 0.3 - 0.15)
    };
    let clash = studio.dice.range(0.5, 1.0);
    for (width, detail) in [(12.0, 0.0), (6.5, 0.1)] {
        let mut pass = Pass::covering(width * studio.unit, 4.0, detail);
        pass.brush = Brush {
            bristle: 0.6,
            taper: 0.1,
            relief: 0.07,
            grain: 0.2,
            square: true,
            ..pass.brush
        };
        pass.clip = 0.3;
        studio.lay(&pass, angular, |s, c| {
            let strong = ((saturated(c, 1.3) - 0.5) * 1.2 + 0.5).clamp(Vec3::ZERO, Vec3::ONE);
            let other = if s.dice.chance(0.15) {
                s.pigments.pick(&s.dice)
            } else {
                strong
            };
            s.broken(other, clash)
        });
    }
    studio.brush_lines(2.8 * studio.unit, dark, 0.75);
    studio.canvas.light_relief(studio.light, 0.35, 0.15);
}

/// Fine strokes, one pool of light, dark glaze, weave and cracks.
pub(super) fn old_master(studio: &mut PaintingStudio) {
    let glaze = pool_of_light(studio);
    studio.canvas.each(|_, _| glaze);
    for (stroke, opacity, detail) in [(9.0, 0.9, 0.0), (5.0, 0.7, 0.02), (2.8, 0.7, 0.07)] {
        let mut pass = Pass::covering(stroke * studio.unit, 3.0, detail);
        pass.brush = Brush {
            opacity,
            bristle: 0.2,
            ..pass.brush
        };
        pass.clip = 0.16;
        studio.lay(&pass, PaintingStudio::along, |s, c| s.broken(c, 0.15));
    }
    // Glazing evens the strokes out; the brush shows again only in the lights.
    let evened = studio.dice.range(0.0, 1.7) * studio.unit;
    studio.canvas.blur(evened as usize);
    body_colour(studio);
    studio.canvas.light_relief(studio.light, 0.3, 0.1);
    let (crack, seed) = (studio.dice.unit() * 0.3, studio.dice.bits());
    let (cells, unit) = (20.0 * studio.unit, studio.unit);
    studio.canvas.each(|p, c| {
        let q = p + Vec2::splat(fractal(p / (9.0 * unit), 2, seed) * 9.0 * unit);
        let line = smoothstep(0.7 * unit, 0.0, cell(q, cells, 1.0, false, seed).border);
        let weave = from_whole(p.x / (2.4 * unit)) + from_whole(p.y / (2.4 * unit));
        c * (1.0 - crack * line) * mix(0.97, 1.03, weave)
    });
}

/// Darkens the sketch away from one place; tells the glaze that it does so with.
fn pool_of_light(studio: &mut PaintingStudio) -> Vec3 {
    let size = studio.size();
    let focus = Vec2::new(studio.dice.range(0.3, 0.7), studio.dice.range(0.25, 0.6)) * size;
    let reach = size.length() * studio.dice.range(0.25, 0.5);
    let floor = studio.dice.range(0.12, 0.5);
    let umber = Vec3::new(0.09, 0.06, 0.035);
    let glaze = studio.pigments.ink(0.12).lerp(umber, 0.5);
    let width = studio.sketch.width;
    for (i, c) in studio.sketch.colour.iter_mut().enumerate() {
        let p = Vec2::new((i % width) as f32, (i / width) as f32);
        let away = (p - focus).length_squared() / (reach * reach);
        let light = mix(floor, 1.0, 1.0 / (1.0 + away * 1.5));
        *c = glaze.lerp(saturated(*c, 0.85), smoothstep(0.0, 1.0, light));
    }
    glaze
}

/// Thick touches in the lights.
fn body_colour(studio: &mut PaintingStudio) {
    let bright = studio.dice.range(0.5, 0.75);
    let relief = studio.dice.range(0.0, 0.12);
    let tones = studio.sketch.tones();
    let brush = Brush {
        opacity: 0.7,
        relief,
        ..Brush::round(4.0 * studio.unit)
    };
    for p in studio.scatter(6.0 * studio.unit) {
        let i = studio.sketch.index(p);
        if tones[i] > bright && studio.sketch.detail(p, 4.0 * studio.unit) < 0.1 {
            let half = studio.along(p) * 4.0 * studio.unit;
            let c = studio.broken(studio.sketch.colour[i] * 1.05, 0.12);
            studio.stroke(&[p - half, p + half], &brush, c);
        }
    }
}

/// Opaque matt paint: few tones per form, crisp edges, dry drags of the brush.
pub(super) fn gouache(studio: &mut PaintingStudio) {
    let steps = studio.dice.range(3.0, 6.0).floor();
    let flats = studio.flats(0.5);
    for (c, r) in studio.sketch.colour.iter_mut().zip(&studio.sketch.region) {
        let flat = flats[usize::from(*r)];
        let tone = lightness(*c) - lightness(flat);
        let stepped = (tone * steps * 2.0).round() / (steps * 2.0);
        *c = (flat + stepped).clamp(Vec3::ZERO, Vec3::ONE);
    }
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| sketch.at(p));
    let mut pass = Pass::covering(9.0 * studio.unit, 4.5, 0.0);
    pass.brush = Brush {
        bristle: 0.35,
        grain: 0.45,
        taper: 0.2,
        square: true,
        ..pass.brush
    };
    pass.wander = 0.02;
    pass.clip = 0.1;
    let broken = studio.dice.range(0.2, 0.55);
    studio.lay(&pass, PaintingStudio::along, |s, c| s.broken(c, broken));
    let seed = studio.dice.bits();
    studio
        .canvas
        .each(|p, c| textured(c, noise(p * 0.8, seed), 0.03));
}
