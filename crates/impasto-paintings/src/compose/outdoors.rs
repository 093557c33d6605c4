//! Landscape, sea, forest, town and pond.

use super::stage::{
    AROUND, LEVEL, LOOSE, PaintingStage, UPRIGHT, limb, mass, oval, sloping, tower,
};
use crate::maths::mix;
use crate::sketch::{Modelling, Outline};
use glam::Vec2;

fn sky(stage: &mut PaintingStage, horizon: f32) {
    let night = stage.dice.chance(0.25);
    let [top, bottom] = if night {
        stage.near_pair(0.08, 0.4)
    } else {
        stage.near_pair(0.68, 0.92)
    };
    let flow = if stage.dice.chance(0.6) { LEVEL } else { LOOSE };
    stage.backdrop([top, bottom], flow);
    if stage.dice.chance(0.45) {
        let (u, v) = (stage.dice.range(0.12, 0.88), stage.dice.range(0.1, horizon));
        let r = stage.dice.range(0.035, 0.1) * stage.size();
        let centre = stage.at(u, v);
        let c = stage
            .pigments
            .light()
            .lerp(stage.pigments.accent(), stage.dice.range(0.0, 0.8));
        let halo = oval(centre, Vec2::splat(r * 2.2));
        let colours = [bottom.lerp(c, 0.5), bottom];
        stage.put_soft(halo, colours, Modelling::Flat, AROUND, r);
        let body = oval(centre, Vec2::splat(r));
        stage.put(body, [c; 2], Modelling::Flat, AROUND);
    }
    for _ in 0..stage.dice.count(0, 6) {
        let centre =
            stage.at(stage.dice.unit(), 0.0) + Vec2::Y * stage.dice.range(0.03, horizon * 0.85);
        let w = stage.dice.range(0.1, 0.34) * stage.size();
        let form = mass(centre, Vec2::new(w, w * stage.dice.range(0.25, 0.6)), 0.55);
        let colours = if night {
            [stage.near(0.45), stage.tone(0.2)]
        } else {
            [stage.tone(1.0), stage.near(0.62)]
        };
        stage.put_soft(form, colours, Modelling::Patches, AROUND, 0.02);
    }
}

fn tree(stage: &mut PaintingStage, foot: Vec2, height: f32) {
    let bark = [stage.near(0.25), stage.tone(0.03)];
    let lean = stage.dice.sway() * 0.12 * height;
    let crown = foot + Vec2::new(lean, -height);
    let trunk = limb(foot, crown, height * 0.06, height * 0.025);
    stage.put(trunk, bark, Modelling::Round, UPRIGHT);
    let tall = stage.dice.chance(0.3);
    let leaves = stage.near_pair(0.48, 0.15);
    for k in 0..stage.dice.count(1, 4) {
        let spread = Vec2::new(stage.dice.sway(), stage.dice.sway()) * height * 0.25;
        let r = height * stage.dice.range(0.22, 0.42);
        let radii = if tall {
            Vec2::new(r * 0.45, r * 1.7)
        } else {
            Vec2::new(r, r * 0.8)
        };
        let spread = if k == 0 || tall { Vec2::ZERO } else { spread };
        let form = mass(crown + spread, radii, if tall { 0.2 } else { 0.5 });
        let flow = if tall { UPRIGHT } else { AROUND };
        stage.put(form, leaves, Modelling::Patches, flow);
    }
}

