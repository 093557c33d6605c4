//! The rider on a horse: a signed distance made of smoothly joined tapered capsules.

use glam::Vec3;
use rayon::prelude::*;

use super::anatomy::{Limb, limbs, smooth_min};

/// Statue units are metres before this scale.
pub const SCALE: f32 = 0.82;
/// Height of the statue's feet above the ground.
pub const FOOT: f32 = 1.62;
/// Cosine and sine of the turn about z.
const TURN: (f32, f32) = (0.921_061, 0.389_418);

/// Box around all bones, statue units.
const LOW: Vec3 = Vec3::new(-1.45, -0.78, -0.06);
const HIGH: Vec3 = Vec3::new(1.45, 0.78, 3.62);
/// Grid step of the table of distances that carries rays through empty space.
const CELL: f32 = 0.025;
/// Grid points along x, y and z.
const POINTS: [usize; 3] = [118, 64, 149];
/// How far interpolation in the table may overestimate, with the little by which tapered bones do.
const TABLE_ERROR: f32 = 0.012;
/// How softly limbs join.
const LIMB_BLEND: f32 = 0.05;
/// A point is on the surface when it is nearer than this.
const TOUCH: f32 = 4e-4;

/// The statue with its table of distances.
#[derive(Debug)]
pub struct Statue {
    limbs: Vec<Limb>,
    table: Vec<f32>,
    /// For the cell above each grid point, the limbs that shape the surface there, one bit each.
    relevant: Vec<u32>,
}

impl Statue {
    /// Builds the bones and fills the table.
    pub fn new() -> Self {
        let mut statue = Self {
            limbs: limbs(),
            table: Vec::new(),
            relevant: Vec::new(),
        };
        let [nx, ny, nz] = POINTS;
        let at = |index: usize| {
            let (x, y, z) = (index % nx, index / nx % ny, index / nx / ny);
            LOW + Vec3::new(x as f32, y as f32, z as f32) * CELL
        };
        let all = (1 << statue.limbs.len()) - 1;
        let points = 0..nx * ny * nz;
        statue.table = points
            .clone()
            .into_par_iter()
            .map(|index| statue.joined(at(index), all))
            .collect();
        let near = |index: usize| statue.limbs_near(at(index) + 0.5 * CELL, statue.table[index]);
        statue.relevant = points.into_par_iter().map(near).collect();
        statue
    }

    /// A world point in statue units.
    pub fn local(&self, p: Vec3) -> Vec3 {
        rotate(p - Vec3::Z * FOOT, -TURN.1) / SCALE
    }

    /// Distance to the surface in statue units, negative inside; a slight overestimate where bones
    /// taper.
    pub fn distance(&self, p: Vec3) -> f32 {
        let (index, _) = cell(p);
        self.joined(p, self.relevant[index])
    }

    /// Bits of the limbs that can matter within the cell around `middle`, at whose lowest corner
    /// the distance is `distance`.
    fn limbs_near(&self, middle: Vec3, distance: f32) -> u32 {
        // From the cell's corner to any point and back, and twice the reach of a joint.
        let reach = distance.max(0.0) + 2.62 * CELL + 2.0 * LIMB_BLEND;
        let bit = |(index, limb): (usize, &Limb)| {
            let outside = (limb.low - middle).max(middle - limb.high).max(Vec3::ZERO);
            u32::from(outside.length() < reach) << index
        };
        self.limbs.iter().enumerate().map(bit).sum()
    }

    /// Distance to the smooth union of the limbs whose bits are set.
    fn joined(&self, p: Vec3, mut bits: u32) -> f32 {
        let mut d = f32::INFINITY;
        while bits != 0 {
            let limb = &self.limbs[bits.trailing_zeros() as usize];
            bits &= bits - 1;
            d = smooth_min(d, limb.distance(p), LIMB_BLEND);
        }
        d
    }

    /// A unit ray of the world in statue units, with the distances at which it enters and leaves the
    /// box around all bones.
    fn enter(&self, origin: Vec3, direction: Vec3) -> (Vec3, Vec3, [f32; 2]) {
        let (o, d) = (self.local(origin), rotate(direction, -TURN.1));
        let inverse = d.recip();
        let (a, b) = ((LOW - o) * inverse, (HIGH - o) * inverse);
        let (start, end) = (a.min(b).max_element(), a.max(b).min_element());
        (o, d, [start, end])
    }

    /// Where the unit ray (world) first touches the surface before `max`.
    pub fn hit(&self, origin: Vec3, direction: Vec3, max: f32) -> Option<f32> {
        let (o, d, [start, end]) = self.enter(origin, direction);
        let mut t = start.max(0.0);
        let end = end.min(max / SCALE);
        for _ in 0..160 {
            if t >= end {
                return None;
            }
            let p = o + d * t;
            let bound = self.tabled(p) * 0.95 - TABLE_ERROR;
            if bound > 0.008 {
                t += bound;
                continue;
            }
            let near = self.distance(p);
            if near < TOUCH {
                return Some(t * SCALE);
            }
            t += near * 0.95;
        }
        None
    }

