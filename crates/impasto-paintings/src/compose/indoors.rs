//! Portrait, still life and groups of figures.

use super::stage::{AROUND, LEVEL, LOOSE, PaintingStage, UPRIGHT, ellipse, limb, mass, oval};
use crate::maths::direction;
use crate::sketch::{Modelling, Outline, StrokeFlow};
use glam::{Vec2, Vec3};

/// A wall behind: dark, middle or pale, plain, curtained or with a glow.
fn wall(stage: &mut PaintingStage) -> f32 {
    let t = if stage.dice.chance(0.5) {
        0.06
    } else {
        stage.dice.range(0.1, 0.85)
    };
    let colours = [stage.near(t), stage.tone(t + stage.dice.sway() * 0.15)];
    stage.backdrop(colours, LOOSE);
    match stage.dice.index(4) {
        0 => {
            let x = if stage.dice.chance(0.5) { 0.0 } else { 1.0 };
            let a = stage.at(x, -0.1);
            let b = stage.at(x, 1.1) + Vec2::X * stage.dice.sway() * 0.2;
            let colours = [stage.near(0.45), stage.tone(0.05)];
            let w = stage.dice.range(0.12, 0.3) * stage.size();
            stage.put(limb(a, b, w, w * 0.7), colours, Modelling::Folds, UPRIGHT);
        }
        1 => {
            let r = stage.dice.range(0.3, 0.6) * stage.size();
            let glow = oval(stage.at(0.5, 0.35), Vec2::splat(r));
            let c = stage.tone(t + 0.3);
            stage.put_soft(glow, [c; 2], Modelling::Flat, AROUND, r * 0.8);
        }
        2 => {
            for _ in 0..stage.dice.count(4, 16) {
                let r = stage.dice.range(0.03, 0.1) * stage.size();
                let centre = stage.at(stage.dice.unit(), stage.dice.unit());
                let spot = mass(centre, Vec2::splat(r), 0.4);
                let c = stage.near(t + 0.25);
                stage.put(spot, [c, c * 0.8], Modelling::Patches, AROUND);
            }
        }
        _ => {}
    }
    t
}

/// Flesh: a light tone warmed a little, and its shadow.
fn flesh(stage: &mut PaintingStage) -> [Vec3; 2] {
    let c = stage.pigments.tone(stage.dice.range(0.78, 1.0));
    let light = c.lerp(Vec3::new(0.86, 0.64, 0.5), stage.dice.range(0.0, 0.45));
    let shade = light.lerp(stage.tone(0.2), stage.dice.range(0.55, 0.9)) * 0.85;
    [light, shade]
}

/// Who sits for a portrait. Colours are those in the light and in the shade.
struct Sitter {
    /// Middle of the head.
    head: Vec2,
    /// Size of everything, composition units.
    size: f32,
    /// Which way the head's own x axis points.
    axis: Vec2,
    skin: [Vec3; 2],
    cloth: [Vec3; 2],
    hair: [Vec3; 2],
}

impl Sitter {
    /// A point relative to the head's middle, however the head leans.
    fn below(&self, x: f32, y: f32) -> Vec2 {
        self.head + Vec2::new(x, y) * self.size
    }

    /// A point in the leaning head's own frame.
    fn place(&self, x: f32, y: f32) -> Vec2 {
        self.head + (self.axis * x + self.axis.perp() * y) * self.size
    }
}

/// Head and shoulders, with hair, hat, collar and hands by chance.
pub(super) fn portrait(stage: &mut PaintingStage) {
    wall(stage);
    let size = stage.size() * stage.dice.range(0.75, 1.25);
    let tilt = stage.dice.sway() * 0.05;
    let sitter = Sitter {
        head: stage.at(stage.dice.range(0.38, 0.62), stage.dice.range(0.28, 0.42)),
        size,
        axis: direction(tilt),
        skin: flesh(stage),
        cloth: stage.near_pair(0.4, 0.12),
        hair: [stage.near(0.3), stage.tone(0.02)],
    };
    bust(stage, &sitter);
    face(stage, &sitter);
    if stage.dice.chance(0.4) {
        hat(stage, &sitter);
    }
    if stage.dice.chance(0.5) {
        let centre = sitter.below(stage.dice.sway() * 0.15, 0.55);
        let hands = mass(centre, Vec2::new(0.1, 0.055) * size, 0.2);
        stage.put(hands, sitter.skin, Modelling::Round, LEVEL);
    }
    if stage.dice.chance(0.3) {
        let table = stage.below(0.88, 0.02);
        stage.put(table, stage.near_pair(0.5, 0.2), Modelling::Fall, LEVEL);
    }
}

