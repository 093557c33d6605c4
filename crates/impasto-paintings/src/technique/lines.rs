//! Prints: woodblock, engraving, linocut.

use super::studio::{PaintingStudio, textured};
use crate::colour::lightness;
use crate::maths::{direction, from_whole, mix, smoothstep};
use crate::noise::{fractal, hash_unit, noise};
use glam::{Vec2, Vec3};

/// Share of ink of a line of half width `half` (pixels) whose centre is `away` pixels off.
fn line(away: f32, half: f32) -> f32 {
    (half - away + 0.5).clamp(0.0, 1.0) * (half * 2.0).clamp(0.0, 1.0)
}

/// Flat regions with graded inking, contour waves inside some, a key block of outlines, wood grain.
pub(super) fn woodblock(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let flats = studio.flats(0.7);
    let distance = studio.outlines(1.0);
    let (seed, grain) = (studio.dice.bits(), studio.dice.range(0.03, 0.14));
    let paper = studio.pigments.paper(0.85);
    let key = studio.pigments.ink(0.2);
    let waves = studio.dice.range(0.3, 0.8);
    let spacing = studio.dice.range(6.0, 11.0) * u;
    let half = studio.dice.range(0.7, 1.6) * u;
    let slip = studio.dice.heading() * studio.dice.unit() * 1.2 * u;
    let tall = studio.canvas.height as f32;
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let i = sketch.index(p + slip);
        let r = usize::from(sketch.region[i]);
        let own = hash_unit(r as i32, 3, seed);
        let flat = flats[r];
        // Bokashi: the block is wiped so that ink fades along the height.
        let wiped = smoothstep(0.1, 0.9, (p.y / tall * (1.0 + own)).fract());
        let graded = if own < 0.35 {
            flat.lerp(paper, wiped * 0.55)
        } else {
            flat
        };
        let step = if lightness(sketch.colour[i]) < lightness(flat) - 0.06 {
            0.78
        } else {
            1.0
        };
        let wood = fractal(Vec2::new(p.x / (30.0 * u), p.y / (1.6 * u)), 3, seed);
        let mut c = textured(graded * step, wood, grain);
        if own < waves {
            let swell = fractal(p / (40.0 * u), 2, seed ^ r as u32) * 40.0 * u;
            let phase = (distance[i].min(60.0 * u) * 0.6 + swell + p.y * 0.35) / spacing;
            let tint = if own * 7.0 % 1.0 < 0.5 {
                key.lerp(flat, 0.35)
            } else {
                paper.lerp(flat, 0.2)
            };
            let width = half * mix(0.4, 1.1, noise(p / (14.0 * u), seed));
            c = c.lerp(tint, line(from_whole(phase) * spacing, width) * 0.85);
        }
        let press = mix(0.5, 1.4, noise(p / (18.0 * u), seed ^ 5));
        c.lerp(key, line(distance[sketch.index(p)], half * press))
    });
}

/// The line work of a burin: its spacing, bending and how many sets of lines cross.
struct Hatching {
    spacing: f32,
    /// How far tone bends lines around forms, in spacings.
    bulge: f32,
    sets: usize,
    seed: u32,
}

impl Hatching {
    /// Share of ink at `p` for a darkness in `[0, 1]`; `turn` is the region's own direction.
    fn ink(&self, p: Vec2, darkness: f32, turn: f32) -> f32 {
        let mut paper = 1.0;
        for set in 0..self.sets {
            let begin = set as f32 / self.sets as f32 * 0.7;
            let depth = ((darkness - begin) / (1.0 - begin)).clamp(0.0, 1.0);
            let across = direction(turn + set as f32 * 0.19);
            let sway = (fractal(p / (self.spacing * 14.0), 2, self.seed) - 0.5) * 5.0;
            let phase = p.dot(across) / self.spacing + sway + darkness * self.bulge;
            let width = depth * self.spacing * 0.42;
            paper *= 1.0 - line(from_whole(phase) * self.spacing, width);
        }
        1.0 - paper
    }
}

