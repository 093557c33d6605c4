//! The ground z = 0: a paved circle with a star, lawn crossed by paths, a cobbled street, meadow.

use std::f32::consts::{FRAC_PI_4, TAU};

use glam::{Vec2, Vec3};

use super::noise::{fade, fbm2, hash, line, smoothstep, unit};
use super::sky::rgb;

/// Where the paving ends.
pub const PLAZA: f32 = 12.3;
/// Where the lawn ends and the street begins.
pub const LAWN: f32 = 19.5;
/// Where the street ends.
pub const STREET: f32 = 23.6;
/// Beyond this the ground belongs to the backdrop.
pub const EDGE: f32 = 90.0;
/// Angle of the first of four paths, a quarter turn apart.
pub const FIRST_PATH: f32 = 0.52;
/// Half width of a path.
pub const PATH_HALF: f32 = 1.7;

/// Linear albedo at `p`; `footprint` as in [`super::noise`].
pub fn albedo(p: Vec2, footprint: f32) -> Vec3 {
    let r = p.length();
    let stain = 1.0 + 0.14 * fbm2(p, 0.45, 4, footprint);
    if r < PLAZA - 0.3 {
        return plaza(p, r, footprint) * stain;
    }
    if r < PLAZA {
        return setts(p, r, 0.3, 0.9, rgb(0xCFC8BA), 0.16, footprint) * stain;
    }
    if r < LAWN && !on_path(p) {
        return lawn(p, footprint);
    }
    if r < LAWN {
        return flags(p, footprint) * stain;
    }
    if r < LAWN + 0.3 {
        return rgb(0xC9C3B6) * stain;
    }
    if r < STREET {
        return setts(p, r, 0.34, 0.42, rgb(0x8E8A88), 0.22, footprint) * stain;
    }
    let mown = 0.5 + 0.5 * fbm2(p, 0.12, 3, footprint);
    rgb(0x7D9A4E).lerp(rgb(0xA9A65F), mown) * stain
}

/// Light lost in the corner between the ground and the steps of the plinth, `[0, 1]`.
pub fn openness(p: Vec2, steps: Vec2) -> f32 {
    let outside = (p.abs() - steps).max(Vec2::ZERO).length();
    1.0 - 0.38 * (-outside / 0.35).exp()
}

fn on_path(p: Vec2) -> bool {
    (0..4).any(|k| {
        let along = Vec2::from_angle(FIRST_PATH + k as f32 * TAU / 4.0);
        p.dot(along) > 0.0 && p.perp_dot(along).abs() < PATH_HALF
    })
}

/// Rings of stones around the statue, with a pale star and dark bands laid into them.
fn plaza(p: Vec2, r: f32, footprint: f32) -> Vec3 {
    let angle = p.to_angle() - FIRST_PATH;
    let from_ray = |offset: f32, step: f32| {
        let a = (angle + offset).rem_euclid(step);
        a.min(step - a)
    };
    let long = 0.44 * (1.0 - (r - 1.5) / 8.2);
    let short = 0.34 * (1.0 - (r - 1.5) / 5.6);
    let mut base = if from_ray(0.0, TAU / 4.0) < long {
        rgb(0xE6D9BF)
    } else if from_ray(FRAC_PI_4, TAU / 4.0) < short {
        rgb(0xC98F6C)
    } else {
        rgb(0xB3A08C)
    };
    if (9.9..10.5).contains(&r) || (11.1..11.4).contains(&r) {
        base = rgb(0x8A6A5E);
    }
    setts(p, r, 0.45, 0.68, base, 0.2, footprint)
}

/// Stones in rings of the given width, each about `length` long, its own shade of `base`.
fn setts(
    p: Vec2,
    r: f32,
    width: f32,
    length: f32,
    base: Vec3,
    variation: f32,
    footprint: f32,
) -> Vec3 {
    let ring = (r / width).floor();
    let count = (TAU * (ring + 0.5) * width / length).round().max(6.0);
    let turn = p.to_angle() / TAU + unit(hash(ring as i32, 3, 1));
    let across = turn * count;
    let stone = hash(ring as i32, across.floor().rem_euclid(count) as i32, 2);
    let edge = |x: f32| x.fract().abs().min(1.0 - x.fract().abs());
    let joint = (edge(r / width) * width).min(edge(across + 64.0) * TAU * r / count);
    let shade = 1.0 + variation * fade(footprint / length) * (unit(stone) * 2.0 - 1.0);
    let warm =
        Vec3::new(1.05, 1.0, 0.92).lerp(Vec3::new(0.95, 1.0, 1.07), unit(stone.rotate_left(9)));
    let grain = 1.0 + 0.14 * fbm2(p, 3.0, 2, footprint) + 0.2 * fbm2(p, 16.0, 3, footprint);
    let worn = base * shade * Vec3::ONE.lerp(warm, fade(footprint / length)) * grain;
    worn.lerp(base * 0.42, line(joint, 0.016, footprint) * 0.85)
}

fn flags(p: Vec2, footprint: f32) -> Vec3 {
    let q = Vec2::from_angle(-FIRST_PATH).rotate(p) / 0.85;
    let row = q.y.floor();
    let x = q.x + 0.5 * row.rem_euclid(2.0);
    let stone = unit(hash(x.floor() as i32, row as i32, 5));
    let edge = |x: f32| {
        let f = x - x.floor();
        f.min(1.0 - f) * 0.85
    };
    let base = rgb(0xD3C3A2) * (0.88 + 0.24 * stone) * (1.0 + 0.12 * fbm2(p, 5.0, 3, footprint));
    let joint = line(edge(x).min(edge(q.y)), 0.02, footprint);
    base.lerp(rgb(0x8A8263), joint * 0.8)
}

fn lawn(p: Vec2, footprint: f32) -> Vec3 {
    let patches = 0.5 + 0.5 * fbm2(p, 0.35, 3, footprint);
    let blades = fbm2(p, 3.0, 4, footprint);
    let grass = rgb(0x5C8C35).lerp(rgb(0x9DB54A), patches) * (1.0 + 0.35 * blades);
    let daisies = smoothstep(0.55, 0.7, fbm2(p + 40.0, 2.2, 2, footprint));
    grass.lerp(rgb(0xF0EBCF), daisies * 0.7)
}
