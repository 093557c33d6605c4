//! Where the pixels of one frame are in another, exactly: by depth and poses instead of by an
//! estimate (PAPER §10, with the model's own geometry).

use crate::grid::around;
use glam::{DVec2, DVec3};
use impasto_scene::Camera;

/// A frame's geometry.
#[derive(Debug, Clone, Copy)]
pub struct FrameGeometry<'a> {
    /// Its camera, in scene space.
    pub camera: &'a Camera,
    /// `height × width`, depth along the camera's axis in scene units; infinite where there is
    /// nothing.
    pub depth: &'a [f32],
}

/// For every pixel of one frame, how far away its content is in another, `[x, y]` in pixels;
/// `None` where that is behind the other camera or outside its image.
#[derive(Debug, Clone)]
pub struct Flow {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Row by row.
    pub vectors: Vec<Option<[f32; 2]>>,
}

/// How far a depth may be from the other frame's at the same place, relative to it.
const SAME_DEPTH: f64 = 0.02;
/// Depth that stands for infinity: parallax vanishes.
const FAR: f64 = 1e6;

impl Flow {
    /// From frame `from` to frame `to`, and which pixels' content is visible in the latter: its own
    /// depth there must agree with theirs.
    ///
    /// # Panics
    /// If a depth map does not have its camera's size.
    fn exact(from: &FrameGeometry<'_>, to: &FrameGeometry<'_>) -> (Self, Vec<bool>) {
        let k = &from.camera.intrinsics;
        let (width, height) = (k.width as usize, k.height as usize);
        assert_eq!(from.depth.len(), width * height, "depth of a frame");
        let places = (0..width * height).map(|i| {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let ray = from.camera.ray(pixel.x, pixel.y);
            // NaN would be far away.
            let depth = Some(from.depth[i]).filter(|depth| !depth.is_nan())?;
            let depth = f64::from(depth).min(FAR);
            motion(to, pixel, ray.origin + ray.direction * depth)
        });
        let places = places.map(|found| (found.map(|f| f.0), found.is_some_and(|f| f.1)));
        let (vectors, visible) = places.unzip();
        let flow = Self {
            width,
            height,
            vectors,
        };
        (flow, visible)
    }

    /// The vector at a place between pixel centres, bilinear; `None` if one of the four is.
    fn at(&self, x: f32, y: f32) -> Option<[f32; 2]> {
        let mut sum = [0.0; 2];
        for (index, weight) in corners(x, y, self.width, self.height)? {
            // A neighbour that has no share need not be known.
            if weight == 0.0 {
                continue;
            }
            let vector = self.vectors[index]?;
            (0..2).for_each(|c| sum[c] += weight * vector[c]);
        }
        Some(sum)
    }
}

/// Motion of a pixel whose content is at `world`, and whether the other frame shows it there;
/// `None` if that is behind the other camera or outside its image.
fn motion(to: &FrameGeometry<'_>, pixel: DVec2, world: DVec3) -> Option<([f32; 2], bool)> {
    let k = &to.camera.intrinsics;
    let (place, depth) = to.camera.project(world)?;
    let size = DVec2::new(k.width.into(), k.height.into());
    if !(place.cmpge(DVec2::ZERO).all() && place.cmplt(size).all()) {
        return None;
    }
    let motion = place - pixel;
    let index = place.y as usize * k.width as usize + place.x as usize;
    let there = f64::from(to.depth[index]).min(FAR);
    // Beyond the scene's far end, two large depths are the same sky.
    let agrees =
        (there - depth).abs() <= SAME_DEPTH * there.max(depth) || there.min(depth) >= FAR / 2.0;
    Some(([motion.x as f32, motion.y as f32], agrees))
}

