//! A capture at a glance: its cameras and sparse points from above and from a side.

mod raster;

use glam::{DVec2, DVec3};
use image::RgbImage;

use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::scene::{Scene, SparsePoint, Split};
use crate::statistics::median;
use raster::{ClipBox, Ink, Raster};

/// Size of a picture: two square panels side by side.
const SIZE: [u32; 2] = [1200, 600];
const PANEL: f64 = 600.0;
/// Room between a panel's edge and what is shown in it, in pixels.
const MARGIN: f64 = 24.0;

const GROUND: [u8; 3] = [250, 249, 246];
const RULE: [u8; 3] = [150, 150, 155];
const TRAIN: [u8; 3] = [24, 92, 200];
const TEST: [u8; 3] = [226, 72, 12];

/// Points farther out than this share of all along an axis do not widen the picture.
const OUTLIERS: f64 = 0.04;
/// Nor do points beyond this many scene units: the cameras, which reach to 1/1.1, stay readable.
const FARTHEST: f64 = 1.7;

/// The capture from above (left) and from a side at the same scale (right), 1200 × 600.
///
/// Cameras to learn from are blue wedges that open where they look, held-out ones orange. Sparse
/// points have their own colours; those far from all others may lie outside. The grey circle is
/// the unit ball, the cross is what the cameras look at. Both panels have the same horizontal
/// axis: across the viewing direction where the cameras share one, else along their widest spread.
pub fn picture(scene: &Scene) -> RgbImage {
    let mut raster = Raster::new(SIZE, GROUND);
    let cameras: Vec<Camera> = scene.photos.iter().map(|photo| photo.camera).collect();
    if cameras.is_empty() {
        return raster.picture();
    }
    let geometry = CameraGeometry::of(&cameras);
    let [across, away, up] = geometry.axes(&cameras);
    let bounds = Bounds::of(scene, &geometry, [across, away, up]);
    let reach = wedge_length(&cameras, bounds.half);
    for (left, [right, above, towards]) in [(0.0, [across, away, up]), (PANEL, [across, up, -away])]
    {
        let panel = Panel {
            right,
            above,
            towards,
            centre: bounds.centre,
            origin: DVec2::new(left + 0.5 * PANEL, 0.5 * PANEL),
            scale: (0.5 * PANEL - MARGIN) / bounds.half,
            clip: ClipBox {
                from: DVec2::new(left, 0.0),
                to: DVec2::new(left + PANEL, PANEL),
            },
        };
        panel.draw(&mut raster, scene, geometry.target, reach);
    }
    let divider = [DVec2::new(PANEL, 0.0), DVec2::new(PANEL, PANEL)];
    let whole = ClipBox {
        from: DVec2::ZERO,
        to: DVec2::new(2.0 * PANEL, PANEL),
    };
    raster.line(&whole, divider, 1.0, solid(RULE));
    raster.picture()
}

fn solid(colour: [u8; 3]) -> Ink {
    Ink {
        colour,
        opacity: 1.0,
    }
}

/// What the panels show: a box around the cameras and most points.
struct Bounds {
    centre: DVec3,
    /// Half of the box's longest side.
    half: f64,
}

impl Bounds {
    fn of(scene: &Scene, geometry: &CameraGeometry, axes: [DVec3; 3]) -> Self {
        let mut centre = DVec3::ZERO;
        let mut half: f64 = 1e-6;
        for axis in axes {
            let cameras = scene.photos.iter().map(|p| p.camera.centre().dot(axis));
            let target = geometry.target.dot(axis).clamp(-FARTHEST, FARTHEST);
            let (mut least, mut most) = (target, target);
            for camera in cameras {
                (least, most) = (least.min(camera), most.max(camera));
            }
            let mut points: Vec<f64> = scene.points.iter().map(|p| p.position.dot(axis)).collect();
            points.sort_by(f64::total_cmp);
            let cut = (points.len() as f64 * OUTLIERS) as usize;
            if let [first, .., last] = points[cut..points.len() - cut] {
                least = least.min(first.max(-FARTHEST));
                most = most.max(last.min(FARTHEST));
            }
            centre += axis * (0.5 * (least + most));
            half = half.max(0.5 * (most - least));
        }
        Self { centre, half }
    }
}

