//! Analytic solids and their intersection with rays.

use glam::Vec3;

use super::noise::noise3;

/// What a solid's surface is made of; [`super::materials`] turns it into colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// Ashlar blocks with joints.
    Ashlar,
    /// Plain dressed stone.
    Stone,
    /// Bronze tablet with lines of raised letters.
    Tablet,
    /// House front: plaster, brick, or timber frame, with windows and a door.
    Facade(Wall),
    /// Square tower with clocks.
    Tower,
    /// Tiled slopes; upright ends are walls of the accent colour.
    Roof,
    /// Tree bark.
    Bark,
    /// Foliage with holes.
    Leaves,
    /// Clipped foliage without holes.
    Hedge,
    /// Foliage strewn with blossoms of the accent colour.
    Flowers,
    /// Painted planks.
    Wood,
    /// Painted metal.
    Iron,
    /// Frosted lamp glass.
    Lamp,
    /// Striped cloth around a pole.
    Canvas,
}

/// How a house front is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wall {
    /// Coloured plaster with shutters.
    Plaster,
    /// Brick with stone corners.
    Brick,
    /// Dark beams and light infill.
    Timber,
}

/// A shape in its own frame; lengths in metres.
#[derive(Debug, Clone, Copy)]
pub enum Primitive {
    /// Box around the origin, by half of each side.
    Block(Vec3),
    /// Ridge roof standing on z = 0: half length along the ridge, half width across it, height, and
    /// half length of the ridge itself. `ridge == half_x` gives a gable, 0 a pyramid.
    Ridge([f32; 4]),
    /// Upright cone stump standing on z = 0: radius at the foot and at the top, and height.
    Stump([f32; 3]),
    /// Ellipsoid around the origin, by its half axes.
    Ellipsoid(Vec3),
}

impl Primitive {
    /// Lowest and highest corner of the box around it.
    fn bounds(&self) -> (Vec3, Vec3) {
        match *self {
            Self::Block(half) | Self::Ellipsoid(half) => (-half, half),
            Self::Ridge([x, y, height, _]) => (Vec3::new(-x, -y, 0.0), Vec3::new(x, y, height)),
            Self::Stump([bottom, top, height]) => {
                let r = bottom.max(top);
                (Vec3::new(-r, -r, 0.0), Vec3::new(r, r, height))
            }
        }
    }
}

/// A placed, coloured shape.
#[derive(Debug, Clone, Copy)]
pub struct Solid {
    /// Geometry in the solid's frame.
    pub shape: Primitive,
    /// Where the frame's origin lies.
    pub origin: Vec3,
    /// Cosine and sine of the turn about z.
    pub turn: (f32, f32),
    /// What it is made of.
    pub material: Material,
    /// Main linear colour.
    pub tint: Vec3,
    /// Second linear colour.
    pub accent: Vec3,
    /// Varies patterns between solids.
    pub seed: u32,
}

/// Where a ray meets a solid, in the solid's frame.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// Distance along the unit ray.
    pub t: f32,
    /// Point.
    pub point: Vec3,
    /// Outward unit normal.
    pub normal: Vec3,
    /// Whether the ray slipped through a hole to the inside of foliage.
    pub inner: bool,
}

/// Size of the inner, closed shell of foliage relative to the outer one.
const INNER_SHELL: f32 = 0.84;

impl Solid {
    /// The main colour, or else the second one.
    pub fn colour(&self, main: bool) -> Vec3 {
        if main { self.tint } else { self.accent }
    }

