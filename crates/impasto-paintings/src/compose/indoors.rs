//! Portrait, still life and groups of figures.

use super::{Stage, mass, oval};
use crate::maths::direction;
use crate::sketch::{Flow, Form, Modelling};
use glam::{Vec2, Vec3};

const UPRIGHT: Flow = Flow::Along(Vec2::Y);
const LEVEL: Flow = Flow::Along(Vec2::X);

/// A wall behind: dark, middle or pale, plain, curtained or with a glow.
fn wall(stage: &mut Stage) -> f32 {
    let t = if stage.dice.chance(0.5) {
        0.06
    } else {
        stage.dice.range(0.1, 0.85)
    };
    let (top, bottom) = (stage.near(t), stage.tone(t + stage.dice.sway() * 0.15));
    stage.backdrop(top, bottom, Flow::Loose);
    match stage.dice.index(4) {
        0 => {
            let x = if stage.dice.chance(0.5) { 0.0 } else { 1.0 };
            let a = stage.at(x, -0.1);
            let b = stage.at(x, 1.1) + Vec2::X * stage.dice.sway() * 0.2;
            let (light, shade) = (stage.near(0.45), stage.tone(0.05));
            let w = stage.dice.range(0.12, 0.3) * stage.size();
            stage.put(
                Form::Limb {
                    a,
                    b,
                    ra: w,
                    rb: w * 0.7,
                },
                light,
                shade,
                Modelling::Folds,
                UPRIGHT,
            );
        }
        1 => {
            let r = stage.dice.range(0.3, 0.6) * stage.size();
            let glow = oval(stage.at(0.5, 0.35), Vec2::splat(r));
            let c = stage.tone(t + 0.3);
            stage.put_soft(glow, c, c, Modelling::Flat, Flow::Around, r * 0.8);
        }
        2 => {
            for _ in 0..stage.dice.count(4, 16) {
                let r = stage.dice.range(0.03, 0.1) * stage.size();
                let spot = mass(
                    stage.at(stage.dice.unit(), stage.dice.unit()),
                    Vec2::splat(r),
                    0.4,
                );
                let c = stage.near(t + 0.25);
                stage.put(spot, c, c * 0.8, Modelling::Patches, Flow::Around);
            }
        }
        _ => {}
    }
    t
}

/// Flesh: a light tone warmed a little, and its shadow.
fn flesh(stage: &mut Stage) -> (Vec3, Vec3) {
    let c = stage.pigments.tone(stage.dice.range(0.78, 1.0));
    let light = c.lerp(Vec3::new(0.86, 0.64, 0.5), stage.dice.range(0.0, 0.45));
    let shade = light.lerp(stage.tone(0.2), stage.dice.range(0.55, 0.9)) * 0.85;
    (light, shade)
}

