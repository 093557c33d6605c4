//! The underdrawing: a composition of shapes rasterised to colour, region and direction per pixel,
//! from which every technique paints.

use crate::canvas::bounds;
use crate::colour::lightness;
use crate::maths::{direction, mix, polygon_distance, smoothstep, wave};
use crate::noise::{drift, fractal, noise};
use glam::{Vec2, Vec3};

/// An outline. Composition space: y from 0 (top) to 1 (bottom), x from 0 to the aspect ratio.
pub(crate) enum Outline {
    /// The whole picture.
    All,
    /// Everything below a ridge at height `level`, undulating by `swing` with features of `1/rate`.
    Below {
        level: f32,
        swing: f32,
        rate: f32,
        seed: u32,
    },
    /// An ellipse whose first axis points along `axis`; `ragged` roughens its outline.
    Ellipse {
        centre: Vec2,
        radii: Vec2,
        axis: Vec2,
        ragged: f32,
    },
    /// A closed polygon.
    Polygon(Vec<Vec2>),
    /// A limb or trunk from `a` to `b` whose radius goes from `ra` to `rb`.
    Limb { a: Vec2, b: Vec2, ra: f32, rb: f32 },
}

/// How light falls on a shape.
#[derive(Clone, Copy)]
pub(crate) enum Modelling {
    /// One colour.
    Flat,
    /// From `light` at the top to `shade` at the bottom.
    Fall,
    /// A rounded body lit from the scene's light.
    Round,
    /// Folds of cloth.
    Folds,
    /// Irregular patches of light and shade (foliage, cloud, rock).
    Patches,
}

/// Which way brush strokes run inside a shape.
#[derive(Clone, Copy)]
pub(crate) enum StrokeFlow {
    /// Along a fixed direction.
    Along(Vec2),
    /// Around the shape's middle.
    Around,
    /// Wandering.
    Loose,
}

/// One painted thing.
pub(crate) struct PaintedShape {
    pub outline: Outline,
    pub light: Vec3,
    pub shade: Vec3,
    pub modelling: Modelling,
    pub flow: StrokeFlow,
    /// Softness of the outline, composition units.
    pub soft: f32,
}

/// A composition before it is rasterised.
pub(crate) struct Composition {
    /// Back to front.
    pub shapes: Vec<PaintedShape>,
    /// Direction the light comes from, in the picture's plane.
    pub light: Vec2,
    /// How far hand-drawn outlines wander, composition units.
    pub wobble: f32,
    /// Pigments that drift over large areas, mixed in by noise.
    pub stains: [Vec3; 2],
    /// Share of the stains, `[0, 1]`.
    pub stain: f32,
    pub seed: u32,
}

/// The rasterised underdrawing; all vectors are row-major, one entry per pixel.
pub(crate) struct Sketch {
    pub width: usize,
    pub height: usize,
    pub colour: Vec<Vec3>,
    /// Index of the front-most shape; larger is nearer.
    pub region: Vec<u16>,
    /// Unit direction of strokes.
    pub flow: Vec<Vec2>,
    /// How many regions there may be (largest index + 1).
    pub regions: usize,
}

impl Outline {
    /// Signed distance (negative inside) and the point in the shape's own frame, about `[-1, 1]²`.
    fn at(&self, p: Vec2) -> (f32, Vec2) {
        match self {
            Self::All => (-1.0, p * 2.0 - 1.0),
            Self::Below {
                level,
                swing,
                rate,
                seed,
            } => {
                let ridge =
                    level + swing * (fractal(Vec2::new(p.x * rate, level * 9.0), 4, *seed) - 0.5);
                let below = p.y - ridge;
                (
                    -below,
                    Vec2::new(p.x * 2.0 - 1.0, below / (1.0 - level).max(0.05) * 2.0 - 1.0),
                )
            }
            Self::Ellipse {
                centre,
                radii,
                axis,
                ragged,
            } => {
                let q = p - *centre;
                let local = Vec2::new(q.dot(*axis), axis.perp_dot(q)) / *radii;
                let least = radii.min_element();
                let rough = if *ragged > 0.0 {
                    ragged * (fractal(p * (1.2 / least), 3, centre.x.to_bits()) - 0.5) * 2.0
                } else {
                    0.0
                };
                ((local.length() - 1.0 + rough) * least, local)
            }
            Self::Polygon(points) => {
                let (low, high) = bounds(points, 0.0);
                let half = ((high - low) * 0.5).max(Vec2::splat(1e-4));
                (polygon_distance(points, p), (p - (low + high) * 0.5) / half)
            }
            Self::Limb { a, b, ra, rb } => {
                let edge = *b - *a;
                let length = edge.length().max(1e-5);
                let unit = edge / length;
                let t = ((p - *a).dot(unit) / length).clamp(0.0, 1.0);
                let radius = mix(*ra, *rb, t).max(1e-4);
                let across = unit.perp_dot(p - *a) / radius;
                (
                    p.distance(*a + edge * t) - radius,
                    Vec2::new(across, t * 2.0 - 1.0),
                )
            }
        }
    }

