//! What light meets, and where that is on the face of a box.

use glam::{Vec2, Vec3};

use super::solids::Contact;

/// What light meets at a point.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Linear share of light thrown back.
    pub albedo: Vec3,
    /// Unit normal in the world, bumps included.
    pub normal: Vec3,
    /// Share of the sky that reaches the point, `[0, 1]`.
    pub openness: f32,
    /// Colour of highlights (Blinn–Phong).
    pub shine: Vec3,
    /// Sharpness of highlights: the Blinn–Phong exponent.
    pub sharpness: f32,
    /// Share of the mirrored sky that is added.
    pub mirror: f32,
    /// How far light wraps around edges, `[0, 1]`: foliage lets it through.
    pub wrap: f32,
}

impl Surface {
    /// A dull surface.
    pub fn matte(albedo: Vec3, normal: Vec3) -> Self {
        Self {
            albedo,
            normal,
            openness: 1.0,
            shine: Vec3::ZERO,
            sharpness: 1.0,
            mirror: 0.0,
            wrap: 0.0,
        }
    }
}

/// Position on a box's face: metres along the face and up, and the face's half length.
pub(super) fn on_face(contact: &Contact, half: Vec3) -> (Vec2, f32) {
    let (p, n) = (contact.point, contact.normal.abs());
    if n.x > n.y.max(n.z) {
        (Vec2::new(p.y, p.z + half.z), half.y)
    } else if n.y > n.z {
        (Vec2::new(p.x, p.z + half.z), half.x)
    } else {
        (Vec2::new(p.x, p.y), half.x)
    }
}
