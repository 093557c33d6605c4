//! From depths to surfaces: smoothed depths and normals.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::views::{Pinhole, PosedView};

/// Half the side of the window that a plane is fitted to.
const REACH: i32 = 2;
/// Least share of a window that must lie on the plane of its middle. Less is an edge, or noise.
const LEAST_SHARE: f32 = 0.4;
/// Radius at which what is infinitely far, or farther than this, is put: far enough for hardly
/// any parallax, near enough for viewers with a far plane.
pub(crate) const SKY: f32 = 60.0;

/// How far two depths of one surface may differ: a share of the depth, which far away grows as an
/// uncertain parallax makes it.
pub(crate) fn tolerance(depth: f32) -> f32 {
    depth * (0.02 + 0.01 * depth)
}

/// Whether two depths can be one surface's.
pub(crate) fn agree(a: f32, b: f32) -> bool {
    (a - b).abs() < tolerance(a.min(b))
}

/// What a view shows at one pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Along the camera's axis; finite.
    pub depth: f32,
    /// In scene space, towards the camera; zero where depths say nothing of it.
    pub normal: Vec3,
    /// Whether it lies at the greatest distance there is.
    pub sky: bool,
}

/// Samples of all pixels, row by row.
pub(crate) fn samples(view: &PosedView) -> Vec<Sample> {
    let camera = &view.camera;
    let depths: Vec<(f32, bool)> = (0..view.depth.len())
        .into_par_iter()
        .map(|i| limited(camera, i % camera.width, i / camera.width, view.depth[i]))
        .collect();
    (0..depths.len())
        .into_par_iter()
        .map(|i| sample(camera, &depths, i % camera.width, i / camera.width))
        .collect()
}

/// A depth, or that at which a ray comes to the sky if it is less.
fn limited(camera: &Pinhole, x: usize, y: usize, depth: f32) -> (f32, bool) {
    let ray = camera.rotation * camera.direction(x, y);
    let (a, b) = (ray.length_squared(), ray.dot(camera.centre));
    let c = camera.centre.length_squared() - SKY * SKY;
    let sky = ((b * b - a * c).max(0.0).sqrt() - b) / a;
    let near = depth.is_finite() && depth < sky;
    let depth = if near { depth } else { sky };
    (depth.max(1e-6), !near)
}

/// On a plane the inverse depth is affine in the image, so the plane is a least-squares fit.
fn sample(camera: &Pinhole, depths: &[(f32, bool)], x: usize, y: usize) -> Sample {
    let (depth, sky) = depths[y * camera.width + x];
    let with = |depth, normal| Sample { depth, normal, sky };
    let direction = camera.direction(x, y);
    if sky {
        return with(depth, -(camera.rotation * direction).normalize_or_zero());
    }
    let (mut products, mut right, mut count, mut all) = (Mat3::ZERO, Vec3::ZERO, 0.0, 0.0);
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let (u, v) = (x as i32 + dx, y as i32 + dy);
            if u < 0 || v < 0 || u >= camera.width as i32 || v >= camera.height as i32 {
                continue;
            }
            all += 1.0;
            let (other, far) = depths[v as usize * camera.width + u as usize];
            if far || (other - depth).abs() > 2.0 * tolerance(other.min(depth)) {
                continue;
            }
            let row = Vec3::new(dx as f32, dy as f32, 1.0);
            products += Mat3::from_cols(row * row.x, row * row.y, row);
            right += row * (depth / other);
            count += 1.0;
        }
    }
    // A row of pixels, or too few, have no plane.
    if count < LEAST_SHARE * all || products.determinant() < 1.0 {
        return with(depth, Vec3::ZERO);
    }
    let fit = products.inverse() * right / depth;
    if fit.z <= 0.0 {
        return with(depth, Vec3::ZERO);
    }
    let slope = fit.truncate() * camera.focal;
    let plane = slope.extend(fit.z - slope.dot(direction.truncate()));
    with(1.0 / fit.z, -(camera.rotation * plane).normalize_or_zero())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    fn camera() -> Pinhole {
        Pinhole {
            width: 9,
            height: 7,
            focal: Vec2::new(10.0, 11.0),
            principal: Vec2::new(4.0, 3.6),
            centre: Vec3::new(0.1, -0.2, 0.3),
            rotation: Mat3::from_rotation_y(0.4) * Mat3::from_rotation_x(-0.2),
        }
    }

    #[test]
    fn a_plane_has_its_own_normal_and_depths() {
        let camera = camera();
        // In camera space: normal · point = −1, in front of the camera and facing it.
        let normal = Vec3::new(0.3, -0.2, -1.0);
        let depth = |i: usize| -1.0 / normal.dot(camera.direction(i % 9, i / 9));
        let view = PosedView {
            camera,
            colours: vec![Vec3::ZERO; 63],
            depth: (0..63).map(depth).collect(),
        };
        for (i, sample) in samples(&view).iter().enumerate() {
            let wanted = camera.rotation * normal.normalize_or_zero();
            assert!((sample.normal - wanted).length() < 1e-3, "{sample:?}");
            assert!((sample.depth - depth(i)).abs() < 1e-4);
        }
    }

    #[test]
    fn what_is_infinitely_far_lies_on_the_sky() {
        let camera = camera();
        let view = PosedView {
            camera,
            colours: vec![Vec3::ZERO; 63],
            depth: vec![f32::INFINITY; 63],
        };
        for (i, sample) in samples(&view).iter().enumerate() {
            let point = camera.point(i % 9, i / 9, sample.depth);
            assert!(sample.sky && (point.length() - SKY).abs() < 1e-3);
        }
    }

    #[test]
    fn a_lonely_pixel_has_no_normal() {
        let camera = camera();
        let mut depth = vec![5.0; 63];
        depth[31] = 1.0;
        let view = PosedView {
            camera,
            colours: vec![Vec3::ZERO; 63],
            depth,
        };
        assert_eq!(samples(&view)[31].normal, Vec3::ZERO);
        assert_ne!(samples(&view)[32].normal, Vec3::ZERO);
    }
}