    /// A world vector in the solid's frame.
    pub fn local(&self, v: Vec3) -> Vec3 {
        let (c, s) = self.turn;
        Vec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z)
    }

    /// A vector of the solid's frame in the world.
    pub fn world(&self, v: Vec3) -> Vec3 {
        let (c, s) = self.turn;
        Vec3::new(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
    }

    /// Half of each side of the box around the solid in its own frame.
    pub fn half_size(&self) -> Vec3 {
        let (low, high) = self.shape.bounds();
        (high - low) * 0.5
    }

    /// Axis-aligned box around the solid: lowest and highest corner.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let (low, high) = self.shape.bounds();
        let (c, s) = (self.turn.0.abs(), self.turn.1.abs());
        let half = (high - low) * 0.5;
        let half = Vec3::new(c * half.x + s * half.y, s * half.x + c * half.y, half.z);
        let middle = self.origin + self.world((low + high) * 0.5);
        (middle - half, middle + half)
    }

    /// First contact of the ray with parameter in `(min, max)`; `direction` is a unit vector.
    pub fn hit(&self, origin: Vec3, direction: Vec3, min: f32, max: f32) -> Option<Contact> {
        let o = self.local(origin - self.origin);
        let d = self.local(direction);
        let found = match self.shape {
            Primitive::Block(half) => hit_block(half, o, d, min),
            Primitive::Ridge(size) => hit_ridge(size, o, d, min),
            Primitive::Stump(size) => hit_stump(size, o, d, min),
            Primitive::Ellipsoid(radii) if self.material == Material::Leaves => {
                return self.hit_leaves(radii, o, d, min, max);
            }
            Primitive::Ellipsoid(radii) => {
                let (near, _) = ellipsoid_roots(radii, o, d)?;
                (near > min).then(|| (near, ((o + d * near) / (radii * radii)).normalize_or_zero()))
            }
        };
        let (t, normal) = found?;
        (t < max).then(|| Contact {
            t,
            point: o + d * t,
            normal,
            inner: false,
        })
    }

    /// Foliage: an outer shell with noise-shaped holes around a closed inner one.
    fn hit_leaves(&self, radii: Vec3, o: Vec3, d: Vec3, min: f32, max: f32) -> Option<Contact> {
        let (near, far) = ellipsoid_roots(radii, o, d)?;
        if near >= max {
            return None;
        }
        let contact = |t: f32, inner: bool| {
            let point = o + d * t;
            Contact {
                t,
                point,
                normal: (point / (radii * radii)).normalize_or_zero(),
                inner,
            }
        };
        if near > min && !self.is_hole(o + d * near) {
            return Some(contact(near, false));
        }
        if let Some((t, _)) = ellipsoid_roots(radii * INNER_SHELL, o, d) {
            return (t > min && t < max).then(|| contact(t, true));
        }
        (far > min && far < max && !self.is_hole(o + d * far)).then(|| contact(far, true))
    }

    fn is_hole(&self, p: Vec3) -> bool {
        noise3(p * 3.6 + Vec3::splat((self.seed % 101) as f32)) > 0.24
    }
}

fn hit_block(half: Vec3, o: Vec3, d: Vec3, min: f32) -> Option<(f32, Vec3)> {
    let inverse = d.recip();
    let (a, b) = ((-half - o) * inverse, (half - o) * inverse);
    let (near, far) = (a.min(b), a.max(b));
    let t = near.max_element();
    if t <= min || t > far.min_element() {
        return None;
    }
    let normal = if near.x == t {
        Vec3::X * -d.x.signum()
    } else if near.y == t {
        Vec3::Y * -d.y.signum()
    } else {
        Vec3::Z * -d.z.signum()
    };
    Some((t, normal))
}

fn hit_ridge([x, y, height, ridge]: [f32; 4], o: Vec3, d: Vec3, min: f32) -> Option<(f32, Vec3)> {
    let planes = [
        (Vec3::new(0.0, 0.0, -1.0), 0.0),
        (Vec3::new(0.0, height, y), height * y),
        (Vec3::new(0.0, -height, y), height * y),
        (Vec3::new(height, 0.0, x - ridge), height * x),
        (Vec3::new(-height, 0.0, x - ridge), height * x),
    ];
    let (mut near, mut far, mut normal) = (f32::NEG_INFINITY, f32::INFINITY, Vec3::Z);
    for (n, offset) in planes {
        let (speed, gap) = (n.dot(d), offset - n.dot(o));
        if speed < 0.0 {
            let t = gap / speed;
            if t > near {
                (near, normal) = (t, n);
            }
        } else if speed > 0.0 {
            far = far.min(gap / speed);
        } else if gap < 0.0 {
            return None;
        }
    }
    (near > min && near <= far).then(|| (near, normal.normalize_or_zero()))
}