fn house(stage: &mut PaintingStage, foot: Vec2, w: f32) {
    let h = w * stage.dice.range(0.5, 1.1);
    let wall = stage.near(0.82);
    let shaded = wall.lerp(stage.tone(0.3), 0.45);
    let form = tower(foot, w, w, h);
    stage.put(form, [wall, shaded], Modelling::Fall, UPRIGHT);
    let side = Outline::Polygon(vec![
        foot + Vec2::new(w * 0.2, 0.0),
        foot + Vec2::new(w * 0.2, -h),
        foot + Vec2::new(w * 0.5, -h),
        foot + Vec2::new(w * 0.5, 0.0),
    ]);
    stage.put(side, [shaded; 2], Modelling::Flat, UPRIGHT);
    let tiles = if stage.dice.chance(0.5) {
        stage.pigments.accent()
    } else {
        stage.near(0.35)
    };
    let ridge = stage.dice.range(0.25, 0.6) * w;
    let roof = Outline::Polygon(vec![
        foot + Vec2::new(-w * 0.58, -h * 0.97),
        foot + Vec2::new(-w * 0.15, -h - ridge),
        foot + Vec2::new(w * 0.25, -h - ridge),
        foot + Vec2::new(w * 0.58, -h * 0.97),
    ]);
    stage.put(roof, [tiles, tiles * 0.75], Modelling::Fall, LEVEL);
    for k in 0..2 {
        let sill = foot + Vec2::new((k as f32 - 0.75) * w * 0.36, -h * 0.35);
        let pane = tower(sill, w * 0.13, w * 0.13, h * 0.3);
        let dark = stage.tone(0.1);
        stage.put(pane, [dark; 2], Modelling::Flat, UPRIGHT);
    }
}

fn blossoms(stage: &mut PaintingStage, top: f32, most: usize) {
    let colours = [
        stage.pick(),
        stage.pigments.accent(),
        stage.pigments.light(),
    ];
    for _ in 0..stage.dice.count(0, most) {
        let v = stage.dice.range(top, 1.0);
        let r = mix(0.006, 0.026, (v - top) / (1.0 - top)) * stage.size();
        let centre = stage.at(stage.dice.unit(), v);
        let c = colours[stage.dice.index(3)];
        let form = oval(centre, Vec2::new(r * 1.3, r));
        stage.put(form, [c, c * 0.8], Modelling::Round, AROUND);
    }
}

/// Sky, hills, fields, trees, houses, a path or a river, flowers.
pub(super) fn landscape(stage: &mut PaintingStage) {
    let horizon = stage.dice.range(0.28, 0.7);
    sky(stage, horizon);
    hills_and_fields(stage, horizon);
    if stage.dice.chance(0.55) {
        path(stage, horizon);
    }
    for _ in 0..stage.dice.count(0, 4) {
        let u = stage.dice.range(0.08, 0.92);
        let foot = stage.at(u, horizon + stage.dice.range(0.02, 0.2));
        let w = stage.dice.range(0.07, 0.2) * stage.size();
        house(stage, foot, w);
    }
    for _ in 0..stage.dice.count(0, 6) {
        let depth = stage.dice.unit();
        let foot = stage.at(stage.dice.unit(), mix(horizon + 0.02, 0.95, depth * depth));
        let height = stage.dice.range(0.12, 0.22) * (1.0 + depth * 1.8) * stage.size();
        tree(stage, foot, height);
    }
    blossoms(stage, horizon + 0.12, 50);
}

fn hills_and_fields(stage: &mut PaintingStage, horizon: f32) {
    for k in 0..stage.dice.count(0, 3) {
        let level = horizon - stage.dice.range(0.0, 0.2) * (1.0 - k as f32 * 0.3);
        let swing = stage.dice.range(0.06, 0.4);
        let hill = stage.below(level, swing);
        let t = 0.66 - 0.12 * k as f32;
        let colours = stage.near_pair(t, t - 0.22);
        stage.put(hill, colours, Modelling::Patches, LOOSE);
    }
    let bands = stage.dice.count(1, 5);
    for k in 0..bands {
        let level = mix(horizon, 1.0, (k as f32 / bands as f32) * 0.9);
        let field = stage.below(level, 0.05 + 0.06 * k as f32);
        let modelling = [Modelling::Fall, Modelling::Patches][k % 2];
        let colours = stage.near_pair(0.62, 0.3);
        let flow = sloping(stage.dice.sway() * 0.4);
        stage.put(field, colours, modelling, flow);
    }
}