/// The four pixels around a place (in pixels, centres at ½) and their bilinear weights.
fn corners(x: f32, y: f32, width: usize, height: usize) -> Option<[(usize, f32); 4]> {
    let (x, y) = (x - 0.5, y - 0.5);
    let inside = x > -0.5 && y > -0.5 && x < width as f32 - 0.5 && y < height as f32 - 0.5;
    if !inside {
        return None;
    }
    let ([upper_left, upper_right, lower_left, lower_right], [across, down]) =
        around(x, y, [width, height]);
    Some([
        (upper_left, (1.0 - across) * (1.0 - down)),
        (upper_right, across * (1.0 - down)),
        (lower_left, (1.0 - across) * down),
        (lower_right, across * down),
    ])
}

/// How two frames correspond: which pixels of the first can be compared, and with what place of
/// the second.
#[derive(Debug, Clone)]
pub struct Correspondence {
    /// From the first frame to the second.
    pub flow: Flow,
    /// Pixels of the first frame that count.
    pub mask: Vec<bool>,
}

impl Correspondence {
    /// By geometry: pixels count that the second frame sees at the same depth, that come back to
    /// where they were, and that are no motion boundary (PAPER §10).
    ///
    /// # Panics
    /// If a depth map does not have its camera's size.
    pub fn exact(first: &FrameGeometry<'_>, second: &FrameGeometry<'_>) -> Self {
        let (flow, visible) = Flow::exact(first, second);
        let (back, _) = Flow::exact(second, first);
        let mut this = Self::of_flows(flow, &back);
        for (mask, visible) in this.mask.iter_mut().zip(visible) {
            *mask &= visible;
        }
        this
    }

    /// By two flows alone, however they were found: forward–backward test and motion boundaries
    /// (Lai et al. 2018, after Ruder et al. 2016).
    pub fn of_flows(flow: Flow, back: &Flow) -> Self {
        let counts = |i: usize| {
            let forward = flow.vectors[i]?;
            let (x, y) = (i % flow.width, i / flow.width);
            let backward = back.at(x as f32 + 0.5 + forward[0], y as f32 + 0.5 + forward[1])?;
            let square = |v: [f32; 2]| v[0] * v[0] + v[1] * v[1];
            let round = [backward[0] + forward[0], backward[1] + forward[1]];
            let occluded = square(round) > 0.01 * (square(backward) + square(forward)) + 0.5;
            let boundary = gradient(&flow, x, y) > 0.01 * square(forward) + 0.002;
            Some(!occluded && !boundary)
        };
        let mask = (0..flow.vectors.len()).map(|i| counts(i).unwrap_or(false));
        Self {
            mask: mask.collect(),
            flow,
        }
    }

    /// Share of the first frame's pixels that count.
    pub fn coverage(&self) -> f64 {
        let count = self.mask.iter().filter(|m| **m).count();
        count as f64 / self.mask.len().max(1) as f64
    }

    /// The second frame as the first would see it, `height × width × 3`; zero where nothing
    /// corresponds.
    ///
    /// # Panics
    /// If the frames' sizes differ.
    pub fn warped(&self, second: &[f32]) -> Vec<f32> {
        let (width, height) = (self.flow.width, self.flow.height);
        assert_eq!(second.len(), width * height * 3, "a frame to warp");
        let pixels = self
            .flow
            .vectors
            .iter()
            .enumerate()
            .flat_map(|(i, vector)| {
                let mut colour = [0.0; 3];
                let place = vector.and_then(|[dx, dy]| {
                    let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                    corners(x + dx, y + dy, width, height)
                });
                for (index, weight) in place.into_iter().flatten() {
                    let from = &second[3 * index..][..3];
                    (0..3).for_each(|c| colour[c] += weight * from[c]);
                }
                colour
            });
        pixels.collect()
    }
}

