//! Pictorial layouts: loose landscapes, figures, still lifes and abstractions made from chance.

mod abstraction;
mod indoors;
mod outdoors;

use crate::colour::Pigments;
use crate::dice::Dice;
use crate::maths::direction;
use crate::sketch::{Composition, Flow, Form, Modelling, Shape};
use glam::{Vec2, Vec3};

/// What a layout is built with: the pigments, chance, and the shapes put down so far.
pub(crate) struct Stage<'a> {
    pub pigments: &'a Pigments,
    pub dice: &'a Dice,
    /// Width over height.
    pub aspect: f32,
    /// Added to every tone: a low key is dark, a high key pale.
    key: f32,
    shapes: Vec<Shape>,
}

/// Composes a picture of a kind chosen by chance.
pub(crate) fn compose(pigments: &Pigments, dice: &Dice, aspect: f32) -> Composition {
    let key = if dice.chance(0.55) {
        0.0
    } else {
        dice.range(-0.28, 0.2)
    };
    let light = direction(dice.range(0.52, 0.98));
    let seed = dice.bits();
    let (wobble, stain) = (dice.range(0.004, 0.03), dice.range(0.0, 0.6));
    let stains = [pigments.pick(dice), pigments.pick(dice)];
    let kind = dice.index(LAYOUTS.len());
    let mut stage = Stage {
        pigments,
        dice,
        aspect,
        key,
        shapes: Vec::new(),
    };
    LAYOUTS[kind](&mut stage);
    Composition {
        shapes: stage.shapes,
        light,
        wobble,
        stains,
        stain,
        seed,
    }
}

/// Every layout; those listed twice are twice as likely.
const LAYOUTS: &[fn(&mut Stage)] = &[
    outdoors::landscape,
    outdoors::landscape,
    outdoors::seascape,
    outdoors::forest,
    outdoors::town,
    outdoors::pond,
    indoors::portrait,
    indoors::portrait,
    indoors::still_life,
    indoors::still_life,
    indoors::company,
    abstraction::planes,
    abstraction::rhythm,
];

impl Stage<'_> {
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

    /// Puts a shape in front of the others. Its outline is crisp.
    pub(crate) fn put(
        &mut self,
        form: Form,
        light: Vec3,
        shade: Vec3,
        modelling: Modelling,
        flow: Flow,
    ) {
        self.put_soft(form, light, shade, modelling, flow, 0.0);
    }

    /// As `put`, with an outline that fades over `soft`.
    pub(crate) fn put_soft(
        &mut self,
        form: Form,
        light: Vec3,
        shade: Vec3,
        modelling: Modelling,
        flow: Flow,
        soft: f32,
    ) {
        self.shapes.push(Shape {
            form,
            light,
            shade,
            modelling,
            flow,
            soft,
        });
    }

    /// The backdrop: fills the whole picture.
    pub(crate) fn backdrop(&mut self, top: Vec3, bottom: Vec3, flow: Flow) {
        self.put(Form::All, top, bottom, Modelling::Fall, flow);
    }

    /// A ridge across the picture and everything below it.
    pub(crate) fn below(&self, level: f32, swing: f32) -> Form {
        Form::Below {
            level,
            swing,
            rate: self.dice.range(1.2, 5.0),
            seed: self.dice.bits(),
        }
    }
}

/// An upright ellipse.
pub(crate) fn oval(centre: Vec2, radii: Vec2) -> Form {
    Form::Ellipse {
        centre,
        radii,
        axis: Vec2::X,
        ragged: 0.0,
    }
}

/// A ragged, roughly elliptical mass.
pub(crate) fn mass(centre: Vec2, radii: Vec2, ragged: f32) -> Form {
    Form::Ellipse {
        centre,
        radii,
        axis: Vec2::X,
        ragged,
    }
}

/// A vertical quadrilateral standing on `foot`, `top` as wide at the top as `base` at the foot.
pub(crate) fn tower(foot: Vec2, base: f32, top: f32, height: f32) -> Form {
    Form::Polygon(vec![
        foot + Vec2::new(-base * 0.5, 0.0),
        foot + Vec2::new(-top * 0.5, -height),
        foot + Vec2::new(top * 0.5, -height),
        foot + Vec2::new(base * 0.5, 0.0),
    ])
}
