//! Thin paint on absorbent grounds: ink wash, watercolour, fresco.

use super::contours::Contour;
use super::studio::{PaintingStudio, textured};
use crate::canvas::Brush;
use crate::colour::{lightness, saturated};
use crate::maths::{direction, from_whole, mix, smoothstep};
use crate::noise::{cell, drift, fractal, hash_unit, noise};
use glam::{Vec2, Vec3};

/// Layers of wash: each covers what is darker than its threshold, with a dark rim where it dried.
struct Washes {
    layers: usize,
    /// Softness of a layer's border in tone.
    soft: f32,
    /// Strength of the rim.
    rim: f32,
    unit: f32,
    seed: u32,
}

impl Washes {
    /// Pigment density `[0, 1]` for the sketch's tone at `p`.
    fn density(&self, p: Vec2, tone: f32) -> f32 {
        let bleed = fractal(p / (22.0 * self.unit), 4, self.seed) - 0.5;
        let mut sum = 0.0;
        for layer in 0..self.layers {
            let k = layer as u32;
            let ragged = bleed * 0.35
                + (fractal(p / (9.0 * self.unit), 3, self.seed ^ (k + 1)) - 0.5) * 0.12;
            let threshold = 0.95 - (layer as f32 + 0.2) / self.layers as f32 * 0.85;
            let inside = smoothstep(threshold + self.soft, threshold - self.soft, tone + ragged);
            // The rim is the band just inside the border.
            let rim = inside * (1.0 - inside) * 4.0 * smoothstep(0.3, 0.9, inside);
            sum += (inside * mix(0.75, 1.15, bleed + 0.5) + rim * self.rim) / self.layers as f32;
        }
        sum.clamp(0.0, 1.1)
    }
}

/// Transparent colour in layers with wet edges, granulation, blooms and white paper.
pub(super) fn watercolour(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let paper = studio.pigments.paper(0.92);
    let soaked = studio.soaked(studio.dice.range(0.5, 3.0) * u);
    let seed = studio.dice.bits();
    let washes = Washes {
        layers: studio.dice.count(2, 4),
        soft: studio.dice.range(0.015, 0.06),
        rim: studio.dice.range(0.4, 1.1),
        unit: u,
        seed,
    };
    let strength = studio.dice.range(0.5, 1.1);
    let lift = studio.dice.range(0.0, 0.25);
    let granules = studio.dice.range(0.03, 0.2);
    let tones = studio.stretched_tones();
    let thinned = studio.dice.range(0.0, 0.45);
    let outlines = studio.outlines(1.0);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let q = p + drift(p / (16.0 * u), 3, seed) * 5.0 * u;
        let i = sketch.index(q);
        let c = soaked[i];
        let density = washes.density(p, mix(lightness(c), tones[i], 0.6) + lift);
        let tooth = noise(p * 0.75, seed) * 0.6 + noise(p * 0.33, seed ^ 1) * 0.4;
        let pooled = smoothstep(2.2 * u, 0.0, outlines[i]) * 0.28;
        let load = (density * strength + 0.16 + pooled) * (1.0 + granules * (0.5 - tooth) * 2.0);
        // Transparent pigment multiplies; more of it is darker and purer.
        let stain = saturated(c, 1.5)
            .lerp(Vec3::ONE, thinned)
            .clamp(Vec3::splat(0.02), Vec3::ONE);
        let thin = paper * Vec3::ONE.lerp(stain, load.clamp(0.0, 1.0));
        let sheet = thin * Vec3::ONE.lerp(stain, (load - 0.7).clamp(0.0, 0.6));
        textured(sheet, tooth, 0.04)
    });
    let ink = studio.pigments.ink(0.3);
    if studio.dice.chance(0.4) {
        pen_lines(studio, ink);
    }
    splashes(studio, 14);
}

fn pen_lines(studio: &mut PaintingStudio, ink: Vec3) {
    let brush = Brush {
        opacity: 0.8,
        ..Brush::round(0.9 * studio.unit)
    };
    let length = studio.dice.range(20.0, 60.0) * studio.unit;
    let contour = Contour {
        least: 2.0,
        length,
        share: 0.85,
        brush,
        heaviest: 2.2,
    };
    studio.draw_contours(&contour, ink);
}

/// Drops thrown from a loaded brush.
fn splashes(studio: &mut PaintingStudio, most: usize) {
    for _ in 0..studio.dice.count(0, most) {
        let p = studio.anywhere();
        let t = studio.dice.unit();
        let c = studio.pick();
        let radius = (0.7 + 3.0 * t * t) * studio.unit;
        studio.canvas.disc(p, radius, c, 0.5);
    }
}

