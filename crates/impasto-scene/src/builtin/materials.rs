//! Surfaces of the analytic solids: colour, bumps and shine at a contact.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::facade::{facade, tower};
use super::noise::{fade, fbm3, hash, line, nearest_seed, noise3, smoothstep, unit};
use super::sky::rgb;
use super::solids::{Contact, Material, Solid};
use super::surface::{Surface, on_face};

/// The surface of `solid` at `contact`.
pub fn surface(solid: &Solid, contact: &Contact, footprint: f32) -> Surface {
    let normal = solid.world(contact.normal);
    let p = contact.point + Vec3::splat((solid.seed % 977) as f32 * 0.37);
    let matte = |albedo: Vec3| Surface::matte(albedo, normal);
    match solid.material {
        Material::Ashlar => matte(ashlar(solid, contact, p, footprint)),
        Material::Stone => {
            let (coarse, fine) = (fbm3(p, 2.5, 3, footprint), fbm3(p, 18.0, 3, footprint));
            matte(solid.tint * (1.0 + 0.2 * coarse + 0.2 * fine))
        }
        Material::Tablet => tablet(solid, contact, p, normal, footprint),
        Material::Facade(wall) => facade(solid, wall, solid.half_size(), contact, footprint),
        Material::Tower => tower(solid, solid.half_size(), contact, footprint),
        Material::Roof => matte(roof(solid, contact, p, footprint)),
        Material::Bark => {
            let ridges = fbm3(p * Vec3::new(3.0, 3.0, 0.7), 2.0, 3, footprint);
            matte(solid.tint * (1.0 + 0.5 * ridges))
        }
        Material::Leaves => leaves(solid, contact, p, normal, footprint),
        Material::Hedge => foliage(solid.tint, solid.accent, p, normal, 7.0, footprint),
        Material::Flowers => flowers(solid, p, normal, footprint),
        Material::Wood => {
            let grain = fbm3(p * Vec3::new(1.5, 14.0, 14.0), 1.0, 3, footprint * 8.0);
            matte(solid.tint * (1.0 + 0.3 * grain))
        }
        Material::Iron => Surface {
            shine: Vec3::splat(0.25),
            sharpness: 30.0,
            mirror: 0.06,
            ..matte(solid.tint)
        },
        Material::Lamp => Surface {
            mirror: 0.15,
            ..matte(solid.tint)
        },
        Material::Canvas => {
            let stripe = (contact.point.y.atan2(contact.point.x) / TAU + 0.5) * 8.0;
            Surface {
                wrap: 0.3,
                ..matte(solid.colour(stripe.fract() < 0.5))
            }
        }
    }
}

fn ashlar(solid: &Solid, contact: &Contact, p: Vec3, footprint: f32) -> Vec3 {
    const COURSE: f32 = 0.27;
    const BLOCK: f32 = 0.62;
    let (at, _) = on_face(contact, solid.half_size());
    let row = (at.y / COURSE).floor();
    let x = at.x / BLOCK + 0.5 * row.rem_euclid(2.0);
    let side = contact.normal.round();
    let face = (side.x * 3.0 + side.y * 5.0 + side.z * 7.0) as i32;
    let block = hash(x.floor() as i32, row as i32, face);
    let shade = 0.87 + 0.26 * unit(block);
    let edge = |v: f32, size: f32| (v - v.floor()).min(v.ceil() - v) * size;
    let joint = edge(x, BLOCK).min(edge(at.y / COURSE, COURSE));
    let streaks = fbm3(p * Vec3::new(3.0, 3.0, 0.6), 1.3, 3, footprint);
    let grain = fbm3(p, 18.0, 3, footprint);
    let weather = 1.0 + 0.2 * fbm3(p, 3.0, 3, footprint) + 0.24 * grain + 0.16 * streaks;
    let mixed = unit(block.rotate_left(8)) * 0.7;
    let stone = solid.tint.lerp(solid.accent, mixed) * shade * weather;
    stone.lerp(solid.tint * 0.4, line(joint, 0.009, footprint) * 0.8)
}

