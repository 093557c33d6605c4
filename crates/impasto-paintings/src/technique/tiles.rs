//! Pictures built of pieces: mosaic, stained glass, cubist facets, tapestry.

use super::studio::{PaintingStudio, textured};
use crate::canvas::{Brush, bounds};
use crate::colour::saturated;
use crate::maths::{direction, from_whole, mix, smoothstep, wave};
use crate::noise::{Cell, cell, drift, fractal, hash_unit, noise};
use glam::{Vec2, Vec3};

fn own(cell: &Cell, k: u32) -> f32 {
    hash_unit(cell.id as i32, k as i32, 17)
}

/// Tesserae of slightly varied colour and tilt, bent rows, grout between.
pub(super) fn mosaic(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let size = (studio.dice.range(6.0, 10.5) * u).max(2.0);
    let seed = studio.dice.bits();
    let grout = if studio.dice.chance(0.6) {
        studio.pigments.tone(studio.dice.range(0.0, 0.25)) * 0.8
    } else {
        studio.pigments.paper(0.7)
    };
    let gap = size * studio.dice.range(0.05, 0.11);
    let (jitter, bend) = (studio.dice.range(0.05, 0.6), studio.dice.range(0.3, 2.2));
    let stagger = studio.dice.chance(0.4);
    let gold = if studio.dice.chance(0.3) { 0.3 } else { 0.0 };
    let light = studio.light;
    let vary = studio.dice.range(0.12, 0.4);
    let (sketch, pigments) = (&studio.sketch, &studio.pigments);
    studio.canvas.each(|p, _| {
        // Rows are bent by warping the plane before it is cut into cells.
        let warp = drift(p / (size * 9.0), 2, seed) * size * bend;
        let tile = cell(p + warp, size, jitter, stagger, seed);
        let centre = tile.site - warp;
        let want = sketch.at(centre);
        let snapped = want.lerp(pigments.nearest(want), 0.4 * own(&tile, 1));
        let mut c =
            snapped * mix(1.0 - vary, 1.0 + vary, own(&tile, 2)) + (own(&tile, 3) - 0.5) * 0.06;
        if own(&tile, 4) < gold {
            c = c.lerp(Vec3::new(0.85, 0.66, 0.28), 0.7);
        }
        let tilt = (p - centre).dot(light) / size * (own(&tile, 5) - 0.2) * 0.5;
        let worn = textured(c * (1.0 + tilt), noise(p * 0.5, seed), 0.07);
        let bed = textured(grout, noise(p * 0.6, seed ^ 1), 0.15);
        bed.lerp(worn, smoothstep(gap - 0.5, gap + 0.5, tile.border))
            .clamp(Vec3::ZERO, Vec3::ONE)
    });
}

/// Panes of saturated glass, brighter in the middle, in black lead.
pub(super) fn stained_glass(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let size = (studio.dice.range(22.0, 42.0) * u).max(3.0);
    let lead = (studio.dice.range(1.0, 2.2) * u).max(0.6);
    let seed = studio.dice.bits();
    let flats = studio.flats(0.6);
    let distance = studio.outlines(12.0);
    let (bend, push) = (studio.dice.range(0.1, 0.6), studio.dice.range(1.2, 1.8));
    let (sketch, pigments) = (&studio.sketch, &studio.pigments);
    studio.canvas.each(|p, _| {
        let warp = drift(p / (size * 1.5), 2, seed) * size * bend;
        let pane = cell(p + warp, size, 1.0, true, seed);
        let i = sketch.index(p);
        let region = usize::from(sketch.region[i]);
        let key = (pane.id ^ (region as u32).wrapping_mul(0x9e37_79b9)) as i32;
        let base = flats[region].lerp(sketch.at(pane.site - warp), 0.3);
        let swapped = if hash_unit(key, 1, seed) < 0.2 {
            pigments.nearest(base.lerp(pigments.accent(), 0.6))
        } else {
            base
        };
        let pure = saturated(swapped, push).clamp(Vec3::splat(0.03), Vec3::ONE);
        let blown = Vec2::new(p.x / (5.0 * u), p.y / (18.0 * u));
        let streak = fractal(blown, 3, seed ^ key as u32);
        let deep = smoothstep(0.0, size * 0.3, pane.border.min(distance[i]));
        let glow =
            mix(0.6, 1.2, deep) * mix(0.75, 1.25, hash_unit(key, 2, seed)) * mix(0.8, 1.2, streak);
        let c = (pure * glow + deep * 0.05).clamp(Vec3::ZERO, Vec3::ONE);
        let edge = pane.border.min(distance[i] * 0.8);
        let rounded = 0.05 + 0.12 * smoothstep(lead, 0.0, edge);
        Vec3::splat(rounded).lerp(c, smoothstep(lead - 0.5, lead + 0.7, edge))
    });
}

