//! A camera's rays.

use glam::{DMat3, DVec3, Mat3, Quat, Vec2, Vec3};
use impasto_field::RayBatch;
use impasto_scene::{Camera, Intrinsics};
use rayon::prelude::*;

/// One camera's rays, computed once: undistorting a lens costs far more than turning a vector.
#[derive(Debug, Clone)]
pub struct CameraRays {
    width: usize,
    height: usize,
    origin: [f32; 3],
    rotation: [[f32; 3]; 3],
    /// Width of the finest touch of a brush at distance 1.
    touch: f32,
    /// Camera-space x and y (z = 1) of each pixel centre.
    plane: std::sync::Arc<Vec<[f32; 2]>>,
}

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

/// Touches that a picture's shorter side is wide, as many as pixels of the squares that paintings are
/// looked at in: strokes keep their size in a picture, whatever its resolution.
const TOUCHES: f64 = 256.0;

fn touch(k: &Intrinsics) -> f32 {
    let side = f64::from(k.width.min(k.height));
    (side / (0.5 * (k.fl_x + k.fl_y)) / TOUCHES) as f32
}

impl CameraRays {
    /// Rays of `camera`, sharing the pixel table with `like` where both have the same lens.
    pub fn new(camera: &Camera, like: Option<(&Camera, &Self)>) -> Self {
        let k = &camera.intrinsics;
        let (width, height) = (k.width as usize, k.height as usize);
        let plane = match like {
            Some((other, rays)) if other.intrinsics == *k => std::sync::Arc::clone(&rays.plane),
            _ => {
                let identity = Camera {
                    camera_to_world: glam::DMat4::IDENTITY,
                    ..*camera
                };
                let table = (0..width * height)
                    .into_par_iter()
                    .map(|i| {
                        let ray = identity.ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                        [ray.direction.x as f32, ray.direction.y as f32]
                    })
                    .collect();
                std::sync::Arc::new(table)
            }
        };
        let rotation = DMat3::from_mat4(camera.camera_to_world);
        Self {
            width,
            height,
            origin: single(camera.centre()),
            touch: touch(k),
            rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(single),
            plane,
        }
    }

    /// Adds the ray through pixel `index` (row-major).
    pub fn push(&self, index: usize, batch: &mut RayBatch) {
        self.push_plane(self.plane[index], batch);
    }

    /// Adds the ray through a point of the image, `x` and `y` in pixels, linear between pixel
    /// centres; points nearer to the border than any centre go through the outermost centres.
    pub fn push_at(&self, [x, y]: [f32; 2], batch: &mut RayBatch) {
        let place = |at: f32, size: usize| {
            let at = (at - 0.5).clamp(0.0, (size - 1) as f32);
            let low = at as usize;
            (low, (low + 1).min(size - 1), at - low as f32)
        };
        let ((left, right, across), (top, bottom, down)) =
            (place(x, self.width), place(y, self.height));
        let corner = |row: usize, column: usize| Vec2::from(self.plane[row * self.width + column]);
        let upper = corner(top, left).lerp(corner(top, right), across);
        let lower = corner(bottom, left).lerp(corner(bottom, right), across);
        self.push_plane(upper.lerp(lower, down).to_array(), batch);
    }

    /// Index of the pixel that holds a point of the image, `x` and `y` in pixels.
    pub fn pixel_at(&self, [x, y]: [f32; 2]) -> usize {
        let place = |at: f32, size: usize| (at.max(0.0) as usize).min(size - 1);
        place(y, self.height) * self.width + place(x, self.width)
    }

    fn push_plane(&self, [x, y]: [f32; 2], batch: &mut RayBatch) {
        let [a, b, c] = self.rotation;
        let direction = [0, 1, 2].map(|i| x * a[i] + y * b[i] + c[i]);
        batch.push_painted(self.origin, direction, self.touch);
    }

    /// All rays of the image, row by row.
    pub fn all(&self) -> RayBatch {
        let mut batch = RayBatch::default();
        (0..self.plane.len()).for_each(|i| self.push(i, &mut batch));
        batch
    }

