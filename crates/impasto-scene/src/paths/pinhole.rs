//! Ideal pinholes.

use crate::camera::{Camera, Distortion, Intrinsics};
use crate::statistics;

/// An ideal pinhole with square pixels whose picture of `size` pixels shows no more, across or
/// down, than the median photo did: rendering wider shows what was never photographed.
pub(super) fn median_lens(cameras: &[Camera], size: (u32, u32)) -> Intrinsics {
    let median = |of: fn(&Intrinsics) -> f64| {
        let values = cameras.iter().map(|c| of(&c.intrinsics));
        statistics::median(values).unwrap_or(1.0)
    };
    let across = median(|k| k.fl_x / f64::from(k.width)) * f64::from(size.0);
    let down = median(|k| k.fl_y / f64::from(k.height)) * f64::from(size.1);
    pinhole(across.max(down), size)
}

/// An ideal pinhole with a vertical field of view in degrees, between 0 and 180.
pub(crate) fn of_fov(fov: f64, size: (u32, u32)) -> Intrinsics {
    let focal = 0.5 * f64::from(size.1) / (0.5 * fov.to_radians()).tan();
    pinhole(focal, size)
}

/// An ideal pinhole with square pixels and its axis in the middle; `focal` is in pixels.
pub(crate) fn pinhole(focal: f64, size: (u32, u32)) -> Intrinsics {
    Intrinsics {
        width: size.0,
        height: size.1,
        fl_x: focal,
        fl_y: focal,
        cx: 0.5 * f64::from(size.0),
        cy: 0.5 * f64::from(size.1),
        distortion: Distortion::default(),
    }
}