/// A path or a river from the horizon to the foot of the picture.
fn path(stage: &mut PaintingStage, horizon: f32) {
    let from = stage.at(stage.dice.unit(), horizon + 0.03);
    let to = stage.at(stage.dice.range(0.1, 0.9), 1.05);
    let bend = (from + to) * 0.5 + Vec2::X * stage.dice.sway() * 0.2;
    let c = stage.near(0.85);
    let w = stage.dice.range(0.08, 0.25) * stage.size();
    let path = Outline::Polygon(vec![
        from,
        bend - Vec2::X * w * 0.4,
        to - Vec2::X * w,
        to + Vec2::X * w,
        bend + Vec2::X * w * 0.4,
    ]);
    stage.put(path, [c, c * 0.8], Modelling::Fall, LEVEL);
}

/// Sky, waves, boats, rocks; now and then a great wave.
pub(super) fn seascape(stage: &mut PaintingStage) {
    let horizon = stage.dice.range(0.25, 0.62);
    sky(stage, horizon);
    let water = stage.near(0.45);
    let sea = stage.below(horizon, 0.0);
    let deep = stage.near(0.2);
    stage.put(sea, [water, deep], Modelling::Fall, LEVEL);
    let swell = stage.dice.range(0.02, 0.22);
    let rows = stage.dice.count(4, 10);
    for k in 0..rows {
        let depth = (k as f32 + stage.dice.unit() * 0.5) / rows as f32;
        let level = mix(horizon, 0.98, depth * (0.5 + depth * 0.5));
        let form = stage.below(level, swell * (0.1 + depth));
        let t = if k % 2 == 0 { 0.62 } else { 0.3 };
        let colours = stage.near_pair(t + 0.15, t - 0.12);
        let flow = sloping(stage.dice.sway() * swell * 3.0);
        stage.put(form, colours, Modelling::Fall, flow);
        if stage.dice.chance(0.5) {
            let centre = stage.at(stage.dice.unit(), mix(horizon, 0.98, depth));
            let radii = Vec2::new(0.16, 0.02 + 0.02 * depth) * stage.size();
            let foam = mass(centre, radii, 0.6);
            let white = stage.tone(1.0);
            stage.put(foam, [white, water], Modelling::Patches, LEVEL);
        }
    }
    for _ in 0..stage.dice.count(0, 4) {
        let s = stage.dice.range(0.06, 0.24) * stage.size();
        let u = stage.dice.range(0.1, 0.9);
        let foot = stage.at(u, horizon + s * stage.dice.range(0.2, 1.2));
        boat(stage, foot, s);
    }
    for _ in 0..stage.dice.count(0, 3) {
        let foot = stage.at(stage.dice.unit(), stage.dice.range(horizon + 0.1, 1.0));
        let r = stage.dice.range(0.06, 0.22) * stage.size();
        let form = mass(foot, Vec2::new(r, r * stage.dice.range(0.5, 1.3)), 0.5);
        let rock = [stage.near(0.4), stage.tone(0.04)];
        stage.put(form, rock, Modelling::Patches, UPRIGHT);
    }
}

fn boat(stage: &mut PaintingStage, foot: Vec2, s: f32) {
    let hull = Outline::Polygon(vec![
        foot + Vec2::new(-s * 0.6, -s * 0.15),
        foot + Vec2::new(s * 0.65, -s * 0.18),
        foot + Vec2::new(s * 0.4, s * 0.08),
        foot + Vec2::new(-s * 0.4, s * 0.08),
    ]);
    let (dark, warm) = (stage.tone(0.08), stage.near(0.35));
    stage.put(hull, [warm, dark], Modelling::Fall, LEVEL);
    let sail = stage.near(0.85);
    let head = foot + Vec2::new(s * stage.dice.sway() * 0.2, -s * stage.dice.range(1.0, 1.8));
    let cloth = Outline::Polygon(vec![
        head,
        foot + Vec2::new(-s * 0.5, -s * 0.25),
        foot + Vec2::new(s * 0.1, -s * 0.25),
    ]);
    stage.put(cloth, [sail, sail * 0.7], Modelling::Folds, UPRIGHT);
    let jib = Outline::Polygon(vec![
        head,
        foot + Vec2::new(s * 0.15, -s * 0.25),
        foot + Vec2::new(s * 0.55, -s * 0.22),
    ]);
    let c = stage.pigments.accent();
    stage.put(jib, [c, c * 0.7], Modelling::Fall, UPRIGHT);
}

