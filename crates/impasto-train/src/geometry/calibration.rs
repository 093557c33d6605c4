//! What the file of a photo does not say: its exposure and white balance, and small errors of its
//! pose. Both are found by comparing some of its pixels with the field in training, photo by photo
//! in turn, and neither needs gradients of the field.

use crate::geometry::photos::PhotoRays;
use glam::DVec3;
use impasto_field::{RayBatch, RenderedRays};
use impasto_model::CameraRays;
use impasto_model::config::CalibrationConfig;
use impasto_scene::{AffineColors, Camera, ColorPairs};
use nalgebra::{Matrix6, Vector6};
use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// A pose moves only where that takes away more of the difference than this leaves: with poses that
/// are right, all that moves them is what the field has not learned yet.
const WORTH_MOVING: f64 = 0.97;
/// How many times as often photos are visited once one had to move.
const EAGERNESS: u64 = 4;
/// Pixels of a photo compared at each visit.
const PIXELS: usize = 256;
/// How much a change of colours counts beside a squared difference that it removes.
const COLOUR_PRIOR: f64 = 1e-3;
/// How much of what earlier visits saw of a photo's colours counts at the next: the field has moved
/// on since.
const MEMORY: f64 = 0.6;
/// Root mean square of changes of colours up to which they are noise.
const UNBELIEVED: f64 = 0.015;
/// Share of the training before which the field knows too little to judge photos by.
const FROM: f32 = 0.1;
/// A difference of colours from which on a pixel shows something else than the field knows.
const ODD: f64 = 0.1;
/// How far poses are thought to be off, in pixels.
const POSE_PRIOR: f64 = 2.0;
/// Farthest that a pose moves at one visit, in pixels.
const FARTHEST: f64 = 2.0;

/// Exposures and poses of the training photos in the making.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Calibration {
    config: CalibrationConfig,
    /// Colours of the field, then of the photo, at some of its pixels.
    colours: Vec<ColorPairs>,
    /// Cameras that have moved, by photo.
    cameras: Vec<Option<Camera>>,
    /// The photo to be visited next.
    next: usize,
    /// Whether the last one had to move.
    moved: bool,
}

/// A photo's change of colours, as far as it stands out: small ones are what the field has not
/// learned yet, and to follow them is to drift.
fn believed(pairs: &ColorPairs) -> AffineColors {
    let map = pairs.fit(COLOUR_PRIOR);
    let noise = UNBELIEVED / pairs.moved_by(&map).max(UNBELIEVED);
    map.weakened(1.0 - noise * noise)
}

/// Renders rays in the colours of the photos, by the field as it is.
pub(crate) type Render<'a> = &'a dyn Fn(&RayBatch) -> RenderedRays;

fn colours(seen: &RenderedRays) -> &[[f32; 3]] {
    seen.colours[0].as_chunks().0
}

impl Calibration {
    pub(crate) fn new(config: CalibrationConfig, photos: usize) -> Self {
        Self {
            config,
            colours: vec![ColorPairs::NONE; photos],
            cameras: vec![None; photos],
            next: 0,
            moved: false,
        }
    }

    /// Whether a photo is to be visited before a step, with `share` of the training over: more often
    /// while poses are found to be off. Turns pass while the field knows too little.
    pub(crate) fn takes_turn(&mut self, step: u64, share: f32) -> bool {
        let every = self.config.every;
        let every = if self.moved {
            every.div_ceil(EAGERNESS)
        } else {
            every
        };
        let due = step.is_multiple_of(every);
        if due && share < FROM {
            self.next += 1;
        }
        due && share >= FROM
    }

    /// Puts what is known into the photos.
    pub(crate) fn apply(&self, photos: &mut [PhotoRays]) {
        let maps: Vec<AffineColors> = self.colours.iter().map(believed).collect();
        // What all photos have in common is the place's.
        let common = AffineColors::median(&maps);
        for ((photo, map), camera) in photos.iter_mut().zip(&maps).zip(&self.cameras) {
            if self.config.exposures {
                let back = map.inverse().unwrap_or(AffineColors::IDENTITY);
                photo.colours = common.after(&back);
            }
            if let Some(camera) = camera {
                photo.look_from(*camera);
            }
        }
    }