    /// How much sun reaches a surface point past the statue: 0 none, 1 all, between in penumbrae.
    pub fn sunlight(&self, origin: Vec3, sun: Vec3) -> f32 {
        let (o, d, [start, end]) = self.enter(origin, sun);
        let mut t = start.max(0.02);
        let mut light = 1.0f32;
        for _ in 0..96 {
            if t >= end {
                break;
            }
            let near = self.tabled(o + d * t);
            light = light.min(0.5 + 0.5 * near / (0.02 * t + 0.004));
            if light <= 0.0 {
                return 0.0;
            }
            t += (near * 0.85).max(0.012);
        }
        light * light * (3.0 - 2.0 * light)
    }

    /// Outward unit normal at a world point on the surface.
    pub fn normal(&self, point: Vec3) -> Vec3 {
        let p = self.local(point);
        let mut gradient = Vec3::ZERO;
        for corner in [
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::ONE,
        ] {
            gradient += corner * self.distance(p + corner * 1.5e-3);
        }
        rotate(gradient.normalize_or(Vec3::Z), TURN.1)
    }

    /// Openness in `[0, 1]` of a surface point: small in folds and under the belly.
    pub fn openness(&self, point: Vec3, normal: Vec3) -> f32 {
        let p = self.local(point);
        let n = rotate(normal, -TURN.1);
        let near = self.tabled(p + n * 0.05) / 0.05;
        let far = self.tabled(p + n * 0.2) / 0.2;
        (0.5 * near + 0.5 * far).clamp(0.0, 1.0)
    }

    /// Share of gold leaf at a world point on the surface: the sabre and the hem of the saddle cloth.
    pub fn gilding(&self, point: Vec3) -> f32 {
        let p = self.local(point);
        let sabre = p.z > 2.72 && p.x > 0.3;
        let hem = ((p.x + 0.06).abs() - 0.4).max(0.93 - p.z);
        let cloth = p.y.abs() < 0.37 && (0.85..1.5).contains(&p.z) && hem.abs() < 0.028;
        f32::from(u8::from(sabre || cloth))
    }

    /// Distance interpolated in the table; outside of it, that of the nearest point inside.
    fn tabled(&self, p: Vec3) -> f32 {
        let [nx, ny, _] = POINTS;
        let (index, w) = cell(p);
        let row = |at: usize| self.table[at] + (self.table[at + 1] - self.table[at]) * w.x;
        let plane = |at: usize| {
            let a = row(at);
            a + (row(at + nx) - a) * w.y
        };
        let a = plane(index);
        a + (plane(index + nx * ny) - a) * w.z
    }
}

/// Index of the table's cell around `p`, or of the nearest one, and the position within it.
fn cell(p: Vec3) -> (usize, Vec3) {
    let [nx, ny, nz] = POINTS;
    let last = Vec3::new((nx - 1) as f32, (ny - 1) as f32, (nz - 1) as f32) - 1e-3;
    let at = ((p - LOW) / CELL).clamp(Vec3::ZERO, last);
    let (x, y, z) = (at.x as usize, at.y as usize, at.z as usize);
    (
        (z * ny + y) * nx + x,
        at - Vec3::new(x as f32, y as f32, z as f32),
    )
}

fn rotate(v: Vec3, sine: f32) -> Vec3 {
    Vec3::new(TURN.0 * v.x - sine * v.y, sine * v.x + TURN.0 * v.y, v.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table must never carry a ray through the surface.
    #[test]
    fn tabled_bound_stays_below_the_distance() {
        let statue = Statue::new();
        for index in 0..20_000u32 {
            let pick = |k| super::super::noise::draw(index, k);
            let p = LOW + (HIGH - LOW) * Vec3::new(pick(0), pick(1), pick(2));
            let bound = statue.tabled(p) * 0.95 - TABLE_ERROR;
            assert!(bound <= statue.distance(p).max(0.0), "{p}");
        }
    }

    #[test]
    fn limbs_left_out_do_not_matter() {
        let statue = Statue::new();
        let all = (1 << statue.limbs.len()) - 1;
        for index in 0..20_000u32 {
            let pick = |k| super::super::noise::draw(index, k);
            let p = LOW + (HIGH - LOW) * Vec3::new(pick(0), pick(1), pick(2));
            let (some, every) = (statue.distance(p), statue.joined(p, all));
            assert!((some - every).abs() < 1e-4, "{p}: {some} {every}");
        }
    }

    #[test]
    fn box_contains_the_limbs() {
        for limb in limbs() {
            assert!(limb.low.cmpge(LOW).all(), "{}", limb.low);
            assert!(limb.high.cmple(HIGH).all(), "{}", limb.high);
        }
    }
}