    /// A box that holds the shape.
    fn extent(&self) -> (Vec2, Vec2) {
        match self {
            Self::All | Self::Below { .. } => {
                (Vec2::splat(f32::NEG_INFINITY), Vec2::splat(f32::INFINITY))
            }
            Self::Ellipse {
                centre,
                radii,
                ragged,
                ..
            } => {
                let reach = Vec2::splat(radii.max_element() * (1.05 + ragged));
                (*centre - reach, *centre + reach)
            }
            Self::Polygon(points) => bounds(points, 0.0),
            Self::Limb { a, b, ra, rb } => bounds(&[*a, *b], ra.max(*rb)),
        }
    }
}

impl PaintedShape {
    /// Share of `light` against `shade` at a point of the shape's own frame.
    fn lit(&self, local: Vec2, p: Vec2, light: Vec2, seed: u32) -> f32 {
        match self.modelling {
            Modelling::Flat => 1.0,
            Modelling::Fall => 0.5 - 0.5 * local.y.clamp(-1.0, 1.0),
            Modelling::Round => {
                let q = local.clamp_length_max(1.0);
                let up = (1.0 - q.length_squared()).max(0.0).sqrt();
                smoothstep(-0.35, 0.95, q.dot(light) * 0.75 + up * 0.5)
            }
            Modelling::Folds => {
                let bend = fractal(p * 3.0, 2, seed);
                let fold = wave(local.x * 1.7 + local.y * 0.5 + bend * 2.4);
                smoothstep(-1.0, 1.0, fold * 0.8 + local.dot(light) * 0.5)
            }
            Modelling::Patches => {
                let patch = fractal(p * 9.0, 3, seed) - 0.5 + local.dot(light) * 0.14;
                smoothstep(-0.2, 0.2, patch)
            }
        }
    }

    fn heading(&self, local: Vec2, p: Vec2, seed: u32) -> Vec2 {
        let base = match self.flow {
            StrokeFlow::Along(d) => d,
            StrokeFlow::Around => local.perp().try_normalize().unwrap_or(Vec2::X),
            StrokeFlow::Loose => direction(fractal(p * 2.0, 2, seed) * 2.0),
        };
        let stray = (noise(p * 5.0, seed) - 0.5) * 0.25;
        crate::maths::turned(base, stray)
    }
}

