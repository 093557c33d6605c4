//! Flat colour: cut paper and geometric abstraction.

use super::studio::{PaintingStudio, textured};
use crate::canvas::Brush;
use crate::maths::{direction, from_whole, mix, smoothstep, wave};
use crate::noise::{fractal, hash_unit, noise};
use glam::{Vec2, Vec3};

/// Regions as sheets of painted paper, each casting a shadow on those below; fronds on top.
pub(super) fn cut_paper(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let flats = studio.flats(1.0);
    let seed = studio.dice.bits();
    let cast = studio.light * -studio.dice.range(1.0, 4.0) * u;
    let brushed = studio.dice.range(0.02, 0.16);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let r = sketch.region[sketch.index(p)];
        let turn = direction(hash_unit(i32::from(r), 2, seed));
        let brushed_along = Vec2::new(p.dot(turn) / (26.0 * u), p.dot(turn.perp()) / (3.0 * u));
        let gouache = fractal(brushed_along, 2, seed);
        let c = textured(flats[usize::from(r)], gouache, brushed);
        let covered = [0.4f32, 0.7, 1.0]
            .iter()
            .filter(|k| sketch.region[sketch.index(p - cast * **k)] > r)
            .count();
        c * (1.0 - 0.14 * covered as f32)
    });
    for _ in 0..studio.dice.count(0, 14) {
        frond(studio, cast);
    }
    studio
        .canvas
        .each(|p, c| textured(c, noise(p * 0.7, seed), 0.03).min(Vec3::ONE));
}

/// A lobed, seaweed-like cut-out with its shadow.
fn frond(studio: &mut PaintingStudio, cast: Vec2) {
    let centre = studio.anywhere();
    let r = studio.dice.range(12.0, 34.0) * studio.unit;
    let (lobes, depth) = (studio.dice.count(3, 9) as f32, studio.dice.range(0.3, 0.75));
    let (start, squash) = (studio.dice.unit(), studio.dice.range(0.5, 1.0));
    let axis = studio.dice.heading();
    let points: Vec<Vec2> = (0..56)
        .map(|k| {
            let t = k as f32 / 56.0;
            let reach = r * (1.0 - depth * (0.5 + 0.5 * wave(t * lobes + start)));
            let d = direction(t);
            centre + (axis * d.x + axis.perp() * d.y * squash) * reach
        })
        .collect();
    let shadow: Vec<Vec2> = points.iter().map(|p| *p + cast * 0.7).collect();
    studio.canvas.fill(&shadow, Vec3::ZERO, 0.3);
    let c = studio.pick();
    studio.canvas.fill(&points, c, 1.0);
}

/// One of several schools of abstraction.
pub(super) fn geometric(studio: &mut PaintingStudio) {
    match studio.dice.index(5) {
        0 => grid(studio),
        1 => fields(studio),
        2 => discs(studio),
        3 => bars(studio),
        _ => stripes(studio),
    }
    let (seed, weave) = (studio.dice.bits(), studio.dice.range(0.01, 0.08));
    let u = studio.unit;
    studio.canvas.each(|p, c| {
        let cloth = from_whole(p.x / (2.6 * u)) + from_whole(p.y / (2.6 * u));
        let thread = noise(Vec2::new(p.x / (20.0 * u), p.y / (2.2 * u)), seed);
        let c = textured(c, thread, weave);
        (c * mix(1.0 - weave, 1.0 + weave, cloth)).clamp(Vec3::ZERO, Vec3::ONE)
    });
}

/// Rectangles between black lines.
fn grid(studio: &mut PaintingStudio) {
    let mut boxes = vec![(Vec2::ZERO, studio.size())];
    let least = studio.dice.range(24.0, 60.0) * studio.unit;
    let mut k = 0;
    while k < boxes.len() && boxes.len() < 300 {
        let (low, high) = boxes[k];
        let side = high - low;
        let t = studio.dice.range(0.25, 0.75);
        if side.max_element() < least * studio.dice.range(1.2, 3.0) {
            k += 1;
            continue;
        }
        let (cut, rest) = if side.x > side.y {
            let x = low.x + side.x * t;
            (Vec2::new(x, high.y), Vec2::new(x, low.y))
        } else {
            let y = low.y + side.y * t;
            (Vec2::new(high.x, y), Vec2::new(low.x, y))
        };
        boxes[k] = (low, cut);
        boxes.push((rest, high));
    }
    let line = studio.dice.range(1.5, 5.0) * studio.unit;
    let (ink, paper) = (studio.pigments.ink(0.15), studio.pigments.paper(0.82));
    let plain = studio.dice.range(0.1, 0.7);
    studio.canvas.each(|_, _| ink);
    for (low, high) in boxes {
        let c = if studio.dice.chance(plain) {
            paper
        } else {
            studio.pick()
        };
        let (a, b) = (low + line * 0.5, high - line * 0.5);
        let corners = [a, Vec2::new(b.x, a.y), b, Vec2::new(a.x, b.y)];
        studio.canvas.fill(&corners, c, 1.0);
    }
}