/// How long wedges are: about as far as the next camera, and always to be seen.
fn wedge_length(cameras: &[Camera], half: f64) -> f64 {
    let nearest = cameras.iter().enumerate().map(|(i, camera)| {
        let others = cameras.iter().enumerate().filter(|(j, _)| *j != i);
        let distances = others.map(|(_, other)| other.centre().distance(camera.centre()));
        distances.fold(f64::INFINITY, f64::min)
    });
    let usual = median(nearest).unwrap_or(half);
    usual.clamp(0.06 * half, 0.16 * half)
}

/// One orthographic view.
struct Panel {
    right: DVec3,
    above: DVec3,
    /// Towards the viewer: what is farther along it covers the rest.
    towards: DVec3,
    centre: DVec3,
    /// Where `centre` is on the picture.
    origin: DVec2,
    /// Pixels per scene unit.
    scale: f64,
    clip: ClipBox,
}

impl Panel {
    fn place(&self, point: DVec3) -> DVec2 {
        let arm = (point - self.centre) * self.scale;
        self.origin + DVec2::new(arm.dot(self.right), -arm.dot(self.above))
    }

    fn draw(&self, raster: &mut Raster, scene: &Scene, target: DVec3, reach: f64) {
        let ball = self.place(DVec3::ZERO);
        raster.circle(&self.clip, ball, self.scale, solid(RULE));
        self.points(raster, &scene.points);
        // Held-out cameras are few: they lie over the others.
        for split in [Split::Train, Split::Test] {
            for photo in scene.photos.iter().filter(|p| p.split == split) {
                let colour = match split {
                    Split::Train => TRAIN,
                    Split::Test => TEST,
                };
                self.wedge(raster, &photo.camera, reach, colour);
            }
        }
        let cross = self.place(target);
        for arm in [DVec2::X * 7.0, DVec2::Y * 7.0] {
            let ends = [cross - arm, cross + arm];
            raster.line(&self.clip, ends, 4.0, solid(GROUND));
            raster.line(&self.clip, ends, 1.5, solid([0; 3]));
        }
    }

    fn points(&self, raster: &mut Raster, points: &[SparsePoint]) {
        let mut order: Vec<(f64, usize)> = points
            .iter()
            .enumerate()
            .map(|(i, point)| (point.position.dot(self.towards), i))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // Many points are drawn small, few large enough to be seen.
        let radius = (60.0 / (points.len() as f64 + 1.0).sqrt()).clamp(0.9, 2.0);
        for (_, index) in order {
            let point = &points[index];
            let at = self.place(point.position);
            raster.disc(&self.clip, at, radius, solid(point.colour));
        }
    }

    /// A camera as the pyramid that it sees.
    fn wedge(&self, raster: &mut Raster, camera: &Camera, reach: f64, colour: [u8; 3]) {
        let k = &camera.intrinsics;
        let (width, height) = (f64::from(k.width), f64::from(k.height));
        let tip = self.place(camera.centre());
        let corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)].map(|(x, y)| {
            let ray = camera.ray(x, y);
            self.place(ray.origin + ray.direction * reach)
        });
        // Wedges that stand in a row, seen from its end, must not hide what is behind them.
        let ink = |opacity| Ink { colour, opacity };
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            raster.triangle(&self.clip, [tip, a, b], ink(0.12));
            raster.line(&self.clip, [tip, a], 1.0, ink(0.7));
            raster.line(&self.clip, [a, b], 1.0, ink(0.7));
        }
        raster.disc(&self.clip, tip, 2.5, solid(colour));
    }
}
