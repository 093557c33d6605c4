//! The software canvas: float RGB with a height field, anti-aliased marks, relief lighting.

use crate::maths::{polygon_distance, smoothstep};
use crate::noise::noise;
use glam::{Vec2, Vec3};
use image::RgbImage;

/// A picture in progress. Points are in pixels; the centre of pixel (x, y) is (x + ½, y + ½).
pub(crate) struct Canvas {
    pub width: usize,
    pub height: usize,
    /// Row-major colours.
    pub colour: Vec<Vec3>,
    /// Row-major thickness of the paint, in pixels.
    pub thickness: Vec<f32>,
}

/// How a brush lays paint.
#[derive(Clone, Copy)]
pub(crate) struct Brush {
    /// Full width, pixels.
    pub width: f32,
    /// Opacity of a full load, `[0, 1]`.
    pub opacity: f32,
    /// Strength of the streaks that bristles leave in colour, `[0, 1]`.
    pub bristle: f32,
    /// How much of the paper's tooth shows through, `[0, 1]` (chalk, dry brush).
    pub grain: f32,
    /// Paint thickness as a share of the width.
    pub relief: f32,
    /// How much the stroke narrows towards its end, `[0, 1]`.
    pub taper: f32,
    /// Square ends (knife, flat brush) instead of round ones.
    pub square: bool,
}

impl Brush {
    /// A plain round brush of a width: opaque, slight bristle, no relief.
    pub(crate) fn round(width: f32) -> Self {
        Self {
            width,
            opacity: 1.0,
            bristle: 0.25,
            grain: 0.0,
            relief: 0.0,
            taper: 0.4,
            square: false,
        }
    }
}

impl Canvas {
    /// A canvas primed with one colour.
    pub(crate) fn new(width: usize, height: usize, ground: Vec3) -> Self {
        Self {
            width,
            height,
            colour: vec![ground; width * height],
            thickness: vec![0.0; width * height],
        }
    }

    /// Replaces every pixel by `shade(centre, present colour)`.
    pub(crate) fn each(&mut self, mut shade: impl FnMut(Vec2, Vec3) -> Vec3) {
        for (i, c) in self.colour.iter_mut().enumerate() {
            let p = Vec2::new((i % self.width) as f32, (i / self.width) as f32) + 0.5;
            *c = shade(p, *c);
        }
    }

    /// Calls `mark(index, centre)` for the pixels of a box, clipped to the canvas.
    fn in_box(&mut self, low: Vec2, high: Vec2, mut mark: impl FnMut(&mut Self, usize, Vec2)) {
        let (x0, x1) = clipped(low.x, high.x, self.width);
        let (y0, y1) = clipped(low.y, high.y, self.height);
        for y in y0..y1 {
            for x in x0..x1 {
                let p = Vec2::new(x as f32, y as f32) + 0.5;
                mark(self, y * self.width + x, p);
            }
        }
    }

    /// Fills a polygon; `paint(p)` gives colour and opacity at each point.
    pub(crate) fn polygon(&mut self, points: &[Vec2], paint: impl Fn(Vec2) -> (Vec3, f32)) {
        let (low, high) = bounds(points, 1.0);
        self.in_box(low, high, |canvas, i, p| {
            let cover = (0.5 - polygon_distance(points, p)).clamp(0.0, 1.0);
            if cover > 0.0 {
                let (c, a) = paint(p);
                canvas.colour[i] = canvas.colour[i].lerp(c, cover * a);
            }
        });
    }

    /// Fills a polygon with one colour.
    pub(crate) fn fill(&mut self, points: &[Vec2], c: Vec3, opacity: f32) {
        self.polygon(points, |_| (c, opacity));
    }

    /// A disc with a soft edge one pixel wide.
    pub(crate) fn disc(&mut self, centre: Vec2, radius: f32, c: Vec3, opacity: f32) {
        let reach = Vec2::splat(radius + 1.0);
        self.in_box(centre - reach, centre + reach, |canvas, i, p| {
            let cover = (radius + 0.5 - p.distance(centre)).clamp(0.0, 1.0) * opacity;
            canvas.colour[i] = canvas.colour[i].lerp(c, cover);
        });
    }

