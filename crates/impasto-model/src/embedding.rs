//! What a painting becomes: statistics of its middle square, a style code, colour statistics.

use crate::color::ColorStatistics;
use crate::config::PictureConfig;
use crate::exemplar::mixed_exemplars;
use image::RgbImage;
use impasto_style::{Perceptual, Statistics, StyleCode, StyleError, picture, square_crop};
use std::sync::Arc;

/// A painting as models take it in.
#[derive(Debug, Clone)]
pub struct StyleEmbedding {
    /// The painting's style code.
    pub code: StyleCode,
    /// The painting's colours.
    pub colors: ColorStatistics,
    /// The painting's own detail, see [`exemplar`](crate::exemplar).
    pub exemplar: Arc<[f32]>,
}

impl StyleEmbedding {
    /// Between several paintings: the weighted mean; weights need not sum to one. `None` if their
    /// sum is not positive.
    pub fn mix(all: &[(Self, f32)]) -> Option<Self> {
        let codes: Vec<_> = all.iter().map(|(e, w)| (e.code.clone(), *w)).collect();
        let code = StyleCode::mix(&codes)?;
        let mut weighed = all.iter().filter(|(_, weight)| *weight > 0.0);
        let (first, weight) = weighed.next()?;
        let (colors, _) = weighed.fold((first.colors, *weight), |(colors, sum), (e, weight)| {
            let sum = sum + weight;
            (colors.mixed(&e.colors, weight / sum), sum)
        });
        Some(Self {
            code,
            colors,
            exemplar: mixed_exemplars(all.iter().map(|(e, w)| (&*e.exemplar, *w))).into(),
        })
    }
}

/// A picture with its palette taken out, so that its statistics tell of structure alone: whitened colours,
/// of a deviation of 0.17 about grey.
pub fn canonical(square: &RgbImage) -> RgbImage {
    let pixels = picture(square);
    let colors = ColorStatistics::of(pixels.chunks_exact(3));
    let white = colors.palette_of(&colors).whitened;
    let mut out = square.clone();
    for (pixel, colour) in out.pixels_mut().zip(pixels.chunks_exact(3)) {
        pixel.0 = white.map(|row| {
            let u = row[0] * colour[0] + row[1] * colour[1] + row[2] * colour[2] + row[3];
            ((u * CANONICAL_DEVIATION + 0.5).clamp(0.0, 1.0) * 255.0).round() as u8
        });
    }
    out
}

const CANONICAL_DEVIATION: f32 = 0.17;

/// Statistics of what stands for a painting whenever it is not training: its middle square, at
/// `side` pixels.
///
/// # Errors
/// Never for pictures of at least 1×1 pixel.
pub fn painting_statistics(
    vgg: &Perceptual,
    painting: &RgbImage,
    pictures: &PictureConfig,
) -> Result<Statistics, StyleError> {
    let square = square_crop(painting, 1.0, (0.5, 0.5), pictures.side);
    structure_statistics(vgg, &square, pictures)
}

/// Statistics that the code of a square picture is made of.
///
/// # Errors
/// Never for pictures of at least 1×1 pixel.
pub fn structure_statistics(
    vgg: &Perceptual,
    square: &RgbImage,
    pictures: &PictureConfig,
) -> Result<Statistics, StyleError> {
    match pictures.canonical {
        true => square_statistics(vgg, &canonical(square)),
        false => square_statistics(vgg, square),
    }
}

/// Statistics of a square picture.
///
/// # Errors
/// Never for pictures of at least 1×1 pixel.
pub fn square_statistics(vgg: &Perceptual, square: &RgbImage) -> Result<Statistics, StyleError> {
    let side = square.width() as usize;
    Ok(vgg.features(&picture(square), side, side)?.statistics)
}

#[cfg(test)]
mod tests {
    use super::*;
    use impasto_kernels::cpu::exemplar::PARAMS;

    #[test]
    fn a_canonical_picture_has_no_palette() {
        let square = RgbImage::from_fn(64, 64, |x, y| {
            image::Rgb([
                200 - 2 * x as u8,
                40 + 2 * y as u8,
                90 + (x as u8 ^ y as u8),
            ])
        });
        let found = picture(&canonical(&square));
        let numbers = ColorStatistics::of(found.chunks_exact(3)).numbers();
        for mean in &numbers[..3] {
            assert!((mean - 0.5).abs() < 0.02, "{numbers:?}");
        }
        let grey = f64::from(CANONICAL_DEVIATION).powi(2);
        for (i, own) in [
            (3, grey),
            (6, grey),
            (8, grey),
            (4, 0.0),
            (5, 0.0),
            (7, 0.0),
        ] {
            assert!((numbers[i] - own).abs() < 0.2 * grey, "{i}: {numbers:?}");
        }
    }

    #[test]
    fn mixed_embeddings_lie_between_by_weight() {
        let one = |number: f32| StyleEmbedding {
            code: StyleCode(vec![number; StyleCode::LEN]),
            colors: ColorStatistics::of([number; 6].chunks_exact(3)),
            exemplar: vec![number; PARAMS].into(),
        };
        let weighed = [(one(0.0), 1.0), (one(0.4), 2.0), (one(0.8), 1.0)];
        let mix = StyleEmbedding::mix(&weighed).map(|mix| (mix.code.0[3], mix.colors));
        let wanted = ColorStatistics::of([0.4f32; 6].chunks_exact(3));
        assert!(mix.is_some_and(|(code, colors)| {
            let pixels = colors.transfer_to(&wanted).apply(&[0.4, 0.4, 0.4]);
            (code - 0.4).abs() < 1e-6 && pixels.iter().all(|p| (p - 0.4).abs() < 1e-5)
        }));
        assert!(StyleEmbedding::mix(&[(one(0.1), 0.0)]).is_none());
        assert!(StyleEmbedding::mix(&[]).is_none());
    }
}
