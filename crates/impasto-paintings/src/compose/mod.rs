//! Pictorial layouts: loose landscapes, figures, still lifes and abstractions made from chance.

mod abstraction;
mod indoors;
mod outdoors;
mod stage;

use crate::colour::Pigments;
use crate::dice::Dice;
use crate::maths::direction;
use crate::sketch::Composition;
use stage::PaintingStage;

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
    let mut stage = PaintingStage {
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
const LAYOUTS: &[fn(&mut PaintingStage)] = &[
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