/// Convex pieces of the picture, shifted against one another, shaded from one edge.
pub(super) fn cubist(studio: &mut PaintingStudio) {
    let Vec2 { x: w, y: h } = studio.size();
    let u = studio.unit;
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
    let whole = corners.map(Vec2::from).to_vec();
    let lead = studio.dice.unit();
    let mut facets = Vec::new();
    let least = studio.dice.range(14.0, 26.0) * u;
    split(studio, whole, least, lead, 0, &mut facets);
    let muted = studio.dice.range(0.6, 1.1);
    let shift = studio.dice.range(6.0, 24.0) * u;
    let seed = studio.dice.bits();
    let (dark, pale) = (studio.pigments.dark(), studio.pigments.light());
    for (k, facet) in facets.iter().enumerate() {
        let offset = studio.dice.heading() * shift * studio.dice.unit();
        let normal = studio.dice.heading();
        let middle = facet.iter().sum::<Vec2>() / facet.len() as f32;
        let reach = facet.iter().map(|p| p.distance(middle)).fold(1.0, f32::max);
        let flat = studio.sketch.at(middle + offset);
        let strength = studio.dice.range(0.1, 0.6);
        let own = studio
            .pigments
            .nearest(flat)
            .lerp(flat, studio.dice.range(0.3, 1.0));
        let side = if studio.dice.chance(0.5) { dark } else { pale };
        let grain = normal.perp();
        let sketch = &studio.sketch;
        studio.canvas.polygon(facet, |p| {
            let seen = saturated(sketch.at(p + offset).lerp(own, 0.4), muted);
            let t = ((p - middle).dot(normal) / reach * 0.5 + 0.5).clamp(0.0, 1.0);
            let c = seen.lerp(side, t * t * strength);
            let stroked = Vec2::new(p.dot(grain) / (9.0 * u), p.dot(normal) / (2.6 * u));
            let touch = noise(stroked, seed ^ k as u32);
            (textured(c, touch, 0.14).clamp(Vec3::ZERO, Vec3::ONE), 1.0)
        });
    }
    let ink = studio.pigments.ink(0.2);
    for facet in &facets {
        for k in 0..facet.len() {
            if studio.dice.chance(0.45) {
                let brush = Brush {
                    opacity: studio.dice.range(0.3, 0.9),
                    ..Brush::round(studio.dice.range(0.8, 2.0) * u)
                };
                let path = [facet[k], facet[(k + 1) % facet.len()]];
                studio.stroke(&path, &brush, ink);
            }
        }
    }
}

/// Cuts a convex polygon by lines near its middle until the pieces are about `least` across.
fn split(
    studio: &PaintingStudio,
    piece: Vec<Vec2>,
    least: f32,
    lead: f32,
    depth: usize,
    out: &mut Vec<Vec<Vec2>>,
) {
    let (low, high) = bounds(&piece, 0.0);
    let extent = high - low;
    let target = least * studio.dice.range(1.0, 2.6);
    if depth > 9 || extent.min_element() < least || extent.max_element() < target {
        out.push(piece);
        return;
    }
    let middle = piece.iter().sum::<Vec2>() / piece.len() as f32;
    // Most cuts share two leading diagonals, as scaffolding lines do.
    let side = if studio.dice.chance(0.5) { 0.22 } else { 0.0 };
    let normal = direction(lead + side + studio.dice.bell() * 0.07);
    let at = middle + studio.dice.heading() * extent.min_element() * 0.15;
    let (mut near, mut far) = (Vec::new(), Vec::new());
    for (k, &a) in piece.iter().enumerate() {
        let b = piece[(k + 1) % piece.len()];
        let (da, db) = ((a - at).dot(normal), (b - at).dot(normal));
        if da <= 0.0 {
            near.push(a);
        } else {
            far.push(a);
        }
        if (da <= 0.0) != (db <= 0.0) {
            let crossing = a.lerp(b, da / (da - db));
            near.push(crossing);
            far.push(crossing);
        }
    }
    if near.len() < 3 || far.len() < 3 {
        out.push(piece);
        return;
    }
    split(studio, near, least, lead, depth + 1, out);
    split(studio, far, least, lead, depth + 1, out);
}

/// Horizontal threads of few dyes, beaten over vertical ribs.
pub(super) fn tapestry(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let thread = (studio.dice.range(2.6, 4.2) * u).max(1.6);
    let rib = thread * studio.dice.range(1.2, 3.5);
    let seed = studio.dice.bits();
    let (snap, fade) = (studio.dice.range(0.3, 0.9), studio.dice.range(0.75, 1.05));
    let hatch = studio.dice.range(0.04, 0.16);
    let (sketch, pigments) = (&studio.sketch, &studio.pigments);
    studio.canvas.each(|p, _| {
        let row = (p.y / thread).floor();
        let odd = (row as i32 & 1) as f32 * 0.5;
        let knot = ((p.x / rib) + odd).floor();
        let centre = Vec2::new((knot - odd + 0.5) * rib, (row + 0.5) * thread);
        // Hatchings: rows reach across a border by chance.
        let reach = (hash_unit(row as i32, 5, seed) - 0.5) * 9.0 * thread;
        let want = sketch.at(centre + Vec2::X * reach * hatch * 4.0);
        let dither = (hash_unit(knot as i32, row as i32, seed) - 0.5) * hatch * 2.0;
        let dyed = pigments.nearest((want + dither).clamp(Vec3::ZERO, Vec3::ONE));
        let c = saturated(want.lerp(dyed, snap), fade);
        let over = mix(0.75, 1.05, 0.5 + 0.5 * wave(p.x / rib + odd - 0.25));
        let round = mix(0.55, 1.1, smoothstep(0.0, 0.4, from_whole(p.y / thread)));
        let wool = noise(Vec2::new(p.x * 0.4, p.y * 1.1), seed);
        textured(c * over * round * 1.15, wool, 0.14).clamp(Vec3::ZERO, Vec3::ONE)
    });
}
