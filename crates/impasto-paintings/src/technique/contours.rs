//! Lines that follow the outlines of the sketch.

use super::studio::PaintingStudio;
use crate::canvas::Brush;
use crate::maths::mix;
use glam::{Vec2, Vec3};

/// How contour lines are drawn.
pub(super) struct Contour {
    /// Things smaller than this many marks across have no outline.
    pub least: f32,
    /// Length of one line, pixels.
    pub length: f32,
    /// Share of the lines that are drawn, `[0, 1]`.
    pub share: f32,
    /// The finest brush; `heaviest` is how many times wider the widest is.
    pub brush: Brush,
    pub heaviest: f32,
}

impl PaintingStudio {
    /// Draws lines along the outlines. Each line has one weight, most of them light.
    pub(super) fn draw_contours(&mut self, contour: &Contour, ink: Vec3) {
        for path in self.contour_paths(contour.least, contour.length) {
            if !self.dice.chance(contour.share) {
                continue;
            }
            let t = self.dice.unit();
            let width = contour.brush.width * mix(1.0, contour.heaviest, t * t);
            let brush = Brush {
                width,
                ..contour.brush
            };
            self.stroke(&path, &brush, ink);
        }
    }

    /// Lines of at most `length` pixels that together cover every outline about once.
    fn contour_paths(&self, least: f32, length: f32) -> Vec<Vec<Vec2>> {
        let distance = self.outlines(least);
        let gap = (2.5 * self.unit).max(1.5);
        let counts = self.size() / gap;
        let (columns, rows) = (counts.x as usize + 1, counts.y as usize + 1);
        let slot = |p: Vec2| {
            let x = ((p.x.max(0.0) / gap) as usize).min(columns - 1);
            let y = ((p.y.max(0.0) / gap) as usize).min(rows - 1);
            y * columns + x
        };
        let mut drawn = vec![false; columns * rows];
        let mut paths = Vec::new();
        for start in self.scatter(gap) {
            if distance[self.sketch.index(start)] > gap || drawn[slot(start)] {
                continue;
            }
            let (start, along) = self.onto_outline(start, &distance);
            let mut path = Vec::new();
            for sign in [-1.0, 1.0] {
                let half = self.follow(start, along * sign, length * 0.5, &distance, |p| {
                    drawn[slot(p)]
                });
                if sign < 0.0 {
                    path.extend(half.into_iter().rev());
                    path.push(start);
                } else {
                    path.extend(half);
                }
            }
            for p in &path {
                drawn[slot(*p)] = true;
            }
            if path.len() > 1 {
                paths.push(path);
            }
        }
        paths
    }

    fn follow(
        &self,
        start: Vec2,
        heading: Vec2,
        length: f32,
        distance: &[f32],
        taken: impl Fn(Vec2) -> bool,
    ) -> Vec<Vec2> {
        let step = (3.0 * self.unit).max(1.5);
        let count = ((length / step) as usize).clamp(1, 40);
        let (mut p, mut heading, mut path) = (start, heading, Vec::new());
        for _ in 0..count {
            let ahead = p + heading * step;
            let (next, along) = self.onto_outline(ahead, distance);
            let far = next.distance(ahead) > step || distance[self.sketch.index(next)] > step;
            if far || taken(next) {
                break;
            }
            let along = if along.dot(heading) < 0.0 {
                -along
            } else {
                along
            };
            // A sharp corner ends the line, as a hand would lift there.
            if along.dot(heading) < 0.2 {
                break;
            }
            heading = (heading + along).normalize_or(along);
            p = next;
            path.push(p);
        }
        path
    }

    /// The point of the outline near `p`, and the outline's direction there.
    fn onto_outline(&self, p: Vec2, distance: &[f32]) -> (Vec2, Vec2) {
        let at = |p: Vec2| distance[self.sketch.index(p)].min(1e3);
        let reach = (1.5 * self.unit).max(1.5);
        let slope = Vec2::new(
            at(p + Vec2::X * reach) - at(p - Vec2::X * reach),
            at(p + Vec2::Y * reach) - at(p - Vec2::Y * reach),
        );
        let fallback = self.along(p);
        let up = slope.normalize_or(fallback.perp());
        (p - up * (at(p) - 0.5).max(0.0) * 0.8, up.perp())
    }
}
