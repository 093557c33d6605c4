//! What of a view's pictures is on one.

use image::{RgbImage, imageops};

use super::grid::{GAP, GROUND};

/// What each frame shows, by the names of the variants.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameLayout {
    /// One picture per variant.
    Each(Vec<String>),
    /// All variants on one picture, from the left, with a thin gap between them.
    SideBySide(Vec<String>),
}

/// What the scene as photographed is called.
const ORIGINAL: &str = "photo";

impl FrameLayout {
    /// Variants beside the scene as photographed, or each for itself.
    pub fn new(variants: Vec<String>, side_by_side: bool) -> Self {
        if side_by_side {
            Self::side_by_side(variants)
        } else {
            Self::Each(variants)
        }
    }

    /// Variants beside the scene as photographed, which comes first.
    pub fn side_by_side(mut variants: Vec<String>) -> Self {
        variants.insert(0, ORIGINAL.into());
        Self::SideBySide(variants)
    }

    /// The variants that have outputs of their own; none where all have one.
    pub fn variants(&self) -> &[String] {
        match self {
            Self::Each(names) => names,
            Self::SideBySide(_) => &[],
        }
    }

    /// The sub-folder of each output; one of no name, which is the folder itself, if there is one
    /// output.
    pub fn folders(&self) -> Vec<String> {
        match self.variants() {
            [] | [_] => vec![String::new()],
            several => several.to_vec(),
        }
    }

    /// A view's frames of its pictures in all variants.
    pub fn frames(&self, pictures: Vec<RgbImage>) -> Vec<RgbImage> {
        match self {
            Self::Each(_) => pictures,
            Self::SideBySide(_) => vec![beside(&pictures)],
        }
    }
}

/// Pictures of one height in a row.
fn beside(pictures: &[RgbImage]) -> RgbImage {
    let height = pictures.iter().map(RgbImage::height).max().unwrap_or(0);
    let width: u32 = pictures.iter().map(|picture| picture.width() + GAP).sum();
    let mut row = RgbImage::from_pixel(width.saturating_sub(GAP), height, GROUND);
    let mut x = 0;
    for picture in pictures {
        imageops::replace(&mut row, picture, i64::from(x), 0);
        x += picture.width() + GAP;
    }
    row
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn pictures_stand_in_a_row_with_gaps() {
        let pictures: Vec<RgbImage> = [10, 20, 30]
            .map(|shade| RgbImage::from_pixel(6, 5, Rgb([shade; 3])))
            .into();
        let names = ["photo", "a", "b"].map(String::from).to_vec();
        let layout = FrameLayout::side_by_side(names[1..].to_vec());
        assert_eq!(layout, FrameLayout::SideBySide(names.clone()));
        let frames = layout.frames(pictures.clone());
        assert_eq!(frames.len(), 1);
        assert_eq!(frames[0].dimensions(), (3 * 6 + 2 * GAP, 5));
        let shade = |x| frames[0].get_pixel(x, 4).0[0];
        let at = [0, 5, 6, 6 + GAP, 11 + GAP, 12 + GAP, 12 + 2 * GAP];
        let gap = GROUND.0[0];
        assert_eq!(at.map(shade), [10, 10, gap, 20, 20, gap, 30]);
        assert!(layout.variants().is_empty());
        assert_eq!(FrameLayout::Each(names).frames(pictures.clone()), pictures);
    }
}
