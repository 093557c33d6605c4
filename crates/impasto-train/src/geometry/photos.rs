//! Photos as rays and target colours.

use impasto_field::training::TargetRays;
use impasto_model::CameraRays;
use impasto_scene::{AffineColors, Camera, Photo};
use rand::RngExt;
use rand_pcg::Pcg64;

/// A photo ready for sampling.
#[derive(Debug, Clone)]
pub struct PhotoRays {
    /// Where they come from.
    pub camera: Camera,
    /// Its rays.
    pub rays: CameraRays,
    /// `height × width × 3` in `[0, 1]`.
    pub pixels: Vec<f32>,
    /// Indices of the pixels that show the place, in order, where not all do; at least one.
    pub used: Option<Vec<u32>>,
    /// What brings its colours to those of all photos together.
    pub colours: AffineColors,
}

impl PhotoRays {
    /// A photo in its own colours; `like` is another one, of the same lens perhaps.
    pub fn new(
        camera: Camera,
        pixels: Vec<f32>,
        used: Option<Vec<u32>>,
        like: Option<&Self>,
    ) -> Self {
        Self {
            rays: CameraRays::new(&camera, like.map(|like| (&like.camera, &like.rays))),
            camera,
            pixels,
            used,
            colours: AffineColors::IDENTITY,
        }
    }

    /// How many pixels show the place.
    pub fn used_count(&self) -> usize {
        self.used.as_ref().map_or(self.pixels.len() / 3, Vec::len)
    }

    /// Index of the `n`th of those pixels.
    pub fn used_pixel(&self, n: usize) -> usize {
        self.used.as_ref().map_or(n, |used| used[n] as usize)
    }

    /// Their colours.
    pub fn used_colours(&self) -> impl Iterator<Item = &[f32]> + Clone {
        (0..self.used_count()).map(|n| &self.pixels[3 * self.used_pixel(n)..][..3])
    }

    /// Colour of a pixel as the photo has it.
    pub(crate) fn colour(&self, pixel: usize) -> [f32; 3] {
        [0, 1, 2].map(|c| self.pixels[3 * pixel + c])
    }

    /// Moves the photo to another camera of its lens.
    pub(crate) fn look_from(&mut self, camera: Camera) {
        self.rays = CameraRays::new(&camera, Some((&self.camera, &self.rays)));
        self.camera = camera;
    }

    /// Adds the ray and colour of pixel `index` to `targets`.
    fn push(&self, index: usize, distance: Option<f32>, targets: &mut TargetRays) {
        self.rays.push(index, &mut targets.rays);
        targets
            .colours
            .extend(self.colours.apply(self.colour(index)));
        targets.distances.push(distance);
    }
}

/// Photos as floats, with their rays.
pub fn photo_rays<'a>(photos: impl Iterator<Item = &'a Photo>) -> Vec<PhotoRays> {
    let mut all: Vec<PhotoRays> = Vec::new();
    for photo in photos {
        let pixels = photo.pixels.as_raw().iter().map(|v| f32::from(*v) / 255.0);
        let used = photo.mask.as_ref().map(|mask| {
            let used = (0u32..).zip(mask).filter(|(_, used)| **used);
            used.map(|(pixel, _)| pixel).collect()
        });
        all.push(PhotoRays::new(
            photo.camera,
            pixels.collect(),
            used,
            all.first(),
        ));
    }
    all
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

/// Draws `count` uniform pixels, of those that show the place, of all photos, and `known` rays to
/// known surfaces.
pub fn draw(
    photos: &[PhotoRays],
    count: usize,
    surfaces: &[KnownSurface],
    known: usize,
    rng: &mut Pcg64,
) -> TargetRays {
    let mut targets = TargetRays::default();
    if !surfaces.is_empty() {
        for _ in 0..known {
            let surface = surfaces[rng.random_range(0..surfaces.len())];
            let distance = Some(surface.distance);
            photos[surface.photo].push(surface.pixel, distance, &mut targets);
        }
    }
    for _ in 0..count {
        let photo = &photos[rng.random_range(0..photos.len())];
        let pixel = photo.used_pixel(rng.random_range(0..photo.used_count()));
        photo.push(pixel, None, &mut targets);
    }
    targets
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::DVec3;
    use impasto_scene::{Distortion, Intrinsics};

    /// A camera that stands at `at`, turned by `yaw` from looking along +z.
    pub(crate) fn sized_camera(at: DVec3, yaw: f64, [width, height]: [u32; 2]) -> Camera {
        Camera {
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
        }
    }

    #[test]
    fn hidden_pixels_are_never_drawn_and_all_others_are() {
        use rand::SeedableRng;
        let photo = |used: Option<Vec<u32>>| {
            let pixels = (0..8 * 6 * 3).map(|i| (i / 3) as f32).collect();
            PhotoRays::new(sized_camera(DVec3::ZERO, 0.0, [8, 6]), pixels, used, None)
        };
        let shown: Vec<u32> = (0..48).filter(|i| i % 3 != 1).collect();
        let masked = [photo(Some(shown.clone())), photo(Some(vec![8]))];
        let mut rng = Pcg64::seed_from_u64(1);
        let drawn = draw(&masked, 2000, &[], 0, &mut rng);
        let mut pixels: Vec<u32> = drawn.colours.chunks(3).map(|c| c[0] as u32).collect();
        pixels.sort_unstable();
        pixels.dedup();
        assert_eq!(pixels, shown);
        // A mask that hides nothing changes nothing.
        let of = |used| draw(&[photo(used)], 99, &[], 0, &mut Pcg64::seed_from_u64(2)).colours;
        assert_eq!(of(None), of(Some((0..48).collect())));
    }
}
