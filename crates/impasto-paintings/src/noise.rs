//! Hash-based smooth noise and jittered cells, all functions of a point and a seed.

use crate::maths::mix;
use glam::Vec2;

/// 32 well-mixed bits of a lattice point.
pub(crate) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x85eb_ca6b)
        ^ (y as u32).wrapping_mul(0xc2b2_ae35)
        ^ seed.wrapping_mul(0x27d4_eb2f);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// Uniform in `[0, 1)` for a lattice point.
pub(crate) fn hash_unit(x: i32, y: i32, seed: u32) -> f32 {
    (hash(x, y, seed) >> 8) as f32 / 16_777_216.0
}

/// Smooth value noise in `[0, 1]` with features of size 1.
pub(crate) fn noise(p: Vec2, seed: u32) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let ease = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let (x, y) = (cell.x as i32, cell.y as i32);
    let (x1, y1) = (x.wrapping_add(1), y.wrapping_add(1));
    let top = mix(hash_unit(x, y, seed), hash_unit(x1, y, seed), ease.x);
    let bottom = mix(hash_unit(x, y1, seed), hash_unit(x1, y1, seed), ease.x);
    mix(top, bottom, ease.y)
}

/// Sum of `octaves` of noise, each twice as fine and half as strong, in `[0, 1]`; mean about ½.
pub(crate) fn fractal(p: Vec2, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut q) = (0.0, 1.0, 0.0, p);
    for octave in 0..octaves.max(1) {
        sum += weight * noise(q, seed.wrapping_add(octave));
        total += weight;
        weight *= 0.5;
        // Turned between octaves, or the lattice shows.
        q = Vec2::new(q.x * 1.6 - q.y * 1.2, q.x * 1.2 + q.y * 1.6);
    }
    sum / total
}

/// Two independent fractal noises, each in `[-1, 1]`: a displacement.
pub(crate) fn drift(p: Vec2, octaves: u32, seed: u32) -> Vec2 {
    Vec2::new(
        fractal(p, octaves, seed) * 2.0 - 1.0,
        fractal(p, octaves, seed ^ 0x5bd1_e995) * 2.0 - 1.0,
    )
}

/// One cell of a jittered tiling.
pub(crate) struct Cell {
    /// The cell's centre.
    pub site: Vec2,
    /// Random bits of this cell.
    pub id: u32,
    /// Distance from the point to the cell's border.
    pub border: f32,
}

/// The cell (nearest of jittered lattice sites, `size` apart) that holds `p`. `jitter` in `[0, 1]`
/// goes from a square lattice to irregular cells; odd rows are shifted by half a cell by `stagger`.
pub(crate) fn cell(p: Vec2, size: f32, jitter: f32, stagger: bool, seed: u32) -> Cell {
    let q = p / size;
    let home = q.floor();
    let mut sites = [(Vec2::ZERO, 0u32); 9];
    let mut nearest = 0;
    for (k, slot) in sites.iter_mut().enumerate() {
        let x = home.x as i32 + (k as i32 % 3) - 1;
        let y = home.y as i32 + (k as i32 / 3) - 1;
        let h = hash(x, y, seed);
        let offset = Vec2::new((h & 0xffff) as f32, (h >> 16) as f32) / 65_536.0 - 0.5;
        let shift = if stagger && y & 1 == 1 { 0.5 } else { 0.0 };
        let centre = Vec2::new(x as f32 + 0.25 + shift, y as f32 + 0.5);
        *slot = (centre + offset * jitter * 0.9, hash(x, y, seed ^ 77));
    }
    for k in 1..9 {
        if (sites[k].0 - q).length_squared() < (sites[nearest].0 - q).length_squared() {
            nearest = k;
        }
    }
    let (site, id) = sites[nearest];
    let mut border = f32::INFINITY;
    for (k, &(other, _)) in sites.iter().enumerate() {
        let apart = other - site;
        if k != nearest && apart.length_squared() > 1e-9 {
            border = border.min(((other + site) * 0.5 - q).dot(apart.normalize()));
        }
    }
    Cell {
        site: site * size,
        id,
        border: border.max(0.0) * size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_bounded_continuous_and_not_flat() {
        let (mut low, mut high) = (1.0f32, 0.0f32);
        for i in 0..4000 {
            let p = Vec2::new(i as f32 * 0.013 - 20.0, i as f32 * 0.007);
            let (a, b) = (noise(p, 9), noise(p + Vec2::splat(1e-3), 9));
            assert!((0.0..=1.0).contains(&a));
            assert!((a - b).abs() < 0.01, "jump at {p}");
            low = low.min(a);
            high = high.max(a);
        }
        assert!(high - low > 0.6);
    }

    #[test]
    fn a_cell_contains_its_own_site() {
        for i in 0..50 {
            let p = Vec2::new(i as f32 * 3.7, i as f32 * 1.9);
            let c = cell(p, 10.0, 0.8, true, 4);
            let at_site = cell(c.site, 10.0, 0.8, true, 4);
            assert_eq!(c.id, at_site.id);
            assert!(c.border >= 0.0 && at_site.border >= c.border * 0.2);
        }
    }
}
