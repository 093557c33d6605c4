//! A loop around what a capture shows, along where the photos were taken.

use std::f64::consts::{PI, TAU};

use glam::{DMat4, DVec3};

use super::camera_geometry::{CameraGeometry, largest_gap, pose_of};
use super::pinhole::median_lens;
use super::request::{PathError, check_fit};
use super::spiral::spiral;
use crate::camera::Camera;

/// Viewing directions this much alike (length of their mean; about 11° apart on average) show a
/// scene from one side: there is nothing to go around.
const ONE_SIDED: f64 = 0.98;

/// A part of the circle without photos, in radians, that the path does not cross.
const GAP: f64 = 0.5 * PI;

/// `frames` cameras on a closed loop fitted to `cameras`, with the median photo's field of view.
///
/// The path goes around the point that the cameras look at (or, for a capture that looks
/// outwards, around the point that they look away from). At each azimuth its radius, height and
/// pitch are smoothed means of those of the photos taken nearby, so that it stays where the scene
/// is known. A capture with more than 90° of azimuth missing is swung back and forth through,
/// without crossing the gap; one whose axes are nearly parallel gets a [`spiral`]. The last frame
/// is one step before the first, so that the film loops.
///
/// # Errors
/// No cameras, no frames or no pixels.
pub fn orbit(
    cameras: &[Camera],
    frames: usize,
    size: (u32, u32),
) -> Result<Vec<Camera>, PathError> {
    check_fit(cameras, frames, size)?;
    let geometry = CameraGeometry::of(cameras);
    if geometry.gaze.length() > ONE_SIDED || geometry.extent == 0.0 {
        return spiral(cameras, frames, size);
    }
    let ring = Ring::of(cameras, &geometry);
    let intrinsics = median_lens(cameras, size);
    let camera = |frame: usize| {
        let turn = TAU * frame as f64 / frames as f64;
        Camera {
            intrinsics,
            camera_to_world: ring.pose(ring.azimuth(turn)),
        }
    };
    Ok((0..frames).map(camera).collect())
}

/// A photo's place on the ring.
struct Station {
    azimuth: f64,
    radius: f64,
    height: f64,
    /// Angle of the viewing direction above the horizon.
    pitch: f64,
}

struct Ring {
    centre: DVec3,
    /// Directions of azimuth 0 and 90°, and up.
    axes: [DVec3; 3],
    stations: Vec<Station>,
    /// Where the largest gap between photos ends, and how wide it is.
    gap_end: f64,
    gap: f64,
    /// +1 when the cameras look towards the centre, −1 when away from it.
    inward: f64,
    /// Sharpness of the smoothing over azimuth.
    sharpness: f64,
}

impl Ring {
    fn of(cameras: &[Camera], geometry: &CameraGeometry) -> Self {
        let ahead = geometry.up.any_orthonormal_vector();
        let axes = [ahead, geometry.up.cross(ahead), geometry.up];
        let station = |camera: &Camera| {
            let arm = camera.centre() - geometry.target;
            let (a, b) = (arm.dot(axes[0]), arm.dot(axes[1]));
            Station {
                azimuth: b.atan2(a),
                radius: a.hypot(b),
                height: arm.dot(geometry.up),
                pitch: camera.forward().dot(geometry.up).clamp(-1.0, 1.0).asin(),
            }
        };
        let towards: f64 = cameras
            .iter()
            .map(|c| (geometry.target - c.centre()).dot(c.forward()).signum())
            .sum();
        let stations: Vec<Station> = cameras.iter().map(station).collect();
        let (gap_end, gap) = largest_gap(stations.iter().map(|s| s.azimuth));
        // Wide enough to bridge the gaps that are crossed, narrow enough to follow the walk.
        let width = if gap > GAP {
            0.25
        } else {
            (0.5 * gap).max(0.25)
        };
        Self {
            centre: geometry.target,
            axes,
            stations,
            gap_end,
            gap,
            inward: if towards < 0.0 { -1.0 } else { 1.0 },
            sharpness: 1.0 / (width * width),
        }
    }

    /// The azimuth at a part `turn` (0 to 2π) of the film.
    fn azimuth(&self, turn: f64) -> f64 {
        if self.gap <= GAP {
            return self.stations[0].azimuth + turn;
        }
        let arc = TAU - self.gap;
        self.gap_end + 0.5 * arc * (1.0 - turn.cos())
    }

    fn pose(&self, azimuth: f64) -> DMat4 {
        let [mut radius, mut height, mut pitch, mut total] = [0.0; 4];
        for s in &self.stations {
            // Never zero in sum: the nearest photo is at most half a gap away.
            let weight = (self.sharpness * ((azimuth - s.azimuth).cos() - 1.0)).exp();
            radius += weight * s.radius;
            height += weight * s.height;
            pitch += weight * s.pitch;
            total += weight;
        }
        let (radius, height, pitch) = (radius / total, height / total, pitch / total);
        let [a, b, up] = self.axes;
        let outward = a * azimuth.cos() + b * azimuth.sin();
        let heading = outward * -self.inward;
        let x = heading.cross(up);
        let z = heading * pitch.cos() + up * pitch.sin();
        let position = self.centre + outward * radius + up * height;
        pose_of(position, x, z)
    }
}
