//! Gold ground covered with ornament, figures left soft.

use super::studio::{PaintingStudio, textured};
use crate::canvas::Brush;
use crate::colour::lightness;
use crate::maths::{direction, from_whole, mix, smoothstep};
use crate::noise::{Cell, cell, fractal, hash_unit, noise};
use glam::{Vec2, Vec3};

/// Motifs that fill one cell of ornament.
const MOTIFS: u32 = 6;

/// Gold behind and on some garments, motifs in cells, spirals on top, leaf seams and dabs of light.
pub(super) fn gold_leaf(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let seed = studio.dice.bits();
    let gold =
        Vec3::new(0.8, 0.6, 0.22).lerp(studio.pigments.tone(0.7), studio.dice.range(0.05, 0.45));
    let size = (studio.dice.range(16.0, 30.0) * u).max(3.0);
    let leaf = studio.dice.range(30.0, 60.0) * u;
    let share = studio.dice.range(0.3, 0.75);
    let flats = studio.flats(0.8);
    let inks = studio.picks(5);
    let distance = studio.outlines(12.0);
    let dark = studio.pigments.ink(0.25);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let i = sketch.index(p);
        let region = usize::from(sketch.region[i]);
        let kind = if region == 0 {
            0.0
        } else {
            hash_unit(region as i32, 21, seed)
        };
        let sheen = gilded(p, gold, leaf, seed);
        if kind > share {
            return sketch.colour[i].lerp(sheen, 0.12 * noise(p / (6.0 * u), seed));
        }
        let spacing = size * if kind < share * 0.5 { 1.0 } else { 0.6 };
        let tile = cell(p, spacing, 0.35, true, seed ^ region as u32);
        let field = if kind < share * 0.4 {
            sheen
        } else {
            flats[region].lerp(sheen, 0.25)
        };
        let fits = hash_unit(tile.id as i32, 9, seed) < 0.8;
        let mark = if fits {
            motif(p, &tile, size * 0.5, u)
        } else {
            0.0
        };
        let ink = inks[(hash_unit(tile.id as i32, 4, seed) * 5.0) as usize % 5];
        let ink = if lightness(ink - field).abs() < 0.12 {
            dark
        } else {
            ink
        };
        field
            .lerp(ink, mark * 0.9)
            .lerp(dark, smoothstep(1.2 * u, 0.3 * u, distance[i]) * 0.8)
    });
    spirals(studio, dark, gold);
    studio.canvas.light_relief(studio.light, 0.35, 0.5);
}

/// Beaten gold: squares of leaf, seams, scratches, a wandering shine.
fn gilded(p: Vec2, gold: Vec3, leaf: f32, seed: u32) -> Vec3 {
    let square = (p / leaf).floor();
    let own = hash_unit(square.x as i32, square.y as i32, seed);
    let to_seam = from_whole(p.x / leaf).min(from_whole(p.y / leaf));
    let seam = smoothstep(0.0, 0.03, to_seam);
    let shine = fractal(p / (leaf * 0.7), 4, seed);
    let c = gold * mix(0.82, 1.1, own) * mix(0.8, 1.0, seam) * mix(0.65, 1.35, shine);
    let c = c + Vec3::new(1.0, 0.9, 0.6) * smoothstep(0.62, 0.8, shine) * 0.25;
    textured(c, noise(p * 0.8, seed), 0.08).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Ink share of the cell's motif at `p`: rings, eye, triangle, checks, dots or bars.
fn motif(p: Vec2, tile: &Cell, reach: f32, unit: f32) -> f32 {
    let axis = direction((tile.id >> 12) as f32 / 16.0 * 0.25);
    let q = (p - tile.site) / reach;
    let q = Vec2::new(q.dot(axis), q.perp_dot(axis));
    let r = q.length();
    let soft = (unit / reach).clamp(0.05, 0.5);
    let inside = |d: f32| smoothstep(soft, -soft, d);
    let body = inside(r - 0.85);
    match tile.id % MOTIFS {
        0 => body * inside(0.13 - from_whole(r * 2.2)),
        1 => {
            inside((q.x * q.x * 0.9 + q.y.abs()) - 0.6) * (1.0 - inside(r - 0.42)) + inside(r - 0.2)
        }
        2 => inside(q.y.abs().max(q.x.abs() + q.y * 0.5) - 0.6),
        3 => body * inside(-(q.x * 0.5 + 0.75).fract().min((q.y * 0.5 + 0.75).fract()) + 0.5),
        4 => inside((q.abs() - 0.4).length() - 0.2),
        _ => inside(q.x.abs() - 0.6) * inside(0.15 - from_whole(q.y * 1.8)),
    }
}

/// Curling tendrils in relief.
fn spirals(studio: &mut PaintingStudio, dark: Vec3, gold: Vec3) {
    let u = studio.unit;
    let bright = gold.lerp(Vec3::new(1.0, 0.92, 0.66), 0.5);
    let n = (studio.area() * studio.dice.range(0.0, 45.0)) as usize;
    for _ in 0..n {
        let centre = studio.anywhere();
        let r = studio.dice.range(8.0, 20.0) * u;
        let spin = if studio.dice.chance(0.5) { 1.0 } else { -1.0 };
        let start = studio.dice.unit();
        let path: Vec<Vec2> = (0..22)
            .map(|k| {
                let t = k as f32 / 21.0;
                centre + direction(start + spin * t * 2.2) * r * (1.0 - t * 0.92)
            })
            .collect();
        let c = if studio.dice.chance(0.5) {
            bright
        } else {
            dark
        };
        let brush = Brush {
            relief: 0.4,
            bristle: 0.1,
            taper: 0.3,
            ..Brush::round(2.2 * u)
        };
        studio.stroke(&path, &brush, c);
    }
}