/// Trunks against light, undergrowth, a canopy.
pub(super) fn forest(stage: &mut PaintingStage) {
    stage.backdrop(stage.near_pair(0.75, 0.5), LOOSE);
    let floor = stage.dice.range(0.6, 0.85);
    for _ in 0..stage.dice.count(3, 9) {
        let centre = stage.at(stage.dice.unit(), stage.dice.range(0.0, floor));
        let r = stage.dice.range(0.1, 0.3) * stage.size();
        let form = mass(centre, Vec2::new(r, r * 0.8), 0.6);
        stage.put(form, stage.near_pair(0.65, 0.3), Modelling::Patches, AROUND);
    }
    let form = stage.below(floor, 0.1);
    stage.put(form, stage.near_pair(0.5, 0.2), Modelling::Patches, LEVEL);
    let pale = stage.dice.chance(0.3);
    for k in 0..stage.dice.count(5, 15) {
        let near = k as f32 / 15.0;
        let u = stage.dice.unit();
        let foot = stage.at(u, floor + near * (1.05 - floor));
        let head = Vec2::new(foot.x + stage.dice.sway() * 0.08, -0.05);
        let r = mix(0.008, 0.05, near * stage.dice.unit()) * stage.size();
        let light = if pale {
            stage.tone(0.95)
        } else {
            stage.near(0.4)
        };
        let dark = stage.tone(if pale { 0.4 } else { 0.02 });
        let trunk = limb(foot, head, r * 1.3, r * 0.7);
        stage.put(trunk, [light, dark], Modelling::Round, UPRIGHT);
    }
    for _ in 0..stage.dice.count(0, 5) {
        let centre = stage.at(stage.dice.unit(), stage.dice.range(-0.05, 0.3));
        let r = stage.dice.range(0.08, 0.24) * stage.size();
        let form = mass(centre, Vec2::new(r * 1.3, r * 0.6), 0.65);
        stage.put(form, stage.near_pair(0.5, 0.12), Modelling::Patches, AROUND);
    }
    blossoms(stage, floor, 30);
}

/// Buildings side by side, windows, a street, a tower or dome.
pub(super) fn town(stage: &mut PaintingStage) {
    let street = stage.dice.range(0.65, 0.85);
    sky(stage, 0.4);
    for (height, tone) in [(1.0, 0.7), (0.7, 0.55)] {
        let mut u = -0.05;
        while u < 1.05 {
            let w = stage.dice.range(0.08, 0.22);
            let h = stage.dice.range(0.2, 0.55) * height;
            let foot = stage.at(u + w * 0.5, street);
            building(stage, foot, Vec2::new(w * stage.aspect, h), tone);
            u += w * stage.dice.range(0.8, 1.3);
        }
        if height == 1.0 && stage.dice.chance(0.5) {
            domed_tower(stage, street);
        }
    }
    let ground = stage.below(street, 0.02);
    stage.put(ground, stage.near_pair(0.75, 0.4), Modelling::Fall, LEVEL);
    for _ in 0..stage.dice.count(0, 14) {
        passer_by(stage, street);
    }
}

