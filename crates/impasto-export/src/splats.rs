//! Flat Gaussians on surfaces.

use glam::{Mat3, Quat, Vec3};

use crate::cloud::Surfel;

/// Standard deviation along the surface over the distance to the next splat: wide enough to leave
/// no holes where splats do not lie on a lattice.
const WIDTH: f32 = 0.6;
/// Thickness over the width.
const THICKNESS: f32 = 0.15;
/// Opacity in the middle before any fit.
const OPACITY: f32 = 0.9;

/// One Gaussian, in scene space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Splat {
    pub position: Vec3,
    /// From its own axes; of length 1.
    pub rotation: Quat,
    /// Standard deviations along its own axes, positive.
    pub scale: Vec3,
    /// In `[0, 1]`.
    pub colour: Vec3,
    /// In the middle, within (0, 1).
    pub opacity: f32,
    /// Outwards.
    pub normal: Vec3,
}

/// The splat of a point: two axes in the surface, the third across it.
pub(crate) fn splat(surfel: &Surfel) -> Splat {
    let normal = surfel.normal;
    let along = (surfel.slant - normal * normal.dot(surfel.slant))
        .normalize_or(normal.any_orthonormal_vector());
    let axes = Mat3::from_cols(along, normal.cross(along), normal);
    let width = (WIDTH * surfel.spacing).max(1e-7);
    Splat {
        position: surfel.position,
        rotation: Quat::from_mat3(&axes).normalize(),
        scale: Vec3::new(width * surfel.stretch, width, THICKNESS * width),
        colour: surfel.colour,
        opacity: OPACITY,
        normal,
    }
}
