//! The demo's paintings, which were not trained on.

use std::path::{Path, PathBuf};

use image::RgbImage;
use impasto::paintings::{Family, PALETTES, Recipe, label, paint};
use impasto::{Model, StyleEmbedding, StyledAppearance};

use crate::cli::CliError;
use crate::output::write_png;

/// First seed of the styles; all are below those that training paints from.
const HELD_OUT_SEEDS: u64 = 9_000;
const _: () = assert!(HELD_OUT_SEEDS + STYLES.len() as u64 <= impasto_train::FIRST_GENERATED);
/// Families and palettes that look unlike each other.
const STYLES: [(Family, &str); 5] = [
    (Family::Swirl, "starry cobalt"),
    (Family::Mosaic, "Byzantine gold"),
    (Family::Woodblock, "ukiyo-e indigo"),
    (Family::Pointillism, "southern sun"),
    (Family::Fauvist, "fauve riot"),
];
/// Side of a style image in pixels.
const STYLE_SIDE: u32 = 256;

/// A generated painting that was not trained on.
pub struct HeldOutStyle {
    /// Its kind.
    pub family: &'static str,
    /// What to say of it wherever it is shown.
    pub label: String,
    /// Where it was saved.
    pub file: PathBuf,
    /// Its pixels.
    pub picture: RgbImage,
    /// What a model makes of it.
    pub inspiration: StyleEmbedding,
    /// The look that the model gives it.
    pub look: StyledAppearance,
}

/// Paints the held-out styles, saves them and computes their looks.
pub fn styles(model: &Model, folder: &Path) -> Result<Vec<HeldOutStyle>, CliError> {
    STYLES
        .iter()
        .zip(HELD_OUT_SEEDS..)
        .map(|(&(family, palette), seed)| {
            let recipe = Recipe {
                palette: PALETTES.iter().position(|p| p.name == palette).unwrap_or(0),
                ..Recipe::nth_of(family, seed)
            };
            let painting = paint(&recipe, STYLE_SIDE, STYLE_SIDE);
            let file = folder.join(format!("{}.png", family.name().replace(' ', "-")));
            write_png(&file, &painting)?;
            let inspiration = model.embedding(&painting)?;
            Ok(HeldOutStyle {
                family: family.name(),
                label: label(&recipe),
                file,
                look: model.appearance(&inspiration).ok_or(CliError::Unstyled)?,
                picture: painting,
                inspiration,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_palette_exists() {
        for (_, name) in STYLES {
            assert!(
                PALETTES.iter().any(|palette| palette.name == name),
                "{name}"
            );
        }
    }
}