/// `|∇u|² + |∇v|²` by forward differences; zero at the far borders and next to what has no flow.
fn gradient(flow: &Flow, x: usize, y: usize) -> f32 {
    let at = |x: usize, y: usize| flow.vectors[y * flow.width + x];
    let Some(here) = at(x, y) else {
        return 0.0;
    };
    let towards = |there: Option<[f32; 2]>| {
        there.map_or(0.0, |there| {
            (there[0] - here[0]).powi(2) + (there[1] - here[1]).powi(2)
        })
    };
    let right = (x + 1 < flow.width).then(|| at(x + 1, y)).flatten();
    let below = (y + 1 < flow.height).then(|| at(x, y + 1)).flatten();
    towards(right) + towards(below)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::DMat4;
    use impasto_scene::{Distortion, Intrinsics};

    /// A camera at `x` that looks along +z, 40×30 pixels.
    pub(crate) fn camera(x: f64) -> Camera {
        Camera {
            intrinsics: Intrinsics {
                width: 40,
                height: 30,
                fl_x: 40.0,
                fl_y: 40.0,
                cx: 20.0,
                cy: 15.0,
                distortion: Distortion::default(),
            },
            camera_to_world: DMat4::from_translation(DVec3::X * x),
        }
    }

    /// A wall of one depth, seen from two places `step` apart.
    fn wall(step: f64, depth: f32) -> Correspondence {
        let depth = [depth; 40 * 30];
        let cameras = [camera(0.0), camera(step)];
        let [first, second] = cameras.each_ref().map(|camera| FrameGeometry {
            camera,
            depth: &depth,
        });
        Correspondence::exact(&first, &second)
    }

    #[test]
    fn a_wall_moves_by_its_parallax() {
        let found = wall(0.1, 2.0);
        // 0.1 · 40 / 2 pixels to the left.
        for (i, vector) in found.flow.vectors.iter().enumerate() {
            match vector {
                Some([dx, dy]) => assert!((dx + 2.0).abs() < 1e-4 && dy.abs() < 1e-4),
                None => assert!(i % 40 < 2, "only what leaves the image has no flow"),
            }
            assert_eq!(found.mask[i], i % 40 >= 2);
        }
        assert!((found.coverage() - 38.0 / 40.0).abs() < 1e-9);
    }

    #[test]
    fn what_a_post_hides_does_not_count() {
        // A post of columns 18 to 21 at depth 1 before a wall at depth 4, seen from two places.
        let depth_from = |x: f64| -> Vec<f32> {
            let post = |column: usize| {
                let at = (column as f64 + 0.5 - 20.0) / 40.0 + x;
                (-0.05..0.05).contains(&at)
            };
            (0..40 * 30)
                .map(|i| if post(i % 40) { 1.0 } else { 4.0 })
                .collect()
        };
        let (first, second) = (camera(0.0), camera(0.2));
        let (near, far) = (depth_from(0.0), depth_from(0.2));
        let found = Correspondence::exact(
            &FrameGeometry {
                camera: &first,
                depth: &near,
            },
            &FrameGeometry {
                camera: &second,
                depth: &far,
            },
        );
        // The wall moves by 2 pixels, the post by 8, from 18..22 to 10..14: what was at 12..16 is
        // behind it now.
        let row = 15 * 40;
        let counts: Vec<bool> = (0..40).map(|x| found.mask[row + x]).collect();
        assert!((12..16).all(|x| !counts[x]), "{counts:?}");
        assert!(
            (5..10).all(|x| counts[x]) && (26..38).all(|x| counts[x]),
            "{counts:?}"
        );
    }

    #[test]
    fn warping_brings_the_other_frame_over() {
        let found = wall(0.05, 2.0);
        // A ramp, which linear interpolation reproduces: half of it moved by one pixel.
        let ramp = |shift: f32| -> Vec<f32> {
            (0..40 * 30 * 3)
                .map(|i| ((i / 3 % 40) as f32 + shift) / 50.0)
                .collect()
        };
        let warped = found.warped(&ramp(1.0));
        for (i, wanted) in ramp(0.0).iter().enumerate() {
            if found.mask[i / 3] {
                assert!((warped[i] - wanted).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn nothing_and_infinity_are_no_numbers_to_compare() {
        for value in [f32::NAN, f32::INFINITY, 0.0] {
            let found = wall(0.1, value);
            let sky = value.is_infinite();
            assert_eq!(found.coverage() > 0.5, sky, "depth {value}");
            assert!(found.warped(&[0.5; 3600]).iter().all(|v| v.is_finite()));
        }
    }
}
