//! Flat Gaussians on surfaces.

use glam::{Mat3, Quat, Vec3};

use crate::cloud::{LEAST_COSINE, Surfel};

/// Standard deviation along the surface over the distance to the next splat: wide enough to leave
/// no holes where splats do not lie on a lattice.
const WIDTH: f32 = 0.7;
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
    let normal = turned(surfel.normal, surfel.toward);
    let along = (surfel.toward - normal * normal.dot(surfel.toward))
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

/// A normal that is turned towards the camera as far as its splat, which is only so long, needs to
/// fill its place in the picture: edge-on it would leave gaps.
fn turned(normal: Vec3, toward: Vec3) -> Vec3 {
    let cosine = normal.dot(toward);
    if cosine >= LEAST_COSINE || toward == Vec3::ZERO {
        return normal;
    }
    let aside = (normal - toward * cosine).normalize_or(toward.any_orthonormal_vector());
    let sine = (1.0 - LEAST_COSINE * LEAST_COSINE).sqrt();
    toward * LEAST_COSINE + aside * sine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_splat_is_seen_edge_on_by_the_camera_that_shows_it_best() {
        let toward = Vec3::new(0.0, 0.6, 0.8);
        for normal in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Z, -toward, toward] {
            let found = turned(normal, toward);
            assert!((found.length() - 1.0).abs() < 1e-5, "{found}");
            assert!(found.dot(toward) >= LEAST_COSINE - 1e-5, "{found}");
        }
        assert_eq!(turned(Vec3::Z, toward), Vec3::Z);
    }
}