/// Lines that swell with the shade and cross in the darks.
pub(super) fn engraving(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let distance = studio.outlines(1.0);
    let (ink, paper) = (studio.pigments.ink(0.18), studio.pigments.paper(0.8));
    let seed = studio.dice.bits();
    let hatching = Hatching {
        spacing: (studio.dice.range(2.5, 4.4) * u).max(1.5),
        bulge: studio.dice.range(0.0, 3.5),
        sets: studio.dice.count(1, 3),
        seed,
    };
    let (turn, spread) = (studio.dice.unit(), studio.dice.range(0.0, 0.5));
    let gain = studio.dice.range(0.6, 1.1);
    let press = studio.dice.range(0.5, 0.95);
    let tint = if studio.dice.chance(0.3) {
        studio.dice.range(0.2, 0.7)
    } else {
        0.0
    };
    let soft = studio.stretched_tones();
    let flats = studio.flats(0.6);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let i = sketch.index(p);
        let r = usize::from(sketch.region[i]);
        let own = turn + (hash_unit(r as i32, 7, seed) - 0.5) * spread;
        let share = hatching.ink(p, ((1.0 - soft[i]) * gain).clamp(0.0, 1.0), own);
        let sheet = textured(paper, fractal(p * 0.15, 3, seed), 0.04);
        let sheet = sheet.lerp(sheet * flats[r], tint);
        let edge = line(distance[i], 0.6 * u) * 0.8;
        sheet.lerp(ink, share.max(edge) * press)
    });
}

/// Two or three colours; gouge marks along the forms open the dark block.
pub(super) fn linocut(studio: &mut PaintingStudio) {
    let u = studio.unit;
    let tones = studio.stretched_tones();
    let distance = studio.outlines(1.0);
    let (dark, paper) = (studio.pigments.ink(0.2), studio.pigments.paper(0.78));
    let middle = studio.pigments.accent();
    let layers = studio.dice.chance(0.65);
    let seed = studio.dice.bits();
    let spacing = (studio.dice.range(5.0, 9.0) * u).max(2.0);
    let (low, high) = (studio.dice.range(0.2, 0.4), studio.dice.range(0.6, 0.8));
    let flats = studio.flats(1.0);
    let many = studio.dice.chance(0.4);
    let sketch = &studio.sketch;
    studio.canvas.each(|p, _| {
        let i = sketch.index(p);
        let r = usize::from(sketch.region[i]);
        let bend = fractal(p / (spacing * 7.0), 2, seed) * 6.0;
        let across = sketch.flow[i].perp() * 0.25 + direction(hash_unit(r as i32, 9, seed));
        let phase = p.dot(across.normalize_or(Vec2::Y)) / spacing + bend;
        // Each gouge mark starts and stops: width varies along the line too.
        let lane = phase.round() as i32;
        let along = p.dot(across.perp()) / (spacing * 3.5);
        let cut = noise(Vec2::new(along, lane as f32 * 3.7), seed);
        let open = smoothstep(low - 0.15, high, tones[i]);
        let width = spacing * 0.5 * (open * 1.5 + cut * 0.9 - 0.65);
        let carved = line(from_whole(phase) * spacing, width.max(0.0));
        let base = if many { flats[r] } else { middle };
        let sheet = if layers && tones[i] < high {
            base.lerp(paper, 0.1)
        } else {
            paper
        };
        let rough = noise(p * 0.6 / u.max(0.5), seed ^ 3);
        let block = dark.lerp(sheet, smoothstep(0.86, 0.95, rough) * 0.6);
        let away = carved.max(smoothstep(high - 0.04, high + 0.04, tones[i]));
        let key = 1.1 * u * mix(0.5, 1.5, noise(p / (11.0 * u), seed));
        block.lerp(sheet, away).lerp(dark, line(distance[i], key))
    });
    let speck = studio.dice.range(0.0, 0.1);
    studio
        .canvas
        .each(|p, c| textured(c, noise(p * 0.5, seed), speck).min(Vec3::ONE));
}