    /// One brush stroke along `path` (pixels). `seed` makes its bristles its own. StrokeSettings thinner
    /// than a pixel keep their weight by becoming fainter.
    pub(crate) fn stroke(&mut self, path: &[Vec2], brush: &Brush, c: Vec3, seed: u32) {
        let radius = (brush.width * 0.5).max(0.5);
        let faint = brush.opacity * brush.width.min(1.0);
        let total: f32 = path.windows(2).map(|s| s[0].distance(s[1])).sum();
        let hairs = (radius * 0.6).clamp(1.0, 3.5);
        for touch in self.touches(path, radius + 1.0, brush.square) {
            let (i, p) = (touch.index, touch.point);
            let u = touch.along / total.max(1.0);
            let reach = radius * (1.0 - brush.taper * u * u).max(0.15);
            let mut cover = (reach + 0.5 - touch.away).clamp(0.0, 1.0) * faint;
            if cover <= 0.0 {
                continue;
            }
            let v = (touch.across / reach).clamp(-1.0, 1.0);
            let hair = noise(Vec2::new(v * hairs, touch.along / (radius * 5.0)), seed) - 0.5;
            if brush.grain > 0.0 {
                let tooth = noise(p * 0.9, 0x700d) * 0.6 + noise(p * 0.37, 0x7001) * 0.4;
                let need = brush.grain * (0.85 + 0.3 * u) - 0.1 + hair * 0.2;
                cover *= smoothstep(need - 0.18, need + 0.18, tooth);
            }
            // Hairs darken and lighten the load, and run dry near the end of the stroke.
            let dry = 1.0 - brush.bristle * smoothstep(0.5, 1.1, u) * (0.5 - hair).clamp(0.0, 1.0);
            cover *= dry;
            let load = (c * (1.0 + brush.bristle * hair * 1.1)).clamp(Vec3::ZERO, Vec3::ONE);
            self.colour[i] = self.colour[i].lerp(load, cover);
            if brush.relief > 0.0 {
                let body = (1.0 - v * v * 0.6) + hair * brush.bristle * 1.6;
                let top = self.thickness[i] * 0.35 + brush.relief * brush.width * body;
                self.thickness[i] += (top - self.thickness[i]) * cover;
            }
        }
    }

    /// The pixels within `reach` of a path, each once with its place along the nearest segment.
    /// Every segment visits only its own box: a long diagonal path has a large box, mostly empty.
    fn touches(&self, path: &[Vec2], reach: f32, square: bool) -> Vec<Touch> {
        let (low, high) = bounds(path, reach);
        let (x0, x1) = clipped(low.x, high.x, self.width);
        let (y0, y1) = clipped(low.y, high.y, self.height);
        if x0 >= x1 || y0 >= y1 {
            return Vec::new();
        }
        let columns = x1 - x0;
        let mut slots = vec![u32::MAX; columns * (y1 - y0)];
        let mut touches: Vec<Touch> = Vec::with_capacity(64);
        let mut walked = 0.0;
        for pair in path.windows(2) {
            let (low, high) = bounds(pair, reach);
            let (sx0, sx1) = clipped(low.x, high.x, self.width);
            let (sy0, sy1) = clipped(low.y, high.y, self.height);
            for y in sy0..sy1 {
                for x in sx0..sx1 {
                    let point = Vec2::new(x as f32, y as f32) + 0.5;
                    let (away, across, along) = from_segment(pair[0], pair[1], point, square);
                    if away > reach {
                        continue;
                    }
                    let index = y * self.width + x;
                    let touch = Touch {
                        index,
                        point,
                        away,
                        across,
                        along: walked + along,
                    };
                    let slot = &mut slots[(y - y0) * columns + x - x0];
                    if *slot == u32::MAX {
                        *slot = touches.len() as u32;
                        touches.push(touch);
                    } else if away < touches[*slot as usize].away {
                        touches[*slot as usize] = touch;
                    }
                }
            }
            walked += pair[0].distance(pair[1]);
        }
        touches
    }

    /// Lights the paint's relief from the direction `from` (unit vector in the picture's plane).
    /// `strength` scales the shading, `gloss` the highlights on ridges.
    pub(crate) fn light_relief(&mut self, from: Vec2, strength: f32, gloss: f32) {
        let (w, h) = (self.width, self.height);
        for y in 0..h {
            for x in 0..w {
                let t = |x: usize, y: usize| self.thickness[y * w + x];
                let slope = Vec2::new(
                    t((x + 1).min(w - 1), y) - t(x.saturating_sub(1), y),
                    t(x, (y + 1).min(h - 1)) - t(x, y.saturating_sub(1)),
                );
                // Paint rising away from the light faces it.
                let facing = (-slope.dot(from) * strength).clamp(-0.6, 0.6);
                let c = &mut self.colour[y * w + x];
                let lit = *c * (1.0 + facing * 0.8);
                let shine = (facing - 0.12).max(0.0) * gloss;
                *c = (lit + shine).clamp(Vec3::ZERO, Vec3::ONE);
            }
        }
    }

    /// Averages colours over a square of half side `radius` pixels, twice (nearly a bell shape).
    pub(crate) fn blur(&mut self, radius: usize) {
        for _ in 0..2 {
            box_blur(&mut self.colour, self.width, self.height, radius);
        }
    }

