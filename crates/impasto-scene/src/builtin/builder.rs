//! Placing painted shapes in frames that are moved and turned about z.

use glam::{Vec2, Vec3};

use super::sky::rgb;
use super::solids::{Material, Primitive, Solid};

/// A material with its two colours.
#[derive(Debug, Clone, Copy)]
pub struct Paint {
    material: Material,
    tint: Vec3,
    accent: Vec3,
}

impl Paint {
    /// A material in two `0xRRGGBB` colours.
    pub fn two(material: Material, tint: u32, accent: u32) -> Self {
        Self {
            material,
            tint: rgb(tint),
            accent: rgb(accent),
        }
    }

    /// A material in one colour.
    pub fn one(material: Material, tint: u32) -> Self {
        Self::two(material, tint, tint)
    }
}

/// Collects solids placed relative to the current frame.
#[derive(Debug, Default)]
pub struct Builder {
    solids: Vec<Solid>,
    origin: Vec3,
    turn: f32,
}

impl Builder {
    /// Moves the frame's origin to `radius` metres from the statue in direction `angle` and turns
    /// the frame by `turn`, both in radians.
    pub fn frame(&mut self, radius: f32, angle: f32, turn: f32) {
        self.origin = (Vec2::from_angle(angle) * radius).extend(0.0);
        self.turn = turn;
    }

    /// A box of half extents `half` around `at`.
    pub fn block(&mut self, half: [f32; 3], at: [f32; 3], paint: Paint) {
        self.put(Primitive::Block(half.into()), at, 0.0, paint);
    }

    /// An upright cone stump standing on `at`; `radii` at the foot and the top.
    pub fn stump(&mut self, radii: [f32; 2], height: f32, at: [f32; 3], paint: Paint) {
        let [bottom, top] = radii;
        self.put(Primitive::Stump([bottom, top, height]), at, 0.0, paint);
    }

    /// An ellipsoid around `at`.
    pub fn ball(&mut self, radii: [f32; 3], at: [f32; 3], paint: Paint) {
        self.put(Primitive::Ellipsoid(radii.into()), at, 0.0, paint);
    }

    /// A roof standing on `at`: `size` is half length, half width, height and half ridge.
    pub fn roof(&mut self, size: [f32; 4], at: [f32; 3], turn: f32, paint: Paint) {
        self.put(Primitive::Ridge(size), at, turn, paint);
    }

    fn put(&mut self, shape: Primitive, at: [f32; 3], turn: f32, paint: Paint) {
        let (s, c) = self.turn.sin_cos();
        let offset = Vec3::new(c * at[0] - s * at[1], s * at[0] + c * at[1], at[2]);
        let (sine, cosine) = (self.turn + turn).sin_cos();
        self.solids.push(Solid {
            shape,
            origin: self.origin + offset,
            turn: (cosine, sine),
            material: paint.material,
            tint: paint.tint,
            accent: paint.accent,
            seed: self.solids.len() as u32 * 31 + 7,
        });
    }

    /// Everything that was placed.
    pub fn into_solids(self) -> Vec<Solid> {
        self.solids
    }
}