/// Head and shoulders, with hair, hat, collar and hands by chance.
pub(super) fn portrait(stage: &mut Stage) {
    wall(stage);
    let s = stage.size() * stage.dice.range(0.75, 1.25);
    let tilt = stage.dice.sway() * 0.05;
    let head = stage.at(stage.dice.range(0.38, 0.62), stage.dice.range(0.28, 0.42));
    let (skin, shadow) = flesh(stage);
    let (cloth, fold) = (stage.near(0.4), stage.near(0.12));
    let (hair, depth) = (stage.near(0.3), stage.tone(0.02));
    let back = mass(
        head + Vec2::new(0.0, 0.02) * s,
        Vec2::new(0.17, stage.dice.range(0.19, 0.34)) * s,
        0.2,
    );
    stage.put(back, hair, depth, Modelling::Round, UPRIGHT);
    let bust = oval(
        head + Vec2::new(stage.dice.sway() * 0.05, 0.66) * s,
        Vec2::new(stage.dice.range(0.3, 0.46), 0.45) * s,
    );
    stage.put(bust, cloth, fold, Modelling::Folds, Flow::Around);
    let neck = Form::Limb {
        a: head + Vec2::Y * 0.1 * s,
        b: head + Vec2::Y * 0.27 * s,
        ra: 0.07 * s,
        rb: 0.09 * s,
    };
    stage.put(neck, skin * 0.9, shadow, Modelling::Round, UPRIGHT);
    if stage.dice.chance(0.5) {
        let collar = mass(head + Vec2::Y * 0.27 * s, Vec2::new(0.16, 0.05) * s, 0.3);
        let c = stage.tone(1.0);
        stage.put(collar, c, c * 0.65, Modelling::Folds, Flow::Around);
    }
    let axis = direction(tilt);
    let face = Form::Ellipse {
        centre: head,
        radii: Vec2::new(0.125, 0.165) * s,
        axis,
        ragged: 0.0,
    };
    stage.put(face, skin, shadow, Modelling::Round, Flow::Around);
    features(stage, head, s, axis, shadow);
    let fringe = mass(head - Vec2::Y * 0.135 * s, Vec2::new(0.145, 0.07) * s, 0.25);
    stage.put(fringe, hair, depth, Modelling::Folds, Flow::Around);
    if stage.dice.chance(0.4) {
        let c = stage.pigments.pick(stage.dice);
        let brim = Form::Ellipse {
            centre: head - Vec2::Y * 0.13 * s,
            radii: Vec2::new(0.26, 0.05) * s,
            axis,
            ragged: 0.1,
        };
        let crown = mass(head - Vec2::Y * 0.2 * s, Vec2::new(0.14, 0.11) * s, 0.15);
        stage.put(crown, c, c * 0.5, Modelling::Round, Flow::Around);
        stage.put(brim, c, c * 0.6, Modelling::Fall, LEVEL);
    }
    if stage.dice.chance(0.5) {
        let hands = head + Vec2::new(stage.dice.sway() * 0.15, 0.55) * s;
        let form = mass(hands, Vec2::new(0.1, 0.055) * s, 0.2);
        stage.put(form, skin, shadow, Modelling::Round, LEVEL);
    }
    if stage.dice.chance(0.3) {
        let table = stage.below(0.88, 0.02);
        let (light, shade) = (stage.near(0.5), stage.near(0.2));
        stage.put(table, light, shade, Modelling::Fall, LEVEL);
    }
}

fn features(stage: &mut Stage, head: Vec2, s: f32, axis: Vec2, shadow: Vec3) {
    let dark = stage.tone(0.03);
    let lips = shadow.lerp(stage.pigments.accent(), 0.5);
    let place = |x: f32, y: f32| head + (axis * x + axis.perp() * y) * s;
    for side in [-1.0, 1.0] {
        let socket = oval(place(side * 0.05, -0.015), Vec2::new(0.034, 0.02) * s);
        stage.put_soft(socket, shadow, shadow, Modelling::Flat, LEVEL, 0.008 * s);
        let eye = oval(place(side * 0.05, -0.01), Vec2::new(0.019, 0.01) * s);
        stage.put(eye, dark, dark, Modelling::Flat, LEVEL);
        let brow = Form::Limb {
            a: place(side * 0.025, -0.05),
            b: place(side * 0.085, -0.045),
            ra: 0.008 * s,
            rb: 0.004 * s,
        };
        stage.put(brow, dark, dark, Modelling::Flat, LEVEL);
    }
    let nose = Form::Limb {
        a: place(0.006, -0.01),
        b: place(0.014, 0.055),
        ra: 0.008 * s,
        rb: 0.018 * s,
    };
    stage.put_soft(nose, shadow, shadow, Modelling::Flat, UPRIGHT, 0.008 * s);
    let mouth = oval(place(0.0, 0.095), Vec2::new(0.042, 0.014) * s);
    stage.put(mouth, lips, lips * 0.7, Modelling::Fall, LEVEL);
}

/// A table with cloth, fruit, vases, bottles and flowers.
pub(super) fn still_life(stage: &mut Stage) {
    let t = wall(stage);
    let edge = stage.dice.range(0.5, 0.74);
    let table = Form::Below {
        level: edge,
        swing: 0.02,
        rate: 1.0,
        seed: stage.dice.bits(),
    };
    let (light, shade) = (stage.near(0.9 - t), stage.near(0.55 - t * 0.4));
    stage.put(table, light, shade, Modelling::Fall, LEVEL);
    if stage.dice.chance(0.6) {
        let x = stage.dice.range(0.1, 0.6);
        let cloth = Form::Polygon(vec![
            stage.at(x, edge + 0.02),
            stage.at(x + 0.35, edge + 0.03),
            stage.at(x + 0.5, 1.1),
            stage.at(x - 0.15, 1.1),
        ]);
        let c = stage.near(0.95);
        let fold = stage.near(0.45);
        stage.put(cloth, c, fold, Modelling::Folds, UPRIGHT);
    }
    let mut spots: Vec<f32> = (0..4)
        .map(|k| 0.14 + k as f32 * 0.24 + stage.dice.sway() * 0.06)
        .collect();
    stage.dice.shuffle(&mut spots);
    for &u in spots.iter().take(stage.dice.count(1, 3)) {
        let foot = stage.at(u, edge + stage.dice.range(0.0, 0.1));
        vessel(stage, foot);
    }
    for _ in 0..stage.dice.count(2, 11) {
        let v = edge + stage.dice.range(0.02, 0.32);
        let r = stage.dice.range(0.04, 0.095) * stage.size();
        fruit(
            stage,
            stage.at(0.0, v) + Vec2::X * stage.dice.range(0.08, 0.92) * stage.aspect,
            r,
        );
    }
}

