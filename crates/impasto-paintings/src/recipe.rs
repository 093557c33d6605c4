//! What determines a picture: family, palette, seed and scale.

use crate::dice::Dice;
use crate::palettes::{NamedPalette, PALETTES};

macro_rules! families {
    ($($(#[$doc:meta])* $family:ident => $name:literal),* $(,)?) => {
        /// A way of painting.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Family { $($(#[$doc])* $family),* }

        impl Family {
            /// Every family.
            pub const ALL: &[Family] = &[$(Family::$family),*];

            /// The family's name in lower case.
            pub fn name(self) -> &'static str {
                match self { $(Family::$family => $name),* }
            }
        }
    };
}

families! {
    /// Short broken strokes that follow forms.
    Impressionist => "impressionist strokes",
    /// Thick swirling strokes.
    Swirl => "swirling strokes",
    /// Dots of pure pigment that mix in the eye.
    Pointillism => "pointillism",
    /// Flat colours, key-block outlines and wave contours.
    Woodblock => "woodblock print",
    /// Tesserae in grout.
    Mosaic => "mosaic",
    /// Diluted ink on paper with brush lines.
    InkWash => "ink wash",
    /// Flat paper shapes with shadows.
    CutPaper => "cut paper",
    /// Slabs of thick paint with relief.
    Knife => "palette knife",
    /// Large unnatural patches with bare canvas and contours.
    Fauvist => "fauvist patches",
    /// Coloured glass in lead.
    StainedGlass => "stained glass",
    /// Shifted and shaded facets.
    Cubist => "cubist facets",
    /// Transparent washes with wet edges on grainy paper.
    Watercolour => "watercolour",
    /// Hatched and cross-hatched lines.
    Engraving => "engraving",
    /// Colour fields, grids, bars and discs.
    Geometric => "geometric abstraction",
    /// Gold ground covered with ornament.
    GoldLeaf => "gold-leaf ornament",
    /// Grainy chalk strokes on toned paper.
    Pastel => "chalk pastel",
    /// Dark glazes, one light, craquelure.
    OldMaster => "old-master glaze",
    /// Contours and hatching in one chalk.
    Drawing => "chalk drawing",
    /// Matt pigment in cracked plaster.
    Fresco => "fresco",
    /// Angular slashes and black contours.
    Expressionist => "expressionist slashes",
    /// Flung and dripped skeins.
    Drip => "dripped paint",
    /// Woven threads.
    Tapestry => "tapestry",
    /// Bold carved marks in few colours.
    Linocut => "linocut",
    /// Smooth opaque paint in plain forms.
    Gouache => "gouache",
}

/// Fully determines a picture, apart from its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    /// The way of painting.
    pub family: Family,
    /// Index into [`PALETTES`]; taken modulo their number.
    pub palette: usize,
    /// Decides the composition, the mixing of the palette and every mark.
    pub seed: u64,
    /// Size of the marks: 1 is usual, 0.25…4 is used (anything else is clamped).
    pub scale: f32,
}

impl Recipe {
    /// A recipe of any family.
    pub fn random(seed: u64) -> Self {
        let dice = Dice::new(seed, 101);
        let family = Family::ALL[dice.index(Family::ALL.len())];
        Self::chosen(family, &dice, seed)
    }

    /// The recipe that belongs to `seed` within one family: palette and scale by chance.
    pub fn nth_of(family: Family, seed: u64) -> Self {
        Self::chosen(family, &Dice::new(seed, 202 + family as u64), seed)
    }

    fn chosen(family: Family, dice: &Dice, seed: u64) -> Self {
        let palette = dice.index(PALETTES.len());
        let t = dice.unit();
        Self {
            family,
            palette,
            seed,
            scale: 0.65 + 0.6 * t + 0.65 * t * t,
        }
    }

    /// The same recipe with palette and scale brought into range.
    pub(crate) fn in_range(self) -> Self {
        let scale = if self.scale.is_finite() {
            self.scale.clamp(0.25, 4.0)
        } else {
            1.0
        };
        Self {
            palette: self.palette % PALETTES.len(),
            scale,
            ..self
        }
    }

    pub(crate) fn palette(&self) -> &'static NamedPalette {
        &PALETTES[self.palette % PALETTES.len()]
    }
}

/// What to call a picture wherever it is shown, e.g. `synthetic: pointillism, ukiyo-e indigo #42`.
pub fn label(recipe: &Recipe) -> String {
    format!(
        "synthetic: {}, {} #{}",
        recipe.family.name(),
        recipe.palette().name,
        recipe.seed
    )
}
