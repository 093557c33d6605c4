//! Lenses, and how cameras stand around what they look at.

use glam::{DMat3, DVec3};
use serde::Serialize;

use crate::camera::{Camera, Intrinsics};
use crate::paths::camera_geometry::{CameraGeometry, largest_gap};
use crate::scene::Scene;

/// Photos with one lens and size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LensUse {
    /// Image width, pixels.
    pub w: u32,
    /// Image height, pixels.
    pub h: u32,
    /// Horizontal field of view, degrees.
    pub fov_x: f64,
    /// Vertical field of view, degrees.
    pub fov_y: f64,
    /// Whether straight lines come out bent.
    pub distorted: bool,
    /// Photos taken with it.
    pub photos: usize,
}

/// How a capture was walked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CapturePattern {
    /// Cameras look at something from around it.
    Around,
    /// All cameras look about the same way.
    ForwardFacing,
    /// Cameras look outwards from where they stand.
    Outward,
    /// None of these: a walk through a place.
    WalkThrough,
}

/// Where cameras stand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraLayout {
    /// How the capture was walked.
    pub walk: CapturePattern,
    /// Size of the box around all cameras in the capture's units: across and along the mean
    /// viewing direction (or their widest spread), and up.
    pub extent: [f64; 3],
    /// Share of the cameras that look at one place, within 35°.
    pub convergence: f64,
    /// Degrees of azimuth around that place without a photo.
    pub largest_gap: f64,
}

/// A camera looks at something that is no farther from its axis: about half a field of view.
const LOOKS_AT: f64 = 35.0;
/// Share of the cameras that make a rule.
const MOST: f64 = 0.7;
/// Length of the mean viewing direction above which all look about the same way: an arc of 110°
/// has 0.85.
const ONE_WAY: f64 = 0.85;

/// The lenses, those with most photos first.
pub(super) fn lenses(scene: &Scene) -> Vec<LensUse> {
    let mut lenses: Vec<LensUse> = Vec::new();
    for photo in &scene.photos {
        let one = lens(&photo.camera);
        let same = |l: &&mut LensUse| {
            LensUse {
                photos: 1,
                ..(**l).clone()
            } == one
        };
        match lenses.iter_mut().find(same) {
            Some(known) => known.photos += 1,
            None => lenses.push(one),
        }
    }
    lenses.sort_by_key(|lens| std::cmp::Reverse(lens.photos));
    lenses
}

fn lens(camera: &Camera) -> LensUse {
    let k: &Intrinsics = &camera.intrinsics;
    let (w, h) = (f64::from(k.width), f64::from(k.height));
    let between = |a: (f64, f64), b: (f64, f64)| {
        let [a, b] = [a, b].map(|(x, y)| camera.ray(x, y).direction);
        // To a tenth, so that rounding in a file makes no second lens.
        (a.angle_between(b).to_degrees() * 10.0).round() / 10.0
    };
    LensUse {
        w: k.width,
        h: k.height,
        fov_x: between((0.0, k.cy), (w, k.cy)),
        fov_y: between((k.cx, 0.0), (k.cx, h)),
        distorted: !k.distortion.is_none(),
        photos: 1,
    }
}

/// Angle between a camera's axis and the way to a point, degrees; 0 for a camera at the point.
pub(super) fn off_axis(camera: &Camera, point: DVec3) -> f64 {
    let arm = point - camera.centre();
    if arm.length_squared() == 0.0 {
        return 0.0;
    }
    camera.forward().angle_between(arm).to_degrees()
}

pub(super) fn layout(scene: &Scene, cameras: &[Camera], geometry: &CameraGeometry) -> CameraLayout {
    let share = |holds: &dyn Fn(&Camera) -> bool| {
        cameras.iter().filter(|c| holds(c)).count() as f64 / cameras.len().max(1) as f64
    };
    let convergence = share(&|c| off_axis(c, geometry.target) < LOOKS_AT);
    let away = share(&|c| off_axis(c, geometry.target) > 180.0 - LOOKS_AT);
    let walk = if geometry.gaze.length() > ONE_WAY {
        CapturePattern::ForwardFacing
    } else if convergence >= MOST {
        CapturePattern::Around
    } else if away >= MOST {
        CapturePattern::Outward
    } else {
        CapturePattern::WalkThrough
    };
    let axes = geometry.axes(cameras);
    let centres = || cameras.iter().map(Camera::centre);
    let local = |v: DVec3| DMat3::from_cols(axes[0], axes[1], axes[2]).transpose() * v;
    let least = centres().map(local).fold(DVec3::INFINITY, DVec3::min);
    let most = centres().map(local).fold(DVec3::NEG_INFINITY, DVec3::max);
    let azimuth = |centre: DVec3| {
        let arm = local(centre - geometry.target);
        arm.y.atan2(arm.x)
    };
    CameraLayout {
        walk,
        extent: ((most - least) / scene.normalisation.scale).to_array(),
        convergence,
        largest_gap: largest_gap(centres().map(azimuth)).1.to_degrees(),
    }
}
