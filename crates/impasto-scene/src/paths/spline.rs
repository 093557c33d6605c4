//! A smooth curve through cameras.

use glam::{DMat4, DQuat, DVec3, DVec4};

use super::pinhole::pinhole;
use crate::camera::{Camera, Intrinsics};

/// Scene units that turning by a radian, or zooming by a factor of e, counts for in a path's length:
/// what is about that far away moves about as much in the picture as by moving sideways.
const TURN: f64 = 0.5;
/// The least part of the mean span of time that one between two keys is, however close they are.
const LEAST_SPAN: f64 = 1e-3;
/// Pieces of the curve between two keys whose lengths are added up.
const PIECES: usize = 64;

/// A Catmull-Rom spline through positions, rotations and logarithms of focal lengths.
pub(super) struct Spline<'a> {
    keys: &'a [Camera],
    /// Rotations with signs chosen so that neighbours are close.
    rotations: Vec<DVec4>,
    /// How far the curve takes each step from key to key to be.
    spans: Vec<f64>,
    closed: bool,
}

impl<'a> Spline<'a> {
    /// Through at least one key; a closed one goes on from the last to the first. All steps from key
    /// to key are taken to be equally far.
    pub(super) fn through(keys: &'a [Camera], closed: bool) -> Self {
        let mut rotations: Vec<DVec4> = Vec::with_capacity(keys.len());
        for key in keys {
            let rotation = DVec4::from(DQuat::from_mat4(&key.camera_to_world));
            let flip = rotations
                .last()
                .is_some_and(|last| last.dot(rotation) < 0.0);
            rotations.push(if flip { -rotation } else { rotation });
        }
        Self {
            keys,
            rotations,
            spans: vec![1.0; steps(keys.len(), closed)],
            closed,
        }
    }

    /// The same for keys whose distances differ: spans are square roots of them (a centripetal
    /// spline), which keeps the curve from going back and forth between close ones.
    pub(super) fn centripetal(keys: &'a [Camera], closed: bool) -> Self {
        let mut spline = Self::through(keys, closed);
        let next = |i: usize| &keys[(i + 1) % keys.len()];
        let distances = (0..spline.spans.len()).map(|i| apart(&keys[i], next(i)));
        let spans: Vec<f64> = distances.map(f64::sqrt).collect();
        let mean = spans.iter().sum::<f64>() / spans.len().max(1) as f64;
        if mean > 0.0 {
            let least = LEAST_SPAN * mean;
            spline.spans = spans.into_iter().map(|span| span.max(least)).collect();
        }
        spline
    }

    /// `frames` cameras, equally far apart in time: the first is the first key; the last is the last
    /// key or, on a closed path, one step before the first.
    pub(super) fn cameras(&self, frames: usize) -> Vec<Camera> {
        let (steps, parts) = (self.spans.len(), self.parts(frames));
        let time = |frame: usize| steps as f64 * frame as f64 / parts as f64;
        (0..frames).map(|frame| self.at(time(frame))).collect()
    }

    /// The same, equally far apart along the curve: neither faster nor slower anywhere. Where the
    /// camera does not move at all, time decides.
    pub(super) fn even_cameras(&self, frames: usize) -> Vec<Camera> {
        let way = self.way();
        let length = way.last().copied().unwrap_or(0.0);
        if length <= 0.0 {
            return self.cameras(frames);
        }
        let parts = self.parts(frames);
        let time = |frame: usize| {
            let gone = length * frame as f64 / parts as f64;
            // The piece in which that much of the way is gone, and the share of it.
            let next = way.partition_point(|&at| at < gone).clamp(1, way.len() - 1);
            let (from, to) = (way[next - 1], way[next]);
            let share = if to > from {
                (gone - from) / (to - from)
            } else {
                0.0
            };
            ((next - 1) as f64 + share.clamp(0.0, 1.0)) / PIECES as f64
        };
        (0..frames).map(|frame| self.at(time(frame))).collect()
    }

    /// How far it is along the curve to the end of each piece, from 0.
    fn way(&self) -> Vec<f64> {
        let ends = 0..=self.spans.len() * PIECES;
        let mut last: Option<Camera> = None;
        let mut gone = 0.0;
        ends.map(|end| {
            let here = self.at(end as f64 / PIECES as f64);
            gone += last.replace(here).map_or(0.0, |last| apart(&last, &here));
            gone
        })
        .collect()
    }

    /// Number of steps from frame to frame that make the whole path.
    fn parts(&self, frames: usize) -> usize {
        if self.closed {
            frames
        } else {
            frames.saturating_sub(1).max(1)
        }
    }