    /// Compares the next photo with the field, of which `share` of the training is over.
    pub(crate) fn visit(
        &mut self,
        photos: &mut [PhotoRays],
        render: Render<'_>,
        share: f32,
        rng: &mut Pcg64,
    ) {
        let index = self.next % photos.len().max(1);
        self.next = index + 1;
        let Some(photo) = photos.get(index) else {
            return;
        };
        let moving = self.config.poses_from.is_some_and(|from| share >= from);
        let pixels = some_pixels(photo, rng);
        let now = render(&rays_of(photo, &[photo.camera], &pixels));
        if self.config.exposures {
            let pairs = &mut self.colours[index];
            pairs.fade(MEMORY);
            for (pixel, seen) in pixels.iter().zip(colours(&now)) {
                pairs.add(*seen, photo.colour(*pixel));
            }
        }
        self.moved = false;
        if moving {
            let found = Step::of(photo, &pixels, &now, render, rng);
            // Once found to be off, a pose follows the smallest gain.
            let enough = self.cameras[index].map_or(WORTH_MOVING, |_| 1.0);
            if found.left < enough {
                self.cameras[index] = Some(found.camera);
                self.moved = true;
            }
        }
        self.apply(photos);
    }

    /// The cameras as they are now, of those that have moved.
    pub(crate) fn cameras(&self) -> impl Iterator<Item = (usize, Camera)> {
        let all = self.cameras.iter().enumerate();
        all.filter_map(|(i, camera)| Some((i, (*camera)?)))
    }
}

fn some_pixels(photo: &PhotoRays, rng: &mut Pcg64) -> Vec<usize> {
    let mut pixel = || photo.used_pixel(rng.random_range(0..photo.used_count()));
    (0..PIXELS).map(|_| pixel()).collect()
}

/// Rays through pixels of a photo from some cameras of its lens, camera after camera.
fn rays_of(photo: &PhotoRays, cameras: &[Camera], pixels: &[usize]) -> RayBatch {
    let mut rays = RayBatch::default();
    for camera in cameras {
        let own = CameraRays::new(camera, Some((&photo.camera, &photo.rays)));
        pixels.iter().for_each(|pixel| own.push(*pixel, &mut rays));
    }
    rays
}

/// What the field shows, less what the photo does.
fn difference(photo: &PhotoRays, pixel: usize, seen: &[f32; 3]) -> [f64; 3] {
    let wanted = photo.colours.apply(photo.colour(pixel));
    [0, 1, 2].map(|c| f64::from(seen[c] - wanted[c]))
}

/// From 0, for none, towards 1: differences beyond [`ODD`] are of other things than poses (Geman and
/// McClure's measure).
fn oddness(difference: &[f64; 3]) -> f64 {
    let square: f64 = difference.iter().map(|d| d * d).sum();
    square / (square + ODD * ODD)
}

/// Median; 1 of nothing.
fn typical(depths: &[f32]) -> f64 {
    let mut depths = depths.to_vec();
    depths.sort_by(f32::total_cmp);
    depths.get(depths.len() / 2).map_or(1.0, |d| f64::from(*d))
}

/// One step of a photo towards the camera from where the field looks like it, if there is one.
pub(crate) fn align(photo: &mut PhotoRays, render: Render<'_>, rng: &mut Pcg64) {
    let pixels = some_pixels(photo, rng);
    let now = render(&rays_of(photo, &[photo.camera], &pixels));
    let found = Step::of(photo, &pixels, &now, render, rng);
    if found.left < 1.0 {
        photo.look_from(found.camera);
    }
}

/// A step of a camera.
struct Step {
    camera: Camera,
    /// What it leaves of the difference between other pixels and the field, 1 for all.
    left: f64,
}