/// Soft-edged fields hovering on a ground.
fn fields(studio: &mut PaintingStudio) {
    let size = studio.size();
    let (ground, seed) = (studio.pick(), studio.dice.bits());
    let n = studio.dice.count(2, 4);
    let bands: Vec<(f32, f32, Vec3)> = (0..n)
        .map(|k| {
            let (a, b) = (k as f32 / n as f32, (k + 1) as f32 / n as f32);
            (
                mix(a, b, studio.dice.range(0.08, 0.2)),
                mix(a, b, studio.dice.range(0.75, 0.95)),
                studio.pick(),
            )
        })
        .collect();
    let edge = studio.dice.range(0.01, 0.05);
    let u = studio.unit;
    studio.canvas.each(|p, _| {
        let fray = (fractal(p / (12.0 * u), 4, seed) - 0.5) * 0.06;
        let q = p / size + fray;
        let cloud = fractal(p / (30.0 * u), 4, seed ^ 1);
        let mut c = textured(ground, cloud, 0.18);
        for (top, bottom, field) in &bands {
            let inside = smoothstep(top - edge, top + edge, q.y)
                * smoothstep(bottom + edge, bottom - edge, q.y)
                * smoothstep(0.08 - edge, 0.08 + edge, q.x)
                * smoothstep(0.92 + edge, 0.92 - edge, q.x);
            let cover = inside * mix(0.75, 1.0, cloud);
            c = c.lerp(textured(*field, cloud, 0.25), cover);
        }
        c
    });
}

/// Concentric rings cut into coloured sectors.
fn discs(studio: &mut PaintingStudio) {
    let centres: Vec<(Vec2, f32)> = (0..studio.dice.count(1, 7))
        .map(|_| (studio.anywhere(), studio.dice.unit()))
        .collect();
    let seed = studio.dice.bits();
    let ring = studio.dice.range(8.0, 22.0) * studio.unit;
    let inks = studio.picks(8);
    studio.canvas.each(|p, _| {
        let mut best = (f32::INFINITY, 0usize);
        for (k, (centre, _)) in centres.iter().enumerate() {
            let d = p.distance(*centre);
            if d < best.0 {
                best = (d, k);
            }
        }
        let (d, k) = best;
        let band = (d / ring).floor();
        let axis = direction(centres[k].1);
        let q = p - centres[k].0;
        let quarter = i32::from(q.dot(axis) > 0.0) + 2 * i32::from(q.perp_dot(axis) > 0.0);
        let pick = hash_unit(band as i32 * 4 + quarter, k as i32, seed);
        let inside = (d / ring - band).min(1.0 + band - d / ring) * ring;
        let edge = smoothstep(0.0, 1.2, inside + 0.4);
        inks[(pick * 8.0) as usize % 8] * mix(0.8, 1.0, edge)
    });
}

/// Bars, discs and wedges floating on paper along a diagonal.
fn bars(studio: &mut PaintingStudio) {
    let (paper, u) = (studio.pigments.paper(0.78), studio.unit);
    studio.canvas.each(|_, _| paper);
    let lean = studio.dice.unit();
    for _ in 0..studio.dice.count(10, 34) {
        let at = studio.anywhere();
        let turn = if studio.dice.chance(0.75) {
            lean
        } else {
            lean + 0.25
        };
        let axis = direction(turn + studio.dice.bell() * 0.02);
        let c = studio.pick();
        let l = studio.dice.range(10.0, 80.0) * u;
        let w = studio.dice.range(2.0, 22.0) * u;
        match studio.dice.index(5) {
            0 => studio.canvas.disc(at, w * 1.3, c, 0.95),
            1 => {
                let corners = [at + axis * l, at + axis.perp() * w, at - axis.perp() * w];
                studio.canvas.fill(&corners, c, 0.95);
            }
            2 => {
                let line = Brush {
                    taper: 0.0,
                    bristle: 0.0,
                    ..Brush::round(1.5 * u)
                };
                let path = [at - axis * l, at + axis * l];
                studio.canvas.stroke(&path, &line, c, 1);
            }
            _ => {
                let (a, b) = (axis * l * 0.5, axis.perp() * w * 0.5);
                let corners = [at - a - b, at + a - b, at + a + b, at - a + b];
                studio.canvas.fill(&corners, c, 0.95);
            }
        }
    }
}

/// Undulating stripes whose width follows the sketch: optical art.
fn stripes(studio: &mut PaintingStudio) {
    let spacing = studio.dice.range(8.0, 22.0) * studio.unit;
    let across = studio.dice.heading();
    let (seed, u) = (studio.dice.bits(), studio.unit);
    let inks = studio.picks(studio.dice.count(2, 6));
    let (dark, light) = (studio.pigments.dark(), studio.pigments.light());
    let bulge = studio.dice.range(0.0, 9.0);
    studio.canvas.each(|p, _| {
        let phase = p.dot(across) / spacing + fractal(p / (90.0 * u), 2, seed) * bulge;
        let lane = phase.floor();
        let c = inks[(hash_unit(lane as i32, 1, seed) * inks.len() as f32) as usize % inks.len()];
        let (base, next) = if (lane as i32) & 1 == 0 {
            (light.lerp(c, 0.7), dark)
        } else {
            (dark.lerp(c, 0.6), light)
        };
        let edge = (1.0 - (phase - lane)) * spacing;
        base.lerp(next, 0.5 * (1.0 - edge.clamp(0.0, 1.0)))
    });
}