    /// The camera at a time, which is `i` at key `i`.
    fn at(&self, time: f64) -> Camera {
        let segment = (time.floor() as usize).min(self.spans.len().saturating_sub(1));
        let part = time - segment as f64;
        let around: [usize; 4] =
            std::array::from_fn(|i| self.neighbour(self.keys.len(), segment, i));

        let centres = around.map(|i| self.keys[i].centre());
        let mut rotations = around.map(|i| self.rotations[i]);
        // A closed path may come back with the other sign.
        for i in 1..4 {
            if rotations[i].dot(rotations[i - 1]) < 0.0 {
                rotations[i] = -rotations[i];
            }
        }
        let weights = match self.spans.get(segment) {
            Some(&span) => {
                // Beyond an open end the last span is repeated.
                let span_at = |i: usize| self.spans[self.neighbour(self.spans.len(), segment, i)];
                catmull_rom([span_at(0), span, span_at(2)], part)
            }
            None => catmull_rom([1.0; 3], part),
        };
        let position: DVec3 = (0..4).map(|i| centres[i] * weights[i]).sum();
        let rotation: DVec4 = (0..4).map(|i| rotations[i] * weights[i]).sum();
        let rotation = rotation.try_normalize().unwrap_or(rotations[1]);
        let first = &self.keys[around[1]].intrinsics;
        let blend = |of: fn(&Intrinsics) -> f64| -> f64 {
            (0..4)
                .map(|i| of(&self.keys[around[i]].intrinsics) * weights[i])
                .sum()
        };
        let (fl_x, fl_y) = (blend(|k| k.fl_x.ln()).exp(), blend(|k| k.fl_y.ln()).exp());
        let size = self.keys[0].intrinsics.size();
        Camera {
            intrinsics: Intrinsics {
                fl_x,
                fl_y,
                ..pinhole(first.fl_x, size)
            },
            camera_to_world: DMat4::from_rotation_translation(DQuat::from_vec4(rotation), position),
        }
    }

    /// Which of `count` keys or steps is at place `i` of those around `segment`, which itself is at
    /// place 1; ends are repeated on an open path.
    fn neighbour(&self, count: usize, segment: usize, i: usize) -> usize {
        if self.closed {
            (segment + count + i - 1) % count
        } else {
            (segment + i).saturating_sub(1).min(count - 1)
        }
    }
}

/// Number of steps from key to key.
fn steps(keys: usize, closed: bool) -> usize {
    if closed { keys } else { keys - 1 }
}

/// How far it is from one camera to another close by, in scene units.
fn apart(a: &Camera, b: &Camera) -> f64 {
    let moved = a.centre().distance(b.centre());
    let rotation = |camera: &Camera| DQuat::from_mat4(&camera.camera_to_world);
    let turned = rotation(a).angle_between(rotation(b));
    let zoomed = (b.intrinsics.fl_y / a.intrinsics.fl_y).ln();
    DVec3::new(moved, TURN * turned, TURN * zoomed).length()
}

/// Weights of four values, so far apart from one to the next, at `t` of the way from the second to
/// the third.
fn catmull_rom([before, span, after]: [f64; 3], t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    // Hermite's polynomials, of the slopes at both ends and of the way between them.
    let (first, last, way) = (t3 - 2.0 * t2 + t, t3 - t2, 3.0 * t2 - 2.0 * t3);
    // Each slope is that of a parabola through three values.
    let (a, b) = (span / before, span / (before + span));
    let (c, d) = (span / (span + after), span / after);
    [
        first * (b - a),
        1.0 - way + first * (a - 1.0) + last * (c - 1.0),
        way + first * (1.0 - b) + last * (1.0 - d),
        last * (d - c),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_reproduce_parabolas_wherever_the_values_are() {
        for spans in [[1.0, 1.0, 1.0], [0.3, 1.0, 2.0], [5.0, 0.1, 0.4]] {
            let [before, span, after] = spans;
            let at = [-before, 0.0, span, span + after];
            for t in [0.0, 0.2, 0.5, 1.0] {
                let weights = catmull_rom(spans, t);
                let sum =
                    |of: fn(f64) -> f64| -> f64 { (0..4).map(|i| weights[i] * of(at[i])).sum() };
                assert!((sum(|_| 1.0) - 1.0).abs() < 1e-12);
                assert!((sum(|x| x) - t * span).abs() < 1e-12);
                assert!((sum(|x| x * x) - (t * span).powi(2)).abs() < 1e-12);
            }
        }
    }
}