fn fruit(stage: &mut Stage, at: Vec2, r: f32) {
    let dark = stage.tone(0.04);
    let cast = oval(
        at + Vec2::new(r * 0.5, r * 0.65),
        Vec2::new(r * 1.3, r * 0.4),
    );
    stage.put_soft(cast, dark, dark, Modelling::Flat, LEVEL, r * 0.2);
    let c = if stage.dice.chance(0.4) {
        stage.pigments.accent()
    } else {
        stage.pigments.pick(stage.dice)
    };
    let body = oval(at, Vec2::new(r, r * stage.dice.range(0.8, 1.1)));
    stage.put(body, c, c.lerp(dark, 0.75), Modelling::Round, Flow::Around);
    let spark = oval(at + Vec2::new(-0.3, -0.35) * r, Vec2::splat(r * 0.16));
    let white = stage.tone(1.0);
    stage.put_soft(spark, white, white, Modelling::Flat, Flow::Around, r * 0.06);
}

fn vessel(stage: &mut Stage, foot: Vec2) {
    let s = stage.size() * stage.dice.range(0.8, 1.4);
    let (belly, neck, height) = (
        stage.dice.range(0.05, 0.12) * s,
        stage.dice.range(0.025, 0.06) * s,
        stage.dice.range(0.18, 0.36) * s,
    );
    let profile: [(f32, f32); 4] = [(0.6, 0.0), (0.95, 0.25), (1.0, 0.45), (0.75, 0.65)];
    let mut right: Vec<Vec2> = profile
        .iter()
        .map(|(w, h)| Vec2::new(w * belly, -h * height))
        .collect();
    right.push(Vec2::new(neck, -0.8 * height));
    right.push(Vec2::new(neck * 1.3, -height));
    let left: Vec<Vec2> = right.iter().rev().map(|p| Vec2::new(-p.x, p.y)).collect();
    let points = right.iter().chain(&left).map(|p| foot + *p).collect();
    let c = stage.pigments.pick(stage.dice);
    let dark = c.lerp(stage.tone(0.02), 0.75);
    let cast = oval(
        foot + Vec2::new(belly * 0.7, 0.0),
        Vec2::new(belly * 1.5, belly * 0.35),
    );
    let shadow = stage.tone(0.05);
    stage.put_soft(cast, shadow, shadow, Modelling::Flat, LEVEL, belly * 0.2);
    stage.put(Form::Polygon(points), c, dark, Modelling::Round, UPRIGHT);
    if stage.dice.chance(0.65) {
        bouquet(stage, foot - Vec2::Y * (height + 0.1 * s), 0.2 * s);
    }
}

fn bouquet(stage: &mut Stage, middle: Vec2, reach: f32) {
    let (leaf, deep) = (stage.near(0.4), stage.near(0.12));
    for _ in 0..stage.dice.count(4, 9) {
        let tip = middle + stage.dice.heading() * reach * stage.dice.range(0.7, 1.3);
        let blade = Form::Limb {
            a: middle + Vec2::Y * reach * 0.4,
            b: tip,
            ra: reach * 0.05,
            rb: reach * 0.02,
        };
        stage.put(blade, leaf, deep, Modelling::Round, UPRIGHT);
    }
    let colours = [
        stage.pigments.accent(),
        stage.pigments.light(),
        stage.pigments.pick(stage.dice),
    ];
    let heart = stage.pigments.pick(stage.dice);
    for _ in 0..stage.dice.count(5, 12) {
        let centre = middle + stage.dice.heading() * reach * stage.dice.unit();
        let (c, r) = (
            colours[stage.dice.index(3)],
            reach * stage.dice.range(0.14, 0.3),
        );
        let (petals, start) = (stage.dice.count(4, 6), stage.dice.unit());
        for k in 0..petals {
            let axis = direction(start + k as f32 / petals as f32);
            let petal = Form::Ellipse {
                centre: centre + axis * r * 0.6,
                radii: Vec2::new(r * 0.6, r * 0.36),
                axis,
                ragged: 0.0,
            };
            stage.put(petal, c, c * 0.65, Modelling::Round, Flow::Along(axis));
        }
        let eye = oval(centre, Vec2::splat(r * 0.28));
        stage.put(eye, heart, heart * 0.7, Modelling::Round, Flow::Around);
    }
}