fn building(stage: &mut PaintingStage, foot: Vec2, size: Vec2, tone: f32) {
    let (width, h) = (size.x, size.y);
    let wall = stage.near(tone);
    let front = tower(foot, width, width, h);
    stage.put(front, [wall, wall * 0.75], Modelling::Fall, UPRIGHT);
    let top = width * stage.dice.range(0.1, 0.9);
    let roof = tower(foot - Vec2::Y * h, width * 1.04, top, h * 0.25);
    let c = stage.near(0.3);
    stage.put(roof, [c, c * 0.8], Modelling::Fall, LEVEL);
    let lit = stage.dice.chance(0.3);
    let pane = stage.tone(if lit { 0.95 } else { 0.1 });
    let (columns, floors) = (stage.dice.count(1, 3), stage.dice.count(1, 4));
    for k in 0..columns * floors {
        let (i, j) = ((k % columns) as f32 + 0.5, (k / columns) as f32 + 0.3);
        let across = (i / columns as f32 - 0.5) * width;
        let at = foot + Vec2::new(across, -j / floors as f32 * h);
        let window = tower(at, width * 0.14, width * 0.14, h * 0.35 / floors as f32);
        stage.put(window, [pane; 2], Modelling::Flat, UPRIGHT);
    }
}

fn domed_tower(stage: &mut PaintingStage, street: f32) {
    let foot = stage.at(stage.dice.range(0.2, 0.8), street);
    let (r, wall) = (0.09 * stage.size(), stage.near(0.75));
    let shaft = tower(foot, r * 2.0, r * 1.8, 0.5);
    stage.put(shaft, [wall, wall * 0.6], Modelling::Fall, UPRIGHT);
    let radii = Vec2::new(r, r * stage.dice.range(0.9, 2.2));
    let dome = oval(foot - Vec2::Y * 0.5, radii);
    let c = stage.pigments.accent();
    stage.put(dome, [c, c * 0.5], Modelling::Round, AROUND);
}

fn passer_by(stage: &mut PaintingStage, street: f32) {
    let foot = stage.at(stage.dice.unit(), stage.dice.range(street + 0.02, 0.98));
    let s = (foot.y - street + 0.1) * 0.6 * stage.size();
    let c = stage.pick();
    let body = limb(foot, foot - Vec2::Y * s * 0.7, s * 0.2, s * 0.1);
    stage.put(body, [c, c * 0.5], Modelling::Round, UPRIGHT);
    let head = oval(foot - Vec2::Y * s * 0.9, Vec2::splat(s * 0.1));
    let skin = stage.tone(0.8);
    stage.put(head, [skin, skin * 0.6], Modelling::Round, AROUND);
}

/// Water seen from above: reflections, pads, blossoms; no horizon.
pub(super) fn pond(stage: &mut PaintingStage) {
    stage.backdrop(stage.near_pair(0.55, 0.25), LEVEL);
    for _ in 0..stage.dice.count(3, 9) {
        let a = stage.at(stage.dice.unit(), stage.dice.range(-0.1, 0.5));
        let w = stage.dice.range(0.02, 0.1) * stage.size();
        let b = a + Vec2::new(stage.dice.sway() * 0.05, stage.dice.range(0.3, 0.8));
        let colours = stage.near_pair(0.45, 0.2);
        let reflection = limb(a, b, w, w * 0.5);
        stage.put_soft(reflection, colours, Modelling::Patches, UPRIGHT, 0.04);
    }
    for _ in 0..stage.dice.count(8, 26) {
        let v = stage.dice.unit();
        let r = mix(0.04, 0.13, v) * stage.dice.range(0.6, 1.3) * stage.size();
        let centre = stage.at(stage.dice.unit(), v);
        let pad = mass(centre, Vec2::new(r, r * mix(0.22, 0.45, v)), 0.25);
        stage.put(pad, stage.near_pair(0.68, 0.35), Modelling::Fall, LEVEL);
        for _ in 0..stage.dice.count(0, 3) {
            let at = centre + Vec2::new(stage.dice.sway() * r * 0.6, -r * 0.2);
            let flower = mass(at, Vec2::new(r * 0.24, r * 0.2), 0.4);
            let c = stage
                .pigments
                .light()
                .lerp(stage.pigments.accent(), stage.dice.unit());
            let accent = stage.pigments.accent();
            stage.put(flower, [c, accent], Modelling::Round, AROUND);
        }
    }
}
