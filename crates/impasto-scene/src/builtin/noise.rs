//! Integer-hashed value noise: the same numbers on every machine and thread.
//!
//! Patterns take a *footprint*, the width in metres that one pixel covers on the surface, and fade
//! out what is finer: two cameras then agree on a surface's colour instead of aliasing it apart.

use glam::{Vec2, Vec3};

/// Hash of a lattice point.
pub fn hash(x: i32, y: i32, z: i32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77).rotate_left(11)
        ^ (z as u32).wrapping_mul(0xC2B2_AE3D).rotate_left(22);
    h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
    h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    h ^ (h >> 16)
}

/// A hash as a number in `[0, 1)`.
pub fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / 16_777_216.0
}

/// The `index`-th number in `[0, 1)` of the sequence called `seed`.
pub fn draw(seed: u32, index: i32) -> f32 {
    unit(hash(seed as i32, index, 0x51))
}

/// Hermite step from 0 at `low` to 1 at `high`.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn lattice(h: u32) -> f32 {
    unit(h) * 2.0 - 1.0
}

/// `x.floor()` without the library call that it is on processors older than SSE4.
fn floor(x: f32) -> i32 {
    let toward_zero = x as i32;
    toward_zero - i32::from(x < toward_zero as f32)
}

/// Smooth noise in `[-1, 1]` with one feature per unit length.
pub fn noise3(p: Vec3) -> f32 {
    let (x, y, z) = (floor(p.x), floor(p.y), floor(p.z));
    let f = p - Vec3::new(x as f32, y as f32, z as f32);
    let w = f * f * (Vec3::splat(3.0) - 2.0 * f);
    let row = |y: i32, z: i32| {
        let a = lattice(hash(x, y, z));
        a + (lattice(hash(x + 1, y, z)) - a) * w.x
    };
    let plane = |z: i32| {
        let a = row(y, z);
        a + (row(y + 1, z) - a) * w.y
    };
    let a = plane(z);
    a + (plane(z + 1) - a) * w.z
}

/// Two-dimensional [`noise3`].
pub fn noise2(p: Vec2) -> f32 {
    let (x, y) = (floor(p.x), floor(p.y));
    let f = p - Vec2::new(x as f32, y as f32);
    let w = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let row = |y: i32| {
        let a = lattice(hash(x, y, 7));
        a + (lattice(hash(x + 1, y, 7)) - a) * w.x
    };
    let a = row(y);
    a + (row(y + 1) - a) * w.y
}

/// How much of a pattern survives when a pixel spans `cycles` of it: all below a quarter, none
/// above six tenths.
pub fn fade(cycles: f32) -> f32 {
    1.0 - smoothstep(0.25, 0.6, cycles)
}

/// Sum of up to `octaves` octaves of [`noise3`] from `frequency` (cycles per metre), about `[-1, 1]`,
/// without those finer than `footprint` metres.
pub fn fbm3(p: Vec3, frequency: f32, octaves: u32, footprint: f32) -> f32 {
    fractal_sum(frequency, octaves, footprint, |f, shift| {
        noise3(p * f + Vec3::splat(shift))
    })
}

/// Two-dimensional [`fbm3`].
pub fn fbm2(p: Vec2, frequency: f32, octaves: u32, footprint: f32) -> f32 {
    fractal_sum(frequency, octaves, footprint, |f, shift| {
        noise2(p * f + Vec2::splat(shift))
    })
}

/// The sum of octaves of a noise, which is given its frequency and a shift of its own.
fn fractal_sum(
    frequency: f32,
    octaves: u32,
    footprint: f32,
    noise: impl Fn(f32, f32) -> f32,
) -> f32 {
    let (mut f, mut amplitude, mut sum) = (frequency, 0.6, 0.0);
    for octave in 0..octaves {
        let weight = fade(f * footprint);
        if weight <= 0.0 {
            break;
        }
        sum += amplitude * weight * noise(f, 17.3 * octave as f32);
        f *= 2.07;
        amplitude *= 0.5;
    }
    sum
}

/// Distance from `p` to the nearest of one random point per unit cell, and that point's hash.
pub fn nearest_seed(p: Vec3) -> (f32, u32) {
    let base = p.floor();
    let mut best = (f32::INFINITY, 0);
    for index in 0..27 {
        let beside = [index % 3, index / 3 % 3, index / 9].map(|i| (i - 1) as f32);
        let cell = base + Vec3::from(beside);
        let h = hash(cell.x as i32, cell.y as i32, cell.z as i32);
        let inside = [h, h.rotate_left(12), h.wrapping_mul(0x9E37_79B1)].map(unit);
        let inside = Vec3::from(inside);
        let distance = (cell + inside).distance_squared(p);
        if distance < best.0 {
            best = (distance, h);
        }
    }
    (best.0.sqrt(), best.1)
}

/// Share of a pixel covered by a line of half-width `half` whose middle is `distance` away.
pub fn line(distance: f32, half: f32, footprint: f32) -> f32 {
    let width = footprint.max(1e-5);
    ((half - distance) / width + 0.5).clamp(0.0, 1.0) * (2.0 * half / width).min(1.0)
}
