//! Everything infinitely far away: sky, clouds, mountains and hills, as functions of direction.

use glam::{Vec2, Vec3};

use super::noise::{fbm2, fbm3, noise3, smoothstep};

/// Linear colour of an 8-bit `0xRRGGBB`, with gamma 2 (cheap, and exact under [`encode`]).
pub const fn rgb(hex: u32) -> Vec3 {
    let r = ((hex >> 16) & 255) as f32 / 255.0;
    let g = ((hex >> 8) & 255) as f32 / 255.0;
    let b = (hex & 255) as f32 / 255.0;
    Vec3::new(r * r, g * g, b * b)
}

/// Direction towards the sun.
pub const SUN: Vec3 = Vec3::new(0.571_548, 0.489_898, 0.658_281);
/// Linear light of the sun on a surface that faces it.
pub const SUN_LIGHT: Vec3 = Vec3::new(1.16, 1.04, 0.84);

/// Linear light that an open sky and the bright ground throw on a surface with this normal.
pub fn ambient(normal: Vec3) -> Vec3 {
    let up = normal.z * 0.5 + 0.5;
    Vec3::new(0.36, 0.31, 0.25).lerp(Vec3::new(0.36, 0.43, 0.56), up)
}

/// Sky without clouds; used for reflections too.
pub fn gradient(direction: Vec3) -> Vec3 {
    let up = direction.z.max(0.0);
    let low = rgb(0xE2EEF2).lerp(rgb(0x8FC3E8), smoothstep(0.0, 0.24, up));
    let sky = low.lerp(rgb(0x2F74C4), smoothstep(0.12, 0.75, up));
    let glow = direction.dot(SUN).max(0.0);
    sky + Vec3::new(0.30, 0.22, 0.10) * glow.powi(8)
}

/// Linear colour seen in a unit direction past everything near.
pub fn backdrop(direction: Vec3, pixel: f32) -> Vec3 {
    let flat = Vec2::new(direction.x, direction.y).normalize_or(Vec2::X);
    let climb = direction.z / Vec2::new(direction.x, direction.y).length().max(1e-6);
    let around = |frequency: f32, offset: f32, octaves: u32| {
        fbm3(Vec3::new(flat.x, flat.y, offset), frequency, octaves, 0.0)
    };
    let near = 0.035 + 0.03 * around(1.7, 3.0, 3);
    if climb < near {
        return meadow(flat, climb, near, pixel);
    }
    const HIGHEST: f32 = 0.301;
    if climb > HIGHEST {
        return clouds(direction, pixel);
    }
    let middle = 0.085 + 0.045 * around(2.1, 11.0, 5);
    if climb < middle {
        let at = Vec2::new(flat.to_angle() * 40.0, climb * 120.0);
        let woods = fbm2(at, 1.0, 3, pixel * 40.0);
        return rgb(0x5F8F78)
            .lerp(rgb(0x86AA9A), 0.5 - 0.6 * woods)
            .lerp(rgb(0xA9C6CE), 0.3);
    }
    let ridge = around(2.6, 29.0, 6);
    let far = 0.13 + 0.17 * smoothstep(-0.35, 0.6, ridge);
    if climb < far {
        return mountain(flat, climb, far, pixel);
    }
    clouds(direction, pixel)
}

fn meadow(flat: Vec2, climb: f32, top: f32, pixel: f32) -> Vec3 {
    let p = Vec2::new(flat.to_angle() * 14.0, (top - climb) * 60.0);
    let field = noise3(Vec3::new(p.x.floor() * 3.1, p.y.floor() * 5.7, 0.5)) * 0.5 + 0.5;
    let grass = rgb(0x7FA653).lerp(rgb(0xC2BE6B), field);
    grass * (1.0 + 0.25 * fbm2(p * 3.0, 1.0, 3, pixel * 40.0))
}

fn mountain(flat: Vec2, climb: f32, top: f32, pixel: f32) -> Vec3 {
    let p = Vec2::new(flat.to_angle() * 26.0, climb * 26.0);
    let folds = fbm2(p + 0.9 * Vec2::new(p.y, 0.0), 0.8, 4, pixel * 30.0);
    let rock = rgb(0x7C93B4).lerp(rgb(0xA5B8CE), smoothstep(-0.3, 0.4, folds));
    let snow_line = 0.205 + 0.035 * folds;
    let snow = smoothstep(snow_line, snow_line + 0.012, climb) * smoothstep(0.2, 0.24, top);
    rock.lerp(rgb(0xF3F6FA), snow * 0.9)
        .lerp(rgb(0xC9DDE8), 0.35 - climb)
}

/// Cumulus on a plane above the place, lit from the sun's side.
fn clouds(direction: Vec3, pixel: f32) -> Vec3 {
    let sky = gradient(direction);
    let p = Vec2::new(direction.x, direction.y) / (direction.z + 0.3) * 1.9;
    let footprint = 2.0 * pixel / (direction.z + 0.3);
    let warp = Vec2::from([p, p + 31.0].map(|p| fbm2(p, 1.3, 2, footprint)));
    let density = |q: Vec2| fbm2(q + 0.35 * warp, 1.25, 5, footprint);
    let here = density(p);
    let cover = smoothstep(0.02, 0.2, here);
    if cover <= 0.0 {
        return sky;
    }
    let toward_sun = density(p + Vec2::new(SUN.x, SUN.y) * 0.22);
    let shade = smoothstep(-0.25, 0.35, here - toward_sun + 0.08);
    let cloud = rgb(0xB9C6D8).lerp(rgb(0xFFFBF2), shade);
    let clear = 0.25 + 0.7 * smoothstep(0.0, 0.3, direction.z);
    sky.lerp(cloud, cover * clear)
}

/// Stored colour in `[0, 1]` of a linear one: a soft shoulder, then gamma 2.
pub fn encode(linear: Vec3) -> Vec3 {
    const KNEE: f32 = 0.7;
    let shoulder = |x: f32| {
        let over = (x - KNEE).max(0.0);
        x.clamp(0.0, KNEE) + (1.0 - KNEE) * (1.0 - (-over / (1.0 - KNEE)).exp())
    };
    Vec3::from(linear.to_array().map(|x| shoulder(x).sqrt()))
}
