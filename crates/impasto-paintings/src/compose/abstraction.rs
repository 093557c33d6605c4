//! Layouts that show nothing: overlapping planes, and rhythms of bands and arcs.

use super::stage::{AROUND, LOOSE, PaintingStage, limb, mass, oval, sloping};
use crate::maths::direction;
use crate::sketch::{Modelling, Outline, StrokeFlow};
use glam::Vec2;

/// Overlapping planes, discs and bars on a ground.
pub(super) fn planes(stage: &mut PaintingStage) {
    stage.backdrop(stage.near_pair(0.8, 0.6), LOOSE);
    for k in 0..stage.dice.count(5, 18) {
        let centre = stage.at(stage.dice.unit(), stage.dice.unit());
        let r = stage.dice.range(0.05, 0.34) * stage.size() / (1.0 + k as f32 * 0.06);
        let c = stage.pick();
        let axis = stage.dice.heading();
        let form = match stage.dice.index(4) {
            0 => oval(centre, Vec2::splat(r)),
            1 => {
                let (half, radius) = (axis * r * 1.6, r * 0.12);
                limb(centre - half, centre + half, radius, radius)
            }
            2 => mass(centre, Vec2::new(r, r * 0.7), 0.6),
            _ => {
                let corners = stage.dice.count(3, 5);
                let start = stage.dice.unit();
                let corner = |i: usize| {
                    let turn = start + (i as f32 + stage.dice.sway() * 0.3) / corners as f32;
                    centre + direction(turn) * r * 1.2
                };
                Outline::Polygon((0..corners).map(corner).collect())
            }
        };
        let shade = stage.pick().lerp(c, 0.5);
        let modelling = [
            Modelling::Flat,
            Modelling::Fall,
            Modelling::Round,
            Modelling::Patches,
        ][stage.dice.index(4)];
        stage.put(form, [c, shade], modelling, StrokeFlow::Along(axis));
    }
}

/// Undulating bands across the picture with rings and drops in them.
pub(super) fn rhythm(stage: &mut PaintingStage) {
    stage.backdrop(stage.near_pair(0.5, 0.9), LOOSE);
    let bands = stage.dice.count(5, 12);
    let swing = stage.dice.range(0.05, 0.5);
    for k in 0..bands {
        let form = stage.below((k as f32 + 0.3) / bands as f32, swing);
        let (c, d) = (stage.pick(), stage.pick());
        let flow = sloping(stage.dice.sway() * swing * 2.0);
        stage.put(form, [c, d.lerp(c, 0.5)], Modelling::Fall, flow);
    }
    for _ in 0..stage.dice.count(0, 8) {
        let centre = stage.at(stage.dice.unit(), stage.dice.unit());
        let mut r = stage.dice.range(0.05, 0.2) * stage.size();
        for _ in 0..stage.dice.count(1, 4) {
            let c = stage.pick();
            let ring = oval(centre, Vec2::splat(r));
            stage.put(ring, [c, c * 0.8], Modelling::Flat, AROUND);
            r *= 0.68;
        }
    }
}