fn hit_stump([bottom, top, height]: [f32; 3], o: Vec3, d: Vec3, min: f32) -> Option<(f32, Vec3)> {
    let slope = (top - bottom) / height;
    let (r, dr) = (bottom + slope * o.z, slope * d.z);
    let a = d.x * d.x + d.y * d.y - dr * dr;
    let b = o.x * d.x + o.y * d.y - r * dr;
    let c = o.x * o.x + o.y * o.y - r * r;
    let mut best: Option<(f32, Vec3)> = None;
    let root = b * b - a * c;
    if root >= 0.0 && a.abs() > 1e-9 {
        let root = root.sqrt();
        for t in [(-b - root) / a, (-b + root) / a] {
            let p = o + d * t;
            let inside = t > min && (0.0..=height).contains(&p.z) && bottom + slope * p.z >= 0.0;
            if inside && best.is_none_or(|(known, _)| t < known) {
                let out =
                    Vec3::new(p.x, p.y, -slope * (bottom + slope * p.z)).normalize_or(Vec3::Z);
                best = Some((t, out));
            }
        }
    }
    for (z, radius, normal) in [(0.0, bottom, -Vec3::Z), (height, top, Vec3::Z)] {
        let t = (z - o.z) / d.z;
        let p = o + d * t;
        let inside = t > min && p.x * p.x + p.y * p.y <= radius * radius;
        if inside && best.is_none_or(|(known, _)| t < known) {
            best = Some((t, normal));
        }
    }
    best
}

fn ellipsoid_roots(radii: Vec3, o: Vec3, d: Vec3) -> Option<(f32, f32)> {
    let (o, d) = (o / radii, d / radii);
    let a = d.length_squared();
    let b = o.dot(d);
    // The distance of the ray from the centre, instead of b² − ac, keeps f32 precise.
    let root = a - (o * a.sqrt() - d * (b / a.sqrt())).length_squared();
    if root <= 0.0 {
        return None;
    }
    let root = root.sqrt();
    Some(((-b - root) / a, (-b + root) / a))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid(shape: Primitive) -> Solid {
        Solid {
            shape,
            origin: Vec3::new(1.0, 2.0, 0.5),
            turn: (0.6, 0.8),
            material: Material::Stone,
            tint: Vec3::ONE,
            accent: Vec3::ONE,
            seed: 3,
        }
    }

    /// Contacts lie inside the bounds, on the ray, and their normals face it.
    #[test]
    fn contacts_are_consistent_for_every_shape() {
        let shapes = [
            Primitive::Block(Vec3::new(0.5, 0.7, 0.9)),
            Primitive::Ridge([1.0, 0.6, 0.8, 0.4]),
            Primitive::Stump([0.8, 0.3, 1.2]),
            Primitive::Ellipsoid(Vec3::new(0.5, 1.0, 0.7)),
        ];
        for shape in shapes {
            let solid = solid(shape);
            let (low, high) = solid.bounds();
            let mut hits = 0;
            for index in 0..2000 {
                let pick = |k: i32| super::super::noise::draw(index, k) * 2.0 - 1.0;
                let origin = Vec3::new(pick(0), pick(1), pick(2)).normalize_or_zero() * 9.0;
                let target = solid.origin + Vec3::new(pick(3), pick(4), pick(5));
                let direction = (target - origin).normalize_or_zero();
                let Some(contact) = solid.hit(origin, direction, 1e-4, 100.0) else {
                    continue;
                };
                hits += 1;
                let world = origin + direction * contact.t;
                assert!(
                    world.cmpge(low - 1e-4).all() && world.cmple(high + 1e-4).all(),
                    "{shape:?} {world}"
                );
                let back = solid.origin + solid.world(contact.point);
                assert!(back.distance(world) < 1e-4);
                assert!(
                    solid.world(contact.normal).dot(direction) <= 1e-4,
                    "{shape:?}"
                );
                assert!((contact.normal.length() - 1.0).abs() < 1e-4);
            }
            assert!(hits > 300, "{shape:?}: {hits}");
        }
    }
}