    /// The view `share` of the way to another camera, through this one's lens.
    pub fn towards(&self, other: &Self, share: f32) -> Self {
        let turn = |rays: &Self| {
            let [x, y, z] = rays.rotation.map(Vec3::from_array);
            Quat::from_mat3(&Mat3::from_cols(x, y, z))
        };
        let rotation = Mat3::from_quat(turn(self).slerp(turn(other), share));
        let origin = Vec3::from(self.origin).lerp(other.origin.into(), share);
        Self {
            origin: origin.to_array(),
            rotation: rotation.to_cols_array_2d(),
            ..self.clone()
        }
    }

    /// Cosine of the angle between two cameras' axes.
    pub fn alignment(&self, other: &Self) -> f32 {
        Vec3::from(self.rotation[2]).dot(other.rotation[2].into())
    }

    /// Distance between two cameras, scene units.
    pub fn distance(&self, other: &Self) -> f32 {
        Vec3::from(self.origin).distance(other.origin.into())
    }

    /// Image size: width, height.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use impasto_scene::{Distortion, Intrinsics};

    fn camera(at: DVec3, yaw: f64) -> CameraRays {
        sized_camera(at, yaw, [8, 6])
    }

    /// Rays of a camera that stands at `at`, turned by `yaw` from looking along +z.
    fn sized_camera(at: DVec3, yaw: f64, [width, height]: [u32; 2]) -> CameraRays {
        let camera = Camera {
            camera_to_world: glam::DMat4::from_rotation_translation(
                glam::DQuat::from_rotation_y(yaw),
                at,
            ),
            intrinsics: Intrinsics {
                width,
                height,
                fl_x: 10.0,
                fl_y: 10.0,
                cx: f64::from(width) / 2.0,
                cy: f64::from(height) / 2.0,
                distortion: Distortion::default(),
            },
        };
        CameraRays::new(&camera, None)
    }

    #[test]
    fn a_view_between_two_cameras_stands_and_looks_between_them() {
        let (one, other) = (camera(DVec3::ZERO, 0.0), camera(DVec3::X, 1.0));
        let wanted = camera(DVec3::X * 0.25, 0.25).all();
        let found = one.towards(&other, 0.25).all();
        let pairs = |a: &[[f32; 3]], b: &[[f32; 3]]| {
            a.iter()
                .zip(b)
                .all(|(a, b)| Vec3::from(*a).distance(Vec3::from(*b)) < 1e-5)
        };
        assert!(pairs(&found.origins, &wanted.origins));
        assert!(pairs(&found.directions, &wanted.directions));
        assert_eq!(one.distance(&other), 1.0);
        assert!((one.alignment(&other) - 1f32.cos()).abs() < 1e-5);
    }

    #[test]
    fn a_touch_is_as_wide_in_a_picture_of_any_resolution() {
        let lens = |width: u32, fl: f64| Intrinsics {
            width,
            height: width / 2,
            fl_x: fl,
            fl_y: fl,
            cx: 0.0,
            cy: 0.0,
            distortion: Distortion::default(),
        };
        assert!((touch(&lens(1024, 512.0)) - 1.0 / 256.0).abs() < 1e-7);
        assert_eq!(touch(&lens(1024, 512.0)), touch(&lens(256, 128.0)));
        assert_eq!(touch(&lens(1024, 1024.0)) * 2.0, touch(&lens(1024, 512.0)));
    }

    #[test]
    fn rays_between_pixel_centres_are_linear() {
        let rays = camera(DVec3::ZERO, 0.3);
        let all = rays.all().directions;
        let mut found = RayBatch::default();
        for point in [[2.5, 1.5], [3.0, 1.5], [0.0, 0.0], [8.0, 6.0]] {
            rays.push_at(point, &mut found);
        }
        let near = |a: [f32; 3], b: Vec3| assert!(Vec3::from(a).distance(b) < 1e-6, "{a:?} {b:?}");
        let direction = |i: usize| Vec3::from(all[i]);
        near(found.directions[0], direction(8 + 2));
        near(
            found.directions[1],
            (direction(8 + 2) + direction(8 + 3)) / 2.0,
        );
        near(found.directions[2], direction(0));
        near(found.directions[3], direction(47));
    }
}
