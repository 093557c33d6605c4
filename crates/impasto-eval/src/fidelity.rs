//! How faithful a model's styles are: style gain and style retrieval on paintings.
//!
//! Definitions, with `S` the 1,920 normalised VGG-16 statistics and `d` their mean squared
//! difference (PAPER §8), pictures resampled so that the shorter side has 160 pixels, paintings
//! cut to their middle square:
//! - `style_loss = d(S(render), S(painting))`;
//! - `style_gain = 1 − style_loss / d(S(unstylised render), S(painting))`: 0 for no change, 1 for
//!   a perfect match, negative when the style was missed;
//! - retrieval: the share of (view, painting) pairs whose render is nearest to its own painting
//!   among all the paintings.

use image::RgbImage;
use image::imageops::{FilterType, resize};
use impasto_scene::Split;
use impasto_style::{Perceptual, StyleError, picture};
use impasto_train::{Look, Model, STYLE_SIDE, whole};
use serde::Serialize;

/// One painting's results, mean over views.
#[derive(Debug, Clone, Serialize)]
pub struct PaintingResult {
    /// Name of the painting.
    pub name: String,
    /// Style distance of the stylised renders.
    pub style_loss: f64,
    /// Share of the distance that stylising removed.
    pub style_gain: f64,
    /// Share of views that are nearest to this painting.
    pub retrieved: f64,
    /// Mean squared difference of relu4_1 to the unstylised render.
    pub content_loss: f64,
}

/// Style fidelity of a model.
#[derive(Debug, Clone, Serialize)]
pub struct StyleFidelity {
    /// Mean style distance.
    pub style_loss: f64,
    /// Mean style gain.
    pub style_gain: f64,
    /// Share of (view, painting) pairs nearest to their own painting.
    pub retrieval: f64,
    /// Mean content distance.
    pub content_loss: f64,
    /// Number of views.
    pub views: usize,
    /// Every painting.
    pub paintings: Vec<PaintingResult>,
}

/// Why an evaluation is impossible.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// The model has had no style stage.
    #[error("this model has had no style stage: train it with --stage style first")]
    Unstyled,
    /// There is no view or no painting to compare.
    #[error("there is nothing to evaluate: no held-out view or no painting")]
    Nothing,
    /// A picture or an asset is unusable.
    #[error(transparent)]
    Style(#[from] StyleError),
}

/// Measures how well a model paints its held-out views (or all, if none is held out) with the
/// given named paintings.
///
/// # Errors
/// If the model has no style stage, or there is nothing to compare.
pub fn style_fidelity(
    model: &Model,
    paintings: &[(String, RgbImage)],
) -> Result<StyleFidelity, EvalError> {
    let vgg = Perceptual::vgg16()?;
    let mut looks = vec![model.photo_look()];
    let mut targets = Vec::with_capacity(paintings.len());
    for (_, painting) in paintings {
        let inspiration = model.inspiration(painting)?;
        looks.push(model.look(&inspiration).ok_or(EvalError::Unstyled)?);
        targets.push(whole(&vgg, painting, STYLE_SIDE)?);
    }
    let photos = &model.file.scene.photos;
    let mut views: Vec<_> = photos.iter().filter(|p| p.split == Split::Test).collect();
    if views.is_empty() {
        views = photos.iter().collect();
    }
    if views.is_empty() || paintings.is_empty() {
        return Err(EvalError::Nothing);
    }
    let mut results: Vec<PaintingResult> = paintings
        .iter()
        .map(|(name, _)| PaintingResult::new(name))
        .collect();
    for photo in &views {
        let looks: Vec<&Look> = looks.iter().collect();
        let view = model.render(&photo.camera, &looks);
        let plain = features(&vgg, &view.image(0))?;
        for (i, (result, target)) in results.iter_mut().zip(&targets).enumerate() {
            let painted = features(&vgg, &view.image(i + 1))?;
            let loss = painted.statistics.distance(target);
            let mut others = targets.iter().enumerate().filter(|(j, _)| *j != i);
            let nearest = others.all(|(_, other)| painted.statistics.distance(other) > loss);
            let content = painted.content.iter().zip(&plain.content);
            result.style_loss += f64::from(loss);
            result.style_gain +=
                1.0 - f64::from(loss) / f64::from(plain.statistics.distance(target));
            result.retrieved += f64::from(u8::from(nearest));
            result.content_loss += content
                .map(|(a, b)| f64::from((a - b).powi(2)))
                .sum::<f64>()
                / plain.content.len() as f64;
        }
    }
    results
        .iter_mut()
        .for_each(|r| r.divide(views.len() as f64));
    let mean = |get: fn(&PaintingResult) -> f64| {
        results.iter().map(get).sum::<f64>() / results.len() as f64
    };
    Ok(StyleFidelity {
        style_loss: mean(|r| r.style_loss),
        style_gain: mean(|r| r.style_gain),
        retrieval: mean(|r| r.retrieved),
        content_loss: mean(|r| r.content_loss),
        views: views.len(),
        paintings: results,
    })
}

impl PaintingResult {
    fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            style_loss: 0.0,
            style_gain: 0.0,
            retrieved: 0.0,
            content_loss: 0.0,
        }
    }

    fn divide(&mut self, views: f64) {
        for value in [
            &mut self.style_loss,
            &mut self.style_gain,
            &mut self.retrieved,
            &mut self.content_loss,
        ] {
            *value /= views;
        }
    }
}

fn features(vgg: &Perceptual, image: &RgbImage) -> Result<impasto_style::Features, StyleError> {
    let (width, height) = image.dimensions();
    let scale = f64::from(STYLE_SIDE) / f64::from(width.min(height));
    let size = |side: u32| (f64::from(side) * scale).round() as u32;
    let image = resize(image, size(width), size(height), FilterType::Triangle);
    vgg.features(
        &picture(&image),
        image.height() as usize,
        image.width() as usize,
    )
}