    /// Rounds to 8 bits; anything not finite becomes black.
    pub(crate) fn to_image(&self) -> RgbImage {
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        RgbImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            let c = self.colour[y as usize * self.width + x as usize];
            image::Rgb([byte(c.x), byte(c.y), byte(c.z)])
        })
    }
}

/// The box around `points`, grown by `margin`.
pub(crate) fn bounds(points: &[Vec2], margin: f32) -> (Vec2, Vec2) {
    let mut low = Vec2::splat(f32::INFINITY);
    let mut high = Vec2::splat(f32::NEG_INFINITY);
    for &p in points {
        low = low.min(p);
        high = high.max(p);
    }
    (low - margin, high + margin)
}

/// One pixel under a stroke.
struct Touch {
    index: usize,
    point: Vec2,
    /// Distance to the path.
    away: f32,
    /// Signed distance across it.
    across: f32,
    /// Length along it.
    along: f32,
}

/// The pixels `first..end` of a side of `n` pixels that the interval touches.
fn clipped(low: f32, high: f32, n: usize) -> (usize, usize) {
    let first = low.floor().max(0.0) as usize;
    let end = (high.ceil().max(0.0) as usize).min(n);
    (first, end)
}

/// Distance from `p` to the segment, signed distance across it, and length along it.
fn from_segment(a: Vec2, b: Vec2, p: Vec2, square: bool) -> (f32, f32, f32) {
    let edge = b - a;
    let length = edge.length().max(1e-6);
    let unit = edge / length;
    let from = p - a;
    let t = from.dot(unit);
    let inside = t.clamp(0.0, length);
    let across = unit.perp_dot(from);
    let away = if square {
        // Past its ends a square stroke stops within a fraction of a pixel.
        across.abs().max((t - inside).abs() * 4.0)
    } else {
        from.distance(unit * inside)
    };
    (away, across, inside)
}

/// Running-sum box blur along rows, then columns.
pub(crate) fn box_blur(field: &mut [Vec3], w: usize, h: usize, radius: usize) {
    if radius == 0 || w == 0 {
        return;
    }
    let mut line = Vec::with_capacity(w.max(h));
    for y in 0..h {
        line.clear();
        line.extend_from_slice(&field[y * w..(y + 1) * w]);
        blur_line(&line, radius, |x, c| field[y * w + x] = c);
    }
    for x in 0..w {
        line.clear();
        line.extend((0..h).map(|y| field[y * w + x]));
        blur_line(&line, radius, |y, c| field[y * w + x] = c);
    }
}

fn blur_line(line: &[Vec3], radius: usize, mut put: impl FnMut(usize, Vec3)) {
    let n = line.len();
    let mut sum: Vec3 = line.iter().take(radius).sum();
    let mut count = radius.min(n);
    for i in 0..n {
        if i + radius < n {
            sum += line[i + radius];
            count += 1;
        }
        if i > radius {
            sum -= line[i - radius - 1];
            count -= 1;
        }
        put(i, sum / count as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stroke_covers_its_path_and_nothing_far_away() {
        let mut canvas = Canvas::new(40, 20, Vec3::ONE);
        let path = [Vec2::new(5.0, 10.0), Vec2::new(35.0, 10.0)];
        let brush = Brush {
            bristle: 0.0,
            taper: 0.0,
            ..Brush::round(6.0)
        };
        canvas.stroke(&path, &brush, Vec3::ZERO, 1);
        assert!(canvas.colour[10 * 40 + 20].x < 0.01);
        assert!(canvas.colour[15 * 40 + 20].x > 0.99);
        assert!(canvas.colour[5 * 40 + 20].x > 0.99);
    }

    #[test]
    fn blur_keeps_a_constant_and_the_mean_of_a_spike_inside() {
        let mut field = vec![Vec3::splat(0.25); 63];
        box_blur(&mut field, 9, 7, 2);
        assert!(field.iter().all(|c| (c.x - 0.25).abs() < 1e-6));
        let mut spike = vec![Vec3::ZERO; 21 * 21];
        spike[10 * 21 + 10] = Vec3::ONE;
        box_blur(&mut spike, 21, 21, 2);
        let total: f32 = spike.iter().map(|c| c.x).sum();
        assert!((total - 1.0).abs() < 1e-4);
    }

    #[test]
    fn relief_brightens_the_side_that_faces_the_light() {
        let mut canvas = Canvas::new(9, 1, Vec3::splat(0.5));
        canvas.thickness = vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
        canvas.light_relief(Vec2::new(-1.0, 0.0), 0.4, 0.0);
        assert!(canvas.colour[2].x > 0.55 && canvas.colour[6].x < 0.45);
    }
}