impl Sketch {
    /// Rasterises a composition at `width`×`height` pixels (both at least 1).
    pub(crate) fn draw(composition: &Composition, width: usize, height: usize) -> Self {
        let scale = 1.0 / height as f32;
        let n = width * height;
        let mut sketch = Self {
            width,
            height,
            colour: vec![Vec3::ZERO; n],
            region: vec![0; n],
            flow: vec![Vec2::X; n],
            regions: composition.shapes.len().max(1),
        };
        let points: Vec<Vec2> = (0..n)
            .map(|i| {
                let p = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5) * scale;
                p + drift(p * 7.0, 2, composition.seed) * composition.wobble
            })
            .collect();
        for (index, shape) in composition.shapes.iter().enumerate() {
            sketch.lay(composition, shape, index, &points, scale);
        }
        for (c, p) in sketch.colour.iter_mut().zip(&points) {
            for (k, stain) in composition.stains.iter().enumerate() {
                let amount = fractal(*p * 4.0, 3, composition.seed ^ (k as u32 + 11));
                *c = c.lerp(*stain, smoothstep(0.5, 0.85, amount) * composition.stain);
            }
        }
        sketch
    }

    fn lay(
        &mut self,
        whole: &Composition,
        shape: &PaintedShape,
        index: usize,
        points: &[Vec2],
        scale: f32,
    ) {
        let margin = Vec2::splat(whole.wobble + shape.soft + scale);
        let (low, high) = shape.outline.extent();
        let (low, high) = ((low - margin) / scale, (high + margin) / scale);
        let seed = whole.seed ^ (index as u32).wrapping_mul(0x9e37);
        let edge = shape.soft.max(scale * 0.5);
        let (x0, x1) = (
            low.x.max(0.0) as usize,
            (high.x.max(0.0) as usize).saturating_add(1).min(self.width),
        );
        let (y0, y1) = (
            low.y.max(0.0) as usize,
            (high.y.max(0.0) as usize)
                .saturating_add(1)
                .min(self.height),
        );
        for y in y0..y1 {
            for x in x0..x1 {
                let i = y * self.width + x;
                let p = points[i];
                let (distance, local) = shape.outline.at(p);
                let cover = smoothstep(edge, -edge, distance);
                if cover <= 0.0 {
                    continue;
                }
                let lit = shape.lit(local, p, whole.light, seed);
                let c = shape.shade.lerp(shape.light, lit);
                self.colour[i] = self.colour[i].lerp(c, cover);
                if cover > 0.5 {
                    self.region[i] = index.min(usize::from(u16::MAX)) as u16;
                    self.flow[i] = shape.heading(local, p, seed);
                }
            }
        }
    }

    /// Index of the pixel at a point in pixels, clamped to the picture.
    pub(crate) fn index(&self, p: Vec2) -> usize {
        let x = (p.x.max(0.0) as usize).min(self.width - 1);
        let y = (p.y.max(0.0) as usize).min(self.height - 1);
        y * self.width + x
    }

    /// The colour at a point in pixels.
    pub(crate) fn at(&self, p: Vec2) -> Vec3 {
        self.colour[self.index(p)]
    }

    /// Largest colour difference between a point and four others `reach` pixels away.
    pub(crate) fn detail(&self, p: Vec2, reach: f32) -> f32 {
        let own = self.at(p);
        [Vec2::X, Vec2::Y, -Vec2::X, -Vec2::Y]
            .iter()
            .map(|d| self.at(p + *d * reach).distance(own))
            .fold(0.0, f32::max)
    }

    /// The lightness of every pixel.
    pub(crate) fn tones(&self) -> Vec<f32> {
        self.colour.iter().map(|c| lightness(*c)).collect()
    }

    /// Mean colour of every region (black where a region is hidden).
    pub(crate) fn region_means(&self) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0u32); self.regions];
        for (c, r) in self.colour.iter().zip(&self.region) {
            let slot = &mut sums[usize::from(*r)];
            slot.0 += *c;
            slot.1 += 1;
        }
        sums.iter()
            .map(|(sum, n)| *sum / (*n).max(1) as f32)
            .collect()
    }

    /// Distance in pixels of every pixel to the nearest outline between regions that both cover at
    /// least `least` pixels (chamfer metric).
    pub(crate) fn outline_distance(&self, least: f32) -> Vec<f32> {
        let (w, h) = (self.width, self.height);
        let mut areas = vec![0u32; self.regions];
        for r in &self.region {
            areas[usize::from(*r)] += 1;
        }
        let parted = |i: usize, j: usize| {
            let (a, b) = (usize::from(self.region[i]), usize::from(self.region[j]));
            a != b && areas[a].min(areas[b]) as f32 >= least
        };
        let mut d: Vec<f32> = (0..w * h)
            .map(|i| {
                let right = i % w + 1 < w && parted(i, i + 1);
                let below = i + w < w * h && parted(i, i + w);
                if right || below { 0.0 } else { 1e6 }
            })
            .collect();
        const DIAGONAL: f32 = std::f32::consts::SQRT_2;
        let relax = |d: &mut [f32], x: usize, y: usize, back: bool| {
            let mut best = d[y * w + x];
            let row = if back { y + 1 } else { y.wrapping_sub(1) };
            if row < h {
                for (nx, step) in [(x.wrapping_sub(1), DIAGONAL), (x, 1.0), (x + 1, DIAGONAL)] {
                    if nx < w {
                        best = best.min(d[row * w + nx] + step);
                    }
                }
            }
            let side = if back { x + 1 } else { x.wrapping_sub(1) };
            if side < w {
                best = best.min(d[y * w + side] + 1.0);
            }
            d[y * w + x] = best;
        };
        for y in 0..h {
            for x in 0..w {
                relax(&mut d, x, y, false);
            }
        }
        for y in (0..h).rev() {
            for x in (0..w).rev() {
                relax(&mut d, x, y, true);
            }
        }
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc_on_ground() -> Sketch {
        let shape = |outline, light| PaintedShape {
            outline,
            light,
            shade: light,
            modelling: Modelling::Flat,
            flow: StrokeFlow::Loose,
            soft: 0.0,
        };
        let disc = Outline::Ellipse {
            centre: Vec2::splat(0.5),
            radii: Vec2::splat(0.25),
            axis: Vec2::X,
            ragged: 0.0,
        };
        let composition = Composition {
            shapes: vec![shape(Outline::All, Vec3::ZERO), shape(disc, Vec3::ONE)],
            light: Vec2::X,
            wobble: 0.0,
            stains: [Vec3::ZERO; 2],
            stain: 0.0,
            seed: 1,
        };
        Sketch::draw(&composition, 64, 64)
    }

    #[test]
    fn shapes_cover_what_lies_inside_them() {
        let sketch = disc_on_ground();
        assert_eq!(sketch.at(Vec2::splat(32.0)), Vec3::ONE);
        assert_eq!(sketch.at(Vec2::splat(3.0)), Vec3::ZERO);
        let share = sketch.region.iter().filter(|r| **r == 1).count() as f32 / 4096.0;
        assert!((share - 0.196).abs() < 0.01, "{share}");
        assert!(sketch.region_means()[1].x > 0.95);
    }

    #[test]
    fn outline_distance_grows_from_the_outline() {
        let sketch = disc_on_ground();
        let d = sketch.outline_distance(1.0);
        assert!(d[32 * 64 + 48] <= 1.5, "{}", d[32 * 64 + 48]);
        assert!((d[32 * 64 + 32] - 16.0).abs() < 2.0);
    }
}