/// The hair behind the head, shoulders, neck and collar.
fn bust(stage: &mut PaintingStage, sitter: &Sitter) {
    let s = sitter.size;
    let radii = Vec2::new(0.17, stage.dice.range(0.19, 0.34)) * s;
    let back = mass(sitter.below(0.0, 0.02), radii, 0.2);
    stage.put(back, sitter.hair, Modelling::Round, UPRIGHT);
    let centre = sitter.below(stage.dice.sway() * 0.05, 0.66);
    let chest = oval(centre, Vec2::new(stage.dice.range(0.3, 0.46), 0.45) * s);
    stage.put(chest, sitter.cloth, Modelling::Folds, AROUND);
    let [skin, shadow] = sitter.skin;
    let throat = sitter.head + Vec2::Y * 0.27 * s;
    let neck = limb(sitter.head + Vec2::Y * 0.1 * s, throat, 0.07 * s, 0.09 * s);
    stage.put(neck, [skin * 0.9, shadow], Modelling::Round, UPRIGHT);
    if stage.dice.chance(0.5) {
        let collar = mass(throat, Vec2::new(0.16, 0.05) * s, 0.3);
        let c = stage.tone(1.0);
        stage.put(collar, [c, c * 0.65], Modelling::Folds, AROUND);
    }
}

/// The face with its features, and the hair over it.
fn face(stage: &mut PaintingStage, sitter: &Sitter) {
    let s = sitter.size;
    let face = ellipse(sitter.head, Vec2::new(0.125, 0.165) * s, sitter.axis, 0.0);
    stage.put(face, sitter.skin, Modelling::Round, AROUND);
    features(stage, sitter);
    let above = sitter.head - Vec2::Y * 0.135 * s;
    let fringe = mass(above, Vec2::new(0.145, 0.07) * s, 0.25);
    stage.put(fringe, sitter.hair, Modelling::Folds, AROUND);
}

fn hat(stage: &mut PaintingStage, sitter: &Sitter) {
    let (s, c) = (sitter.size, stage.pick());
    let at = |height: f32| sitter.head - Vec2::Y * height * s;
    let brim = ellipse(at(0.13), Vec2::new(0.26, 0.05) * s, sitter.axis, 0.1);
    let crown = mass(at(0.2), Vec2::new(0.14, 0.11) * s, 0.15);
    stage.put(crown, [c, c * 0.5], Modelling::Round, AROUND);
    stage.put(brim, [c, c * 0.6], Modelling::Fall, LEVEL);
}

fn features(stage: &mut PaintingStage, sitter: &Sitter) {
    let s = sitter.size;
    let dark = [stage.tone(0.03); 2];
    let shadow = [sitter.skin[1]; 2];
    let lips = sitter.skin[1].lerp(stage.pigments.accent(), 0.5);
    let place = |x: f32, y: f32| sitter.place(x, y);
    for side in [-1.0, 1.0] {
        let socket = oval(place(side * 0.05, -0.015), Vec2::new(0.034, 0.02) * s);
        stage.put_soft(socket, shadow, Modelling::Flat, LEVEL, 0.008 * s);
        let eye = oval(place(side * 0.05, -0.01), Vec2::new(0.019, 0.01) * s);
        stage.put(eye, dark, Modelling::Flat, LEVEL);
        let (inner, outer) = (place(side * 0.025, -0.05), place(side * 0.085, -0.045));
        let brow = limb(inner, outer, 0.008 * s, 0.004 * s);
        stage.put(brow, dark, Modelling::Flat, LEVEL);
    }
    let (bridge, tip) = (place(0.006, -0.01), place(0.014, 0.055));
    let nose = limb(bridge, tip, 0.008 * s, 0.018 * s);
    stage.put_soft(nose, shadow, Modelling::Flat, UPRIGHT, 0.008 * s);
    let mouth = oval(place(0.0, 0.095), Vec2::new(0.042, 0.014) * s);
    stage.put(mouth, [lips, lips * 0.7], Modelling::Fall, LEVEL);
}