/// Grey washes, mist, black brush lines, dry brush, a red seal.
pub(super) fn ink_wash(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let (ink, paper) = (studio.pigments.ink(0.13), studio.pigments.paper(0.86));
    let soaked = studio.soaked(studio.dice.range(2.0, 5.0) * u);
    let seed = studio.dice.bits();
    let washes = Washes {
        layers: studio.dice.count(2, 5),
        soft: studio.dice.range(0.03, 0.16),
        rim: studio.dice.range(0.1, 0.6),
        unit: u * 1.6,
        seed,
    };
    let low_key = studio.dice.range(0.0, 0.3);
    let tones = studio.stretched_tones();
    let hint = if studio.dice.chance(0.35) {
        studio.dice.range(0.2, 0.6)
    } else {
        0.0
    };
    let mist = studio.dice.range(0.0, 0.9);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let i = sketch.index(p + drift(p / (20.0 * u), 3, seed) * 7.0 * u);
        let tone = tones[i] * (1.0 - low_key) + 0.25 - low_key * 0.25;
        let fog = smoothstep(0.5, 0.75, fractal(p / (90.0 * u), 3, seed ^ 9)) * mist;
        let density = washes.density(p, tone) * (1.0 - fog);
        let fibre = fractal(Vec2::new(p.x * 0.5, p.y * 0.12), 3, seed);
        let colour = ink.lerp(soaked[i], hint);
        textured(paper.lerp(colour, (density * 0.95).min(0.95)), fibre, 0.06)
    });
    let brush = Brush {
        bristle: 0.8,
        grain: studio.dice.range(0.0, 0.4),
        taper: 0.8,
        opacity: studio.dice.range(0.6, 1.0),
        ..Brush::round(1.2 * u)
    };
    let contour = Contour {
        least: studio.dice.range(3.0, 20.0),
        length: studio.dice.range(40.0, 110.0) * u,
        share: studio.dice.range(0.3, 0.9),
        brush,
        heaviest: studio.dice.range(2.0, 7.0),
    };
    studio.draw_contours(&contour, ink);
    if studio.dice.chance(0.4) {
        seal(studio, paper, seed);
    }
}

/// A carved red seal near the foot of the picture.
fn seal(studio: &mut PaintingStudio, paper: Vec3, seed: u32) {
    let u = studio.unit;
    let corner = Vec2::new(studio.dice.range(0.06, 0.9), 0.85) * studio.size();
    let red = Vec3::new(0.7, 0.16, 0.12);
    let side = 9.0 * u;
    let seal = [
        corner,
        corner + Vec2::X * side,
        corner + Vec2::splat(side),
        corner + Vec2::Y * side,
    ];
    studio.canvas.polygon(&seal, |p| {
        let carved = noise((p - corner) / (2.0 * u), seed) > 0.55;
        (if carved { paper } else { red }, 0.9)
    });
}

/// Pale matt pigment, hatched modelling, stains, cracks and lost plaster.
pub(super) fn fresco(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let seed = studio.dice.bits();
    let plaster = studio
        .pigments
        .paper(0.7)
        .lerp(Vec3::new(0.8, 0.75, 0.66), 0.5);
    let (fade, chalky) = (studio.dice.range(0.1, 0.4), studio.dice.range(0.6, 1.0));
    let lost = studio.dice.range(0.64, 0.95);
    let crack = studio.dice.range(0.2, 0.7);
    let blocks = studio.dice.range(40.0, 90.0) * u;
    let hatch = studio.dice.range(2.6, 4.5) * u;
    let distance = studio.outlines(1.0);
    let earth = studio
        .pigments
        .ink(0.25)
        .lerp(Vec3::new(0.4, 0.2, 0.12), 0.4);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let i = sketch.index(p + drift(p / (12.0 * u), 2, seed) * 1.5 * u);
        let mut c = saturated(sketch.colour[i], chalky).lerp(plaster, fade);
        let across = direction(hash_unit(i32::from(sketch.region[i]), 3, seed));
        let phase = p.dot(across) / hatch + fractal(p / (8.0 * hatch), 2, seed) * 3.0;
        c *= mix(0.9, 1.08, smoothstep(0.1, 0.4, from_whole(phase)));
        c = c.lerp(earth, smoothstep(1.4 * u, 0.3 * u, distance[i]) * 0.55);
        let stain = fractal(p / (35.0 * u), 4, seed ^ 2);
        c = textured(c, stain, 0.22);
        let worn = fractal(p / (26.0 * u), 5, seed ^ 4);
        let bare = textured(plaster, noise(p * 0.4, seed), 0.12);
        c = c.lerp(bare, smoothstep(lost - 0.02, lost + 0.02, worn));
        let rubbed = smoothstep(lost - 0.2, lost, worn) * 0.4 * noise(p * 0.8, seed);
        c = c.lerp(plaster, rubbed);
        let bent = p + drift(p / (11.0 * u), 3, seed ^ 6) * 9.0 * u;
        let gap = cell(bent, blocks, 1.0, false, seed).border;
        let thin = noise(p / (25.0 * u), seed ^ 8);
        c *= 1.0 - crack * smoothstep(0.9 * u, 0.2 * u, gap) * smoothstep(0.35, 0.6, thin);
        textured(c, noise(p * 0.9, seed ^ 7), 0.06).clamp(Vec3::ZERO, Vec3::ONE)
    });
}