/// Standing and bending figures before architecture or open ground.
pub(super) fn company(stage: &mut Stage) {
    wall(stage);
    let floor = stage.dice.range(0.65, 0.85);
    let stone = stage.near(0.55);
    if stage.dice.chance(0.5) {
        for k in 0..stage.dice.count(2, 5) {
            let foot = stage.at(0.1 + k as f32 * 0.24 + stage.dice.sway() * 0.03, floor);
            let w = 0.045 * stage.size();
            let head = Vec2::new(foot.x, -0.05);
            stage.put(
                Form::Limb {
                    a: foot,
                    b: head,
                    ra: w,
                    rb: w * 0.85,
                },
                stone,
                stone * 0.4,
                Modelling::Round,
                UPRIGHT,
            );
        }
    }
    let ground = stage.below(floor, 0.04);
    let (light, shade) = (stage.near(0.5), stage.near(0.2));
    stage.put(ground, light, shade, Modelling::Patches, LEVEL);
    let n = stage.dice.count(2, 7);
    for k in 0..n {
        let u = (k as f32 + 0.5) / n as f32 + stage.dice.sway() * 0.08;
        let foot = stage.at(u, floor + stage.dice.range(0.02, 0.25));
        let h = stage.dice.range(0.35, 0.62) * stage.size().max(0.4);
        figure(stage, foot, h);
    }
}

fn figure(stage: &mut Stage, foot: Vec2, h: f32) {
    let lean = stage.dice.sway() * 0.18 * h;
    let shoulders = foot + Vec2::new(lean, -0.78 * h);
    let (cloth, fold) = (stage.pigments.pick(stage.dice), stage.tone(0.06));
    let body = Form::Polygon(vec![
        foot + Vec2::new(-0.17 * h, 0.0),
        shoulders + Vec2::new(-0.1 * h, 0.03 * h),
        shoulders,
        shoulders + Vec2::new(0.1 * h, 0.03 * h),
        foot + Vec2::new(0.17 * h, 0.0),
    ]);
    stage.put(
        body,
        cloth,
        cloth.lerp(fold, 0.7),
        Modelling::Folds,
        UPRIGHT,
    );
    let (skin, shadow) = flesh(stage);
    for side in [-1.0, 1.0] {
        let elbow = shoulders + Vec2::new(side * 0.16, stage.dice.range(-0.1, 0.25)) * h;
        let sleeve = Form::Limb {
            a: shoulders + Vec2::X * side * 0.09 * h,
            b: elbow,
            ra: 0.05 * h,
            rb: 0.04 * h,
        };
        stage.put(
            sleeve,
            cloth,
            cloth.lerp(fold, 0.6),
            Modelling::Round,
            UPRIGHT,
        );
        let hand = elbow
            + Vec2::new(
                -side * stage.dice.range(-0.08, 0.12),
                stage.dice.sway() * 0.14,
            ) * h;
        stage.put(
            Form::Limb {
                a: elbow,
                b: hand,
                ra: 0.03 * h,
                rb: 0.025 * h,
            },
            skin,
            shadow,
            Modelling::Round,
            UPRIGHT,
        );
    }
    let head = shoulders + Vec2::new(stage.dice.sway() * 0.03, -0.1) * h;
    let (hair, dark) = (stage.near(0.25), stage.tone(0.02));
    let behind = mass(head - Vec2::Y * 0.015 * h, Vec2::new(0.075, 0.095) * h, 0.2);
    stage.put(behind, hair, dark, Modelling::Round, Flow::Around);
    let face = oval(
        head + Vec2::new(stage.dice.sway() * 0.02, 0.015) * h,
        Vec2::new(0.055, 0.07) * h,
    );
    stage.put(face, skin, shadow, Modelling::Round, Flow::Around);
}