/// Rows of letters: dark recesses between raised bright strokes.
fn tablet(solid: &Solid, contact: &Contact, p: Vec3, normal: Vec3, footprint: f32) -> Surface {
    let half = solid.half_size();
    let (at, width) = on_face(contact, half);
    let row = at.y / 0.115;
    let (line, face) = (row.floor() as i32, (contact.normal.y * 3.0) as i32);
    let glyph = hash((at.x / 0.022).floor() as i32, line, face);
    let word = hash((at.x / 0.19).floor() as i32, line, 91);
    let inside = at.x.abs() < width - 0.07 && (0.06..half.z * 2.0 - 0.06).contains(&at.y);
    let letter = inside
        && (0.25..0.75).contains(&(row - row.floor()))
        && unit(glyph) > 0.38
        && unit(word) > 0.12;
    let rim = width - at.x.abs() < 0.03 || at.y < 0.03 || half.z * 2.0 - at.y < 0.03;
    let base = solid.tint * (1.0 + 0.4 * fbm3(p, 5.0, 3, footprint));
    let strength = if rim {
        0.8
    } else {
        fade(footprint / 0.05) * f32::from(u8::from(letter))
    };
    Surface {
        shine: solid.accent * 0.5,
        sharpness: 24.0,
        mirror: 0.08,
        ..Surface::matte(base.lerp(solid.accent, strength), normal)
    }
}

fn roof(solid: &Solid, contact: &Contact, p: Vec3, footprint: f32) -> Vec3 {
    if contact.normal.z.abs() < 0.05 {
        return gable(solid, contact.point) * (1.0 + 0.12 * fbm3(p, 0.8, 3, footprint));
    }
    const ROW: f32 = 0.3;
    let (at, slope) = (contact.point, contact.normal.abs());
    let along = if slope.y > slope.x { at.x } else { at.y };
    let row = (at.z / ROW).floor();
    let column = (along / 0.28 + 0.5 * row.rem_euclid(2.0)).floor();
    let tile = hash(column as i32, row as i32, solid.seed as i32);
    let shade = 1.0 + 0.3 * fade(footprint / 0.3) * (unit(tile) - 0.5);
    let lip = at.z / ROW - row;
    let moss = smoothstep(0.1, 0.5, fbm3(p, 0.5, 4, footprint));
    let shadow = 0.35 * fade(footprint / 0.4) * smoothstep(0.3, 0.0, lip);
    let tiles = solid.tint * shade * (1.0 - shadow);
    tiles.lerp(rgb(0x7C7A4A), moss * 0.35) * (1.0 + 0.2 * fbm3(p, 1.1, 3, footprint))
}

/// Upright end of a roof: plaster around a small round window.
fn gable(solid: &Solid, p: Vec3) -> Vec3 {
    let r = Vec2::new(p.y, p.z - solid.half_size().z * 0.7).length();
    if r > 0.62 {
        solid.accent
    } else if r > 0.46 || p.y.abs() < 0.05 {
        rgb(0xF0E8D6)
    } else {
        rgb(0x35506B)
    }
}

/// Leaves as a mottle of two greens over bumpy normals.
fn foliage(
    dark: Vec3,
    light: Vec3,
    p: Vec3,
    normal: Vec3,
    frequency: f32,
    footprint: f32,
) -> Surface {
    let mottle = fbm3(p, frequency, 3, footprint);
    let strength = fade(frequency * footprint);
    let bump = Vec3::new(
        noise3(p * frequency + 5.0),
        noise3(p * frequency + 19.0),
        noise3(p * frequency + 43.0),
    );
    let normal = (normal + 0.8 * strength * bump).normalize_or_zero();
    let green = dark.lerp(light, smoothstep(-0.6, 0.6, mottle + 0.5 * normal.z));
    Surface {
        wrap: 0.35,
        ..Surface::matte(green, normal)
    }
}

fn leaves(solid: &Solid, contact: &Contact, p: Vec3, normal: Vec3, footprint: f32) -> Surface {
    let mut surface = foliage(solid.tint, solid.accent, p, normal, 5.5, footprint);
    let height = contact.point.z / solid.half_size().z * 0.5 + 0.5;
    surface.openness = 0.72 + 0.28 * height;
    if contact.inner {
        surface.openness = 0.5;
        surface.albedo *= 0.62;
    }
    surface
}

fn flowers(solid: &Solid, p: Vec3, normal: Vec3, footprint: f32) -> Surface {
    let mut surface = foliage(rgb(0x2F5E24), rgb(0x76A03C), p, normal, 14.0, footprint);
    let (distance, seed) = nearest_seed(p * 10.0);
    let petal =
        smoothstep(0.52, 0.42, distance) * f32::from(u8::from(unit(seed.rotate_left(5)) > 0.25));
    let colour = solid.colour(unit(seed) < 0.55);
    let heart = smoothstep(0.2, 0.12, distance);
    let blossom = colour.lerp(rgb(0xF6D24A), heart);
    surface.albedo = surface.albedo.lerp(blossom, petal);
    surface.openness = 0.9;
    surface
}