impl Step {
    /// From where a photo is; `now` is how the pixels look from there.
    fn of(
        photo: &PhotoRays,
        pixels: &[usize],
        now: &RenderedRays,
        render: Render<'_>,
        rng: &mut Pcg64,
    ) -> Self {
        let camera = stepped(photo, pixels, now, render);
        let others = some_pixels(photo, rng);
        let seen = render(&rays_of(photo, &[photo.camera, camera], &others));
        let [before, after] = [0, 1].map(|view| {
            let own = colours(&seen).iter().skip(view * PIXELS);
            let pairs = others.iter().zip(own);
            let odd = pairs.map(|(i, seen)| oddness(&difference(photo, *i, seen)));
            odd.sum::<f64>()
        });
        Self {
            camera,
            left: after / before,
        }
    }
}

/// The camera after one Gauss–Newton step towards where the photo's pixels look like the field.
/// Its unit of every motion moves the picture by about a pixel.
fn stepped(photo: &PhotoRays, pixels: &[usize], now: &RenderedRays, render: Render<'_>) -> Camera {
    let unit = 1.0 / photo.camera.intrinsics.fl_x;
    let distance = typical(&now.depth);
    let moved = |motion: &Vector6<f64>| {
        let parts = |at: usize| DVec3::new(motion[at], motion[at + 1], motion[at + 2]) * unit;
        photo.camera.moved(parts(0), parts(3) * distance)
    };
    let axes: [Vector6<f64>; 6] =
        std::array::from_fn(|axis| Vector6::from_fn(|i, _| f64::from(u8::from(i == axis))));
    let beside = render(&rays_of(photo, &axes.map(|axis| moved(&axis)), pixels));
    let mut normal = Matrix6::zeros();
    let mut towards = Vector6::zeros();
    let mut squares = 0.0;
    for (n, (pixel, seen)) in pixels.iter().zip(colours(now)).enumerate() {
        let difference = difference(photo, *pixel, seen);
        let trust = (1.0 - oddness(&difference)).powi(2);
        for c in 0..3 {
            let slope = |axis: usize| colours(&beside)[axis * pixels.len() + n][c] - seen[c];
            let slope = Vector6::from_fn(|axis, _| f64::from(slope(axis)));
            normal += slope * slope.transpose() * trust;
            towards -= slope * (difference[c] * trust);
            squares += difference[c] * difference[c] * trust;
        }
    }
    let noise = squares / (3 * pixels.len()) as f64 + 1e-8;
    let damped = normal / noise + Matrix6::identity() / (POSE_PRIOR * POSE_PRIOR);
    let step = damped
        .cholesky()
        .map(|found| found.solve(&(towards / noise)));
    match step {
        Some(step) if step.iter().all(|x| x.is_finite()) => {
            moved(&(step * (FARTHEST / step.amax()).min(1.0)))
        }
        _ => photo.camera,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::photos::tests::sized_camera;
    use glam::DQuat;
    use rand::SeedableRng;

    /// A wall of soft colours, two in front of cameras that look along +z.
    fn wall(rays: &RayBatch) -> RenderedRays {
        let mut seen = RenderedRays {
            colours: vec![Vec::new()],
            depth: Vec::new(),
        };
        for (origin, direction) in rays.origins.iter().zip(&rays.directions) {
            let depth = (2.0 - origin[2]) / direction[2];
            let [x, y] = [0, 1].map(|i| origin[i] + depth * direction[i]);
            let colour = |k: f32| 0.5 + 0.2 * (k * x).sin() + 0.15 * (1.3 * k * y + k).cos();
            seen.colours[0].extend([colour(2.0), colour(3.0), colour(4.5)]);
            seen.depth.push(depth);
        }
        seen
    }

    /// A photo of the wall that was taken from `camera`, in changed colours.
    fn photo(camera: Camera, change: impl Fn(f32) -> f32) -> PhotoRays {
        let mut photo = PhotoRays::new(camera, Vec::new(), None, None);
        let seen = wall(&photo.rays.all());
        photo.pixels = seen.colours[0].iter().map(|c| change(*c)).collect();
        photo
    }

    fn camera(x: f64) -> Camera {
        Camera {
            intrinsics: impasto_scene::Intrinsics {
                fl_x: 60.0,
                fl_y: 60.0,
                ..sized_camera(DVec3::ZERO, 0.0, [64, 48]).intrinsics
            },
            ..sized_camera(DVec3::X * x, 0.0, [64, 48])
        }
    }

    const BOTH: CalibrationConfig = CalibrationConfig {
        every: 1,
        exposures: true,
        poses_from: Some(0.5),
    };

    #[test]
    fn a_dark_photo_is_brightened_and_the_others_stay() {
        // One by half a stop, one by next to nothing.
        let factors = [1.0, 0.7, 1.0, 0.99, 1.0];
        let mut photos: Vec<PhotoRays> = factors
            .iter()
            .enumerate()
            .map(|(i, factor)| photo(camera(0.1 * i as f64), |c| factor * c))
            .collect();
        let mut calibration = Calibration::new(BOTH, photos.len());
        let mut rng = Pcg64::seed_from_u64(1);
        for _ in 0..15 {
            calibration.visit(&mut photos, &wall, 0.2, &mut rng);
        }
        for (i, photo) in photos.iter().enumerate() {
            let wanted = wall(&photo.rays.all());
            let worst = colours(&wanted).iter().enumerate().map(|(pixel, wanted)| {
                let found = photo.colours.apply(photo.colour(pixel));
                (found[1] - wanted[1]).abs()
            });
            let worst = worst.fold(0.0, f32::max);
            assert!(worst < 0.02, "photo {i}: {worst}");
        }
        assert_eq!(photos[3].colours.apply([0.2, 0.5, 0.7]), [0.2, 0.5, 0.7]);
        assert_eq!(calibration.cameras().count(), 0, "too early for poses");
    }

    #[test]
    fn a_camera_that_is_off_finds_back() {
        let there = camera(0.0);
        let taken = photo(there, |c| c);
        // About a pixel and a half.
        let mut off = taken.clone();
        off.look_from(there.moved(DVec3::new(0.01, 0.02, 0.01), DVec3::new(0.03, 0.01, -0.04)));
        let mut photos = [off];
        let mut calibration = Calibration::new(BOTH, 1);
        let mut rng = Pcg64::seed_from_u64(2);
        let error = |camera: &Camera| {
            let turn = |camera: &Camera| DQuat::from_mat4(&camera.camera_to_world);
            let angle = turn(camera).angle_between(turn(&there));
            // What the picture shows of it: a turn and a shift can look nearly alike.
            let corner = DVec3::new(0.7, 0.5, 2.0);
            let shown = |camera: &Camera| camera.project(corner).unwrap_or_default().0;
            (angle, shown(camera).distance(shown(&there)))
        };
        let before = error(&photos[0].camera);
        for _ in 0..20 {
            calibration.visit(&mut photos, &wall, 0.9, &mut rng);
        }
        let after = error(&photos[0].camera);
        assert!(before.1 > 1.0 && after.1 < 0.1, "{before:?} → {after:?}");
        assert_eq!(calibration.cameras().count(), 1);
        // The same again, from what a checkpoint keeps.
        let kept = serde_json::to_string(&calibration).expect("plain numbers");
        let kept: Calibration = serde_json::from_str(&kept).expect("as written");
        let mut again = [taken];
        kept.apply(&mut again);
        assert_eq!(again[0].camera, photos[0].camera);
    }

    #[test]
    fn what_the_field_does_not_know_moves_nothing() {
        let mut photos = [photo(camera(0.0), |c| c)];
        let mut calibration = Calibration::new(BOTH, 1);
        let mut rng = Pcg64::seed_from_u64(3);
        let unknown = |rays: &RayBatch| RenderedRays {
            colours: vec![vec![f32::NAN; 3 * rays.len()]],
            depth: vec![f32::NAN; rays.len()],
        };
        for _ in 0..5 {
            calibration.visit(&mut photos, &unknown, 0.9, &mut rng);
        }
        assert_eq!(calibration.cameras().count(), 0);
        assert_eq!(photos[0].colours.apply([0.2, 0.4, 0.6]), [0.2, 0.4, 0.6]);
    }
}