/// A table with cloth, fruit, vases, bottles and flowers.
pub(super) fn still_life(stage: &mut PaintingStage) {
    let t = wall(stage);
    let edge = stage.dice.range(0.5, 0.74);
    let table = Outline::Below {
        level: edge,
        swing: 0.02,
        rate: 1.0,
        seed: stage.dice.bits(),
    };
    let colours = stage.near_pair(0.9 - t, 0.55 - t * 0.4);
    stage.put(table, colours, Modelling::Fall, LEVEL);
    if stage.dice.chance(0.6) {
        let x = stage.dice.range(0.1, 0.6);
        let cloth = Outline::Polygon(vec![
            stage.at(x, edge + 0.02),
            stage.at(x + 0.35, edge + 0.03),
            stage.at(x + 0.5, 1.1),
            stage.at(x - 0.15, 1.1),
        ]);
        stage.put(
            cloth,
            stage.near_pair(0.95, 0.45),
            Modelling::Folds,
            UPRIGHT,
        );
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
        let x = stage.dice.range(0.08, 0.92) * stage.aspect;
        fruit(stage, Vec2::new(x, v), r);
    }
}

fn fruit(stage: &mut PaintingStage, at: Vec2, r: f32) {
    let dark = stage.tone(0.04);
    let below = at + Vec2::new(r * 0.5, r * 0.65);
    let cast = oval(below, Vec2::new(r * 1.3, r * 0.4));
    stage.put_soft(cast, [dark; 2], Modelling::Flat, LEVEL, r * 0.2);
    let c = if stage.dice.chance(0.4) {
        stage.pigments.accent()
    } else {
        stage.pick()
    };
    let body = oval(at, Vec2::new(r, r * stage.dice.range(0.8, 1.1)));
    stage.put(body, [c, c.lerp(dark, 0.75)], Modelling::Round, AROUND);
    let spark = oval(at + Vec2::new(-0.3, -0.35) * r, Vec2::splat(r * 0.16));
    let white = stage.tone(1.0);
    stage.put_soft(spark, [white; 2], Modelling::Flat, AROUND, r * 0.06);
}

fn vessel(stage: &mut PaintingStage, foot: Vec2) {
    let s = stage.size() * stage.dice.range(0.8, 1.4);
    let belly = stage.dice.range(0.05, 0.12) * s;
    let neck = stage.dice.range(0.025, 0.06) * s;
    let height = stage.dice.range(0.18, 0.36) * s;
    let profile = [[0.6, 0.0], [0.95, 0.25], [1.0, 0.45], [0.75, 0.65]];
    let mut right = profile
        .map(|[w, h]| Vec2::new(w * belly, -h * height))
        .to_vec();
    right.push(Vec2::new(neck, -0.8 * height));
    right.push(Vec2::new(neck * 1.3, -height));
    let left: Vec<Vec2> = right.iter().rev().map(|p| Vec2::new(-p.x, p.y)).collect();
    let points = right.iter().chain(&left).map(|p| foot + *p).collect();
    let body = Outline::Polygon(points);
    let c = stage.pick();
    let dark = c.lerp(stage.tone(0.02), 0.75);
    let beside = foot + Vec2::new(belly * 0.7, 0.0);
    let cast = oval(beside, Vec2::new(belly * 1.5, belly * 0.35));
    let shadow = stage.tone(0.05);
    stage.put_soft(cast, [shadow; 2], Modelling::Flat, LEVEL, belly * 0.2);
    stage.put(body, [c, dark], Modelling::Round, UPRIGHT);
    if stage.dice.chance(0.65) {
        bouquet(stage, foot - Vec2::Y * (height + 0.1 * s), 0.2 * s);
    }
}

