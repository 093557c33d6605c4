//! Small functions built only from operations that IEEE 754 rounds exactly (no libm), so that a
//! recipe gives the same pixels on every platform. Angles are in turns (1 = full circle).

use glam::Vec2;
use std::f32::consts::PI;

/// Sine of an angle in turns; absolute error below 1e-5.
pub(crate) fn wave(turns: f32) -> f32 {
    let t = turns - turns.floor();
    // Fold to [-1/4, 1/4], where a short odd polynomial is accurate.
    let folded = if t > 0.75 {
        t - 1.0
    } else if t > 0.25 {
        0.5 - t
    } else {
        t
    };
    let x = folded * 2.0 * PI;
    let s = x * x;
    x * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0))))
}

/// Unit vector at an angle in turns (0 = +x, 1/4 = +y, which is down in pictures).
pub(crate) fn direction(turns: f32) -> Vec2 {
    Vec2::new(wave(turns + 0.25), wave(turns))
}

/// `v` turned by an angle in turns.
pub(crate) fn turned(v: Vec2, turns: f32) -> Vec2 {
    let d = direction(turns);
    Vec2::new(v.x * d.x - v.y * d.y, v.x * d.y + v.y * d.x)
}

/// Hermite step from 0 at `a` to 1 at `b`; `a > b` gives the falling step.
pub(crate) fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    if a == b {
        return if x < a { 0.0 } else { 1.0 };
    }
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Linear interpolation.
pub(crate) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Distance of the phase `x` from the nearest whole number, 0…½.
pub(crate) fn from_whole(x: f32) -> f32 {
    (x - x.round()).abs()
}

/// Signed distance to a closed polygon, negative inside. An empty polygon is infinitely far.
pub(crate) fn polygon_distance(points: &[Vec2], p: Vec2) -> f32 {
    let mut best = f32::INFINITY;
    let mut inside = false;
    let mut previous = points.len().wrapping_sub(1);
    for (i, &a) in points.iter().enumerate() {
        let b = points[previous];
        previous = i;
        let edge = b - a;
        let from = p - a;
        let t = (from.dot(edge) / edge.length_squared().max(1e-12)).clamp(0.0, 1.0);
        best = best.min((from - edge * t).length_squared());
        if (a.y > p.y) != (b.y > p.y) && from.x < edge.x * from.y / edge.y {
            inside = !inside;
        }
    }
    if inside { -best.sqrt() } else { best.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wave_follows_the_sine() {
        for i in -400..400 {
            let t = i as f32 * 0.01;
            let exact = (f64::from(t) * std::f64::consts::TAU).sin() as f32;
            assert!(
                (wave(t) - exact).abs() < 2e-5,
                "{t}: {} vs {exact}",
                wave(t)
            );
        }
    }

    #[test]
    fn polygon_distance_has_the_right_sign_and_size() {
        let square = [
            Vec2::new(0.0, 0.0),
            Vec2::new(2.0, 0.0),
            Vec2::new(2.0, 2.0),
            Vec2::new(0.0, 2.0),
        ];
        assert!((polygon_distance(&square, Vec2::ONE) + 1.0).abs() < 1e-6);
        assert!((polygon_distance(&square, Vec2::new(3.0, 1.0)) - 1.0).abs() < 1e-6);
        assert!(polygon_distance(&[], Vec2::ONE).is_infinite());
    }
}
