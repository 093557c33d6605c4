//! Photos as rays and target colours.

use glam::{DMat3, DVec3};
use impasto_field::RayBatch;
use impasto_scene::{Camera, Photo};
use rand::RngExt;
use rand_pcg::Pcg64;

/// One camera's rays, computed once: undistorting a lens costs far more than turning a vector.
#[derive(Debug, Clone)]
pub struct CameraRays {
    width: usize,
    height: usize,
    origin: [f32; 3],
    rotation: [[f32; 3]; 3],
    /// Camera-space x and y (z = 1) of each pixel centre.
    plane: std::sync::Arc<Vec<[f32; 2]>>,
}

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
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
            rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(single),
            plane,
        }
    }

    /// Adds the ray through pixel `index` (row-major).
    pub fn push(&self, index: usize, batch: &mut RayBatch) {
        let [x, y] = self.plane[index];
        let [a, b, c] = self.rotation;
        batch.push(self.origin, [0, 1, 2].map(|i| x * a[i] + y * b[i] + c[i]));
    }

    /// All rays of the image, row by row.
    pub fn all(&self) -> RayBatch {
        let mut batch = RayBatch::default();
        (0..self.plane.len()).for_each(|i| self.push(i, &mut batch));
        batch
    }

    /// Image size: width, height.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }
}

/// A photo ready for sampling.
#[derive(Debug, Clone)]
pub struct PhotoRays {
    /// Its rays.
    pub rays: CameraRays,
    /// `height × width × 3` in `[0, 1]`.
    pub pixels: Vec<f32>,
}

/// Photos as floats, with their rays.
pub fn photo_rays<'a>(photos: impl Iterator<Item = &'a Photo>) -> Vec<PhotoRays> {
    let mut all: Vec<PhotoRays> = Vec::new();
    let mut first: Option<Camera> = None;
    for photo in photos {
        let like = first
            .as_ref()
            .zip(all.first())
            .map(|(camera, photo)| (camera, &photo.rays));
        let rays = CameraRays::new(&photo.camera, like);
        first.get_or_insert(photo.camera);
        all.push(PhotoRays {
            rays,
            pixels: photo
                .pixels
                .as_raw()
                .iter()
                .map(|v| f32::from(*v) / 255.0)
                .collect(),
        });
    }
    all
}

/// A batch of rays with the colours seen along them.
#[derive(Debug, Clone, Default)]
pub struct Targets {
    /// Rays.
    pub rays: RayBatch,
    /// `n × 3`.
    pub colours: Vec<f32>,
    /// Distance (scene units along the ray) of a known surface, for rays that have one.
    pub distances: Vec<Option<f32>>,
}

impl Targets {
    /// Adds pixel `index` of `photo`.
    pub fn push(&mut self, photo: &PhotoRays, index: usize, distance: Option<f32>) {
        photo.rays.push(index, &mut self.rays);
        self.colours.extend(&photo.pixels[index * 3..index * 3 + 3]);
        self.distances.push(distance);
    }
}

/// A sparse point as one photo sees it.
#[derive(Debug, Clone, Copy)]
pub struct KnownSurface {
    /// Index into the training photos.
    pub photo: usize,
    /// Pixel, row-major.
    pub pixel: usize,
    /// Distance from the camera, scene units.
    pub distance: f32,
}

/// Draws `count` uniform pixels of all photos, and `known` rays to known surfaces.
pub fn draw(
    photos: &[PhotoRays],
    surfaces: &[KnownSurface],
    (count, known): (usize, usize),
    rng: &mut Pcg64,
) -> Targets {
    let mut targets = Targets::default();
    if !surfaces.is_empty() {
        for _ in 0..known {
            let surface = surfaces[rng.random_range(0..surfaces.len())];
            targets.push(
                &photos[surface.photo],
                surface.pixel,
                Some(surface.distance),
            );
        }
    }
    for _ in 0..count {
        let photo = &photos[rng.random_range(0..photos.len())];
        let pixel = rng.random_range(0..photo.pixels.len() / 3);
        targets.push(photo, pixel, None);
    }
    targets
}
