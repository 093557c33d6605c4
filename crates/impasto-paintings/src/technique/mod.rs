//! One function per family: paints the sketch onto the canvas in the family's technique.

mod chalk;
mod contours;
mod flat;
mod lines;
mod ornament;
mod strokes;
mod studio;
mod thick;
mod tiles;
mod washes;

use crate::colour::saturated;
use crate::noise::hash_unit;
use crate::recipe::Family;
use glam::Vec3;
pub(crate) use studio::PaintingStudio;

/// The technique of a family.
pub(crate) fn of(family: Family) -> fn(&mut PaintingStudio) {
    match family {
        Family::Impressionist => strokes::impressionist,
        Family::Swirl => strokes::swirl,
        Family::Fauvist => strokes::fauvist,
        Family::Expressionist => strokes::expressionist,
        Family::OldMaster => strokes::old_master,
        Family::Gouache => strokes::gouache,
        Family::Knife => thick::knife,
        Family::Drip => thick::drip,
        Family::Pointillism => chalk::pointillism,
        Family::Pastel => chalk::pastel,
        Family::Drawing => chalk::drawing,
        Family::Woodblock => lines::woodblock,
        Family::Engraving => lines::engraving,
        Family::Linocut => lines::linocut,
        Family::InkWash => washes::ink_wash,
        Family::Watercolour => washes::watercolour,
        Family::Fresco => washes::fresco,
        Family::Mosaic => tiles::mosaic,
        Family::StainedGlass => tiles::stained_glass,
        Family::Cubist => tiles::cubist,
        Family::Tapestry => tiles::tapestry,
        Family::CutPaper => flat::cut_paper,
        Family::Geometric => flat::geometric,
        Family::GoldLeaf => ornament::gold_leaf,
    }
}

/// Age and photography: contrast, saturation, vignette, warm varnish and grain, all by chance.
pub(crate) fn finish(studio: &mut PaintingStudio) {
    let dice = &studio.dice;
    let contrast = dice.range(-0.15, 0.75);
    let saturation = dice.range(0.85, 1.2);
    let vignette = dice.unit() * dice.unit() * 0.35;
    let varnish = dice.unit() * dice.unit() * 0.3;
    let grain = dice.range(0.0, 0.03);
    let size = studio.size();
    let seed = dice.bits();
    studio.canvas.each(|p, c| {
        let c = saturated(c, saturation).clamp(Vec3::ZERO, Vec3::ONE);
        // A gentle S-curve: fixed at 0, ½ and 1.
        let c = c + contrast * 2.0 * c * (Vec3::ONE - c) * (c - 0.5);
        let off = (p / size - 0.5).length_squared() * 2.0;
        let c = c * (1.0 - vignette * off) * Vec3::ONE.lerp(Vec3::new(1.0, 0.9, 0.68), varnish);
        let speck = hash_unit(p.x as i32, p.y as i32, seed) - 0.5;
        (c + speck * grain).clamp(Vec3::ZERO, Vec3::ONE)
    });
}
