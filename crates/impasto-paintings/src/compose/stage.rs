//! The stage on which layouts put shapes, and the outlines that they have in common.

use crate::colour::Pigments;
use crate::dice::Dice;
use crate::sketch::{Modelling, Outline, PaintedShape, StrokeFlow};
use glam::{Vec2, Vec3};

/// StrokeSettings across the picture.
pub(super) const LEVEL: StrokeFlow = StrokeFlow::Along(Vec2::X);
/// StrokeSettings up and down.
pub(super) const UPRIGHT: StrokeFlow = StrokeFlow::Along(Vec2::Y);
/// StrokeSettings around a shape's middle.
pub(super) const AROUND: StrokeFlow = StrokeFlow::Around;
/// Wandering strokes.
pub(super) const LOOSE: StrokeFlow = StrokeFlow::Loose;

/// What a layout is built with: the pigments, chance, and the shapes put down so far.
pub(crate) struct PaintingStage<'a> {
    pub pigments: &'a Pigments,
    pub dice: &'a Dice,
    /// Width over height.
    pub aspect: f32,
    /// Added to every tone: a low key is dark, a high key pale.
    pub key: f32,
    /// Back to front.
    pub shapes: Vec<PaintedShape>,
}

impl PaintingStage<'_> {
    /// A point at fractions of the picture's width and height.
    pub(crate) fn at(&self, u: f32, v: f32) -> Vec2 {
        Vec2::new(u * self.aspect, v)
    }

    /// Size of things: 1 for square and wide pictures, less for narrow ones.
    pub(crate) fn size(&self) -> f32 {
        self.aspect.clamp(0.05, 1.0)
    }

    /// The pigment of rank `t`, in the picture's key.
    pub(crate) fn tone(&self, t: f32) -> Vec3 {
        self.pigments.tone(t + self.key)
    }

    /// A pigment whose rank is near `t`: hue varies more than lightness.
    pub(crate) fn near(&self, t: f32) -> Vec3 {
        let stray = self.dice.bell() * 0.2;
        self.tone(t + stray)
    }

    /// Two pigments [`near`](Self::near) ranks: in the light and in the shade.
    pub(crate) fn near_pair(&self, light: f32, shade: f32) -> [Vec3; 2] {
        [self.near(light), self.near(shade)]
    }

    /// A pigment at random, in no key.
    pub(crate) fn pick(&self) -> Vec3 {
        self.pigments.pick(self.dice)
    }

    /// Puts a shape in front of the others; `colours` are those in the light and in the shade. Its
    /// outline is crisp.
    pub(crate) fn put(
        &mut self,
        outline: Outline,
        colours: [Vec3; 2],
        modelling: Modelling,
        flow: StrokeFlow,
    ) {
        self.put_soft(outline, colours, modelling, flow, 0.0);
    }

    /// As `put`, with an outline that fades over `soft`.
    pub(crate) fn put_soft(
        &mut self,
        outline: Outline,
        [light, shade]: [Vec3; 2],
        modelling: Modelling,
        flow: StrokeFlow,
        soft: f32,
    ) {
        self.shapes.push(PaintedShape {
            outline,
            light,
            shade,
            modelling,
            flow,
            soft,
        });
    }

    /// Fills the whole picture, from the first colour at the top to the second at the bottom.
    pub(crate) fn backdrop(&mut self, colours: [Vec3; 2], flow: StrokeFlow) {
        self.put(Outline::All, colours, Modelling::Fall, flow);
    }

    /// A ridge across the picture and everything below it.
    pub(crate) fn below(&self, level: f32, swing: f32) -> Outline {
        Outline::Below {
            level,
            swing,
            rate: self.dice.range(1.2, 5.0),
            seed: self.dice.bits(),
        }
    }
}

/// An upright ellipse.
pub(crate) fn oval(centre: Vec2, radii: Vec2) -> Outline {
    mass(centre, radii, 0.0)
}

/// A ragged, roughly elliptical mass.
pub(crate) fn mass(centre: Vec2, radii: Vec2, ragged: f32) -> Outline {
    ellipse(centre, radii, Vec2::X, ragged)
}

/// An ellipse whose first axis points along `axis`, with a ragged outline.
pub(crate) fn ellipse(centre: Vec2, radii: Vec2, axis: Vec2, ragged: f32) -> Outline {
    Outline::Ellipse {
        centre,
        radii,
        axis,
        ragged,
    }
}

/// A limb or trunk from `a` to `b` whose radius goes from `ra` to `rb`.
pub(crate) fn limb(a: Vec2, b: Vec2, ra: f32, rb: f32) -> Outline {
    Outline::Limb { a, b, ra, rb }
}

/// A vertical quadrilateral standing on `foot`, `top` as wide at the top as `base` at the foot.
pub(crate) fn tower(foot: Vec2, base: f32, top: f32, height: f32) -> Outline {
    Outline::Polygon(vec![
        foot + Vec2::new(-base * 0.5, 0.0),
        foot + Vec2::new(-top * 0.5, -height),
        foot + Vec2::new(top * 0.5, -height),
        foot + Vec2::new(base * 0.5, 0.0),
    ])
}

/// StrokeSettings across the picture that rise or fall.
pub(super) fn sloping(slope: f32) -> StrokeFlow {
    StrokeFlow::Along(Vec2::new(1.0, slope).normalize_or(Vec2::X))
}