fn bouquet(stage: &mut PaintingStage, middle: Vec2, reach: f32) {
    let leaf = stage.near_pair(0.4, 0.12);
    let root = middle + Vec2::Y * reach * 0.4;
    for _ in 0..stage.dice.count(4, 9) {
        let tip = middle + stage.dice.heading() * reach * stage.dice.range(0.7, 1.3);
        let blade = limb(root, tip, reach * 0.05, reach * 0.02);
        stage.put(blade, leaf, Modelling::Round, UPRIGHT);
    }
    let colours = [
        stage.pigments.accent(),
        stage.pigments.light(),
        stage.pick(),
    ];
    let heart = stage.pick();
    for _ in 0..stage.dice.count(5, 12) {
        let centre = middle + stage.dice.heading() * reach * stage.dice.unit();
        let c = colours[stage.dice.index(3)];
        let r = reach * stage.dice.range(0.14, 0.3);
        let (petals, start) = (stage.dice.count(4, 6), stage.dice.unit());
        for k in 0..petals {
            let axis = direction(start + k as f32 / petals as f32);
            let out = centre + axis * r * 0.6;
            let petal = ellipse(out, Vec2::new(r * 0.6, r * 0.36), axis, 0.0);
            stage.put(
                petal,
                [c, c * 0.65],
                Modelling::Round,
                StrokeFlow::Along(axis),
            );
        }
        let eye = oval(centre, Vec2::splat(r * 0.28));
        stage.put(eye, [heart, heart * 0.7], Modelling::Round, AROUND);
    }
}

/// Standing and bending figures before architecture or open ground.
pub(super) fn company(stage: &mut PaintingStage) {
    wall(stage);
    let floor = stage.dice.range(0.65, 0.85);
    let stone = stage.near(0.55);
    if stage.dice.chance(0.5) {
        for k in 0..stage.dice.count(2, 5) {
            let foot = stage.at(0.1 + k as f32 * 0.24 + stage.dice.sway() * 0.03, floor);
            let w = 0.045 * stage.size();
            let head = Vec2::new(foot.x, -0.05);
            let column = limb(foot, head, w, w * 0.85);
            stage.put(column, [stone, stone * 0.4], Modelling::Round, UPRIGHT);
        }
    }
    let ground = stage.below(floor, 0.04);
    stage.put(ground, stage.near_pair(0.5, 0.2), Modelling::Patches, LEVEL);
    let n = stage.dice.count(2, 7);
    for k in 0..n {
        let u = (k as f32 + 0.5) / n as f32 + stage.dice.sway() * 0.08;
        let foot = stage.at(u, floor + stage.dice.range(0.02, 0.25));
        let h = stage.dice.range(0.35, 0.62) * stage.size().max(0.4);
        figure(stage, foot, h);
    }
}

fn figure(stage: &mut PaintingStage, foot: Vec2, h: f32) {
    let lean = stage.dice.sway() * 0.18 * h;
    let shoulders = foot + Vec2::new(lean, -0.78 * h);
    let (cloth, fold) = (stage.pick(), stage.tone(0.06));
    let body = Outline::Polygon(vec![
        foot + Vec2::new(-0.17 * h, 0.0),
        shoulders + Vec2::new(-0.1 * h, 0.03 * h),
        shoulders,
        shoulders + Vec2::new(0.1 * h, 0.03 * h),
        foot + Vec2::new(0.17 * h, 0.0),
    ]);
    let colours = [cloth, cloth.lerp(fold, 0.7)];
    stage.put(body, colours, Modelling::Folds, UPRIGHT);
    let skin = flesh(stage);
    for side in [-1.0, 1.0] {
        let elbow = shoulders + Vec2::new(side * 0.16, stage.dice.range(-0.1, 0.25)) * h;
        let armpit = shoulders + Vec2::X * side * 0.09 * h;
        let sleeve = limb(armpit, elbow, 0.05 * h, 0.04 * h);
        let colours = [cloth, cloth.lerp(fold, 0.6)];
        stage.put(sleeve, colours, Modelling::Round, UPRIGHT);
        let inwards = -side * stage.dice.range(-0.08, 0.12);
        let hand = elbow + Vec2::new(inwards, stage.dice.sway() * 0.14) * h;
        let arm = limb(elbow, hand, 0.03 * h, 0.025 * h);
        stage.put(arm, skin, Modelling::Round, UPRIGHT);
    }
    let head = shoulders + Vec2::new(stage.dice.sway() * 0.03, -0.1) * h;
    let hair = [stage.near(0.25), stage.tone(0.02)];
    let behind = mass(head - Vec2::Y * 0.015 * h, Vec2::new(0.075, 0.095) * h, 0.2);
    stage.put(behind, hair, Modelling::Round, AROUND);
    let middle = head + Vec2::new(stage.dice.sway() * 0.02, 0.015) * h;
    let face = oval(middle, Vec2::new(0.055, 0.07) * h);
    stage.put(face, skin, Modelling::Round, AROUND);
}
