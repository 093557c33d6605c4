//! Layouts that show nothing: overlapping planes, and rhythms of bands and arcs.

use super::{Stage, mass, oval};
use crate::sketch::{Flow, Form, Modelling};
use glam::Vec2;

/// Overlapping planes, discs and bars on a ground.
pub(super) fn planes(stage: &mut Stage) {
    let (top, bottom) = (stage.near(0.8), stage.near(0.6));
    stage.backdrop(top, bottom, Flow::Loose);
    for k in 0..stage.dice.count(5, 18) {
        let centre = stage.at(stage.dice.unit(), stage.dice.unit());
        let r = stage.dice.range(0.05, 0.34) * stage.size() / (1.0 + k as f32 * 0.06);
        let c = stage.pigments.pick(stage.dice);
        let axis = stage.dice.heading();
        let form = match stage.dice.index(4) {
            0 => oval(centre, Vec2::splat(r)),
            1 => Form::Limb {
                a: centre - axis * r * 1.6,
                b: centre + axis * r * 1.6,
                ra: r * 0.12,
                rb: r * 0.12,
            },
            2 => mass(centre, Vec2::new(r, r * 0.7), 0.6),
            _ => {
                let corners = stage.dice.count(3, 5);
                let start = stage.dice.unit();
                Form::Polygon(
                    (0..corners)
                        .map(|i| {
                            let turn =
                                start + (i as f32 + stage.dice.sway() * 0.3) / corners as f32;
                            centre + crate::maths::direction(turn) * r * 1.2
                        })
                        .collect(),
                )
            }
        };
        let shade = stage.pigments.pick(stage.dice).lerp(c, 0.5);
        let modelling = [
            Modelling::Flat,
            Modelling::Fall,
            Modelling::Round,
            Modelling::Patches,
        ][stage.dice.index(4)];
        stage.put(form, c, shade, modelling, Flow::Along(axis));
    }
}

/// Undulating bands across the picture with rings and drops in them.
pub(super) fn rhythm(stage: &mut Stage) {
    let (top, bottom) = (stage.near(0.5), stage.near(0.9));
    stage.backdrop(top, bottom, Flow::Loose);
    let bands = stage.dice.count(5, 12);
    let swing = stage.dice.range(0.05, 0.5);
    for k in 0..bands {
        let form = stage.below((k as f32 + 0.3) / bands as f32, swing);
        let (c, d) = (
            stage.pigments.pick(stage.dice),
            stage.pigments.pick(stage.dice),
        );
        let slope = Vec2::new(1.0, stage.dice.sway() * swing * 2.0).normalize_or(Vec2::X);
        stage.put(form, c, d.lerp(c, 0.5), Modelling::Fall, Flow::Along(slope));
    }
    for _ in 0..stage.dice.count(0, 8) {
        let centre = stage.at(stage.dice.unit(), stage.dice.unit());
        let mut r = stage.dice.range(0.05, 0.2) * stage.size();
        for _ in 0..stage.dice.count(1, 4) {
            let c = stage.pigments.pick(stage.dice);
            let ring = oval(centre, Vec2::splat(r));
            stage.put(ring, c, c * 0.8, Modelling::Flat, Flow::Around);
            r *= 0.68;
        }
    }
}
