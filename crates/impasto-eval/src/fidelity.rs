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

use crate::consistency::Consistency;
use image::RgbImage;
use image::imageops::{FilterType, resize};
use impasto_style::{Features, Perceptual, Statistics, StyleError, picture};
use impasto_train::{STYLE_SIDE, whole};
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
    /// Agreement of neighbouring frames in this style, by exact flow; `None` without a walk.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub short: Option<Consistency>,
    /// Agreement of frames seven apart.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub long: Option<Consistency>,
    /// Gradient energy of the walk's frames in this style, relative to the unstylised ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
}

/// Style fidelity of a method.
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

/// What views are judged by: paintings, and the unstylised renders.
pub(crate) struct Judge<'a> {
    vgg: &'a Perceptual,
    names: Vec<&'a str>,
    targets: Vec<Statistics>,
    /// Per view.
    plain: Vec<Features>,
}

impl<'a> Judge<'a> {
    pub(crate) fn new(
        vgg: &'a Perceptual,
        paintings: &'a [(String, RgbImage)],
        plain: &[RgbImage],
    ) -> Result<Self, StyleError> {
        let targets = paintings.iter().map(|(_, p)| whole(vgg, p, STYLE_SIDE));
        let plain = plain.iter().map(|view| features(vgg, view));
        Ok(Self {
            vgg,
            names: paintings.iter().map(|(name, _)| name.as_str()).collect(),
            targets: targets.collect::<Result<_, _>>()?,
            plain: plain.collect::<Result<_, _>>()?,
        })
    }

    /// Judges the views of one painting.
    pub(crate) fn painting(
        &self,
        index: usize,
        views: &[RgbImage],
    ) -> Result<PaintingResult, StyleError> {
        let views = views.iter().map(|view| features(self.vgg, view));
        let views = views.collect::<Result<Vec<_>, _>>()?;
        Ok(self.of_features(index, &views))
    }

    /// Judges the unstylised views as if they were that painting's.
    pub(crate) fn unstyled(&self, index: usize) -> PaintingResult {
        self.of_features(index, &self.plain)
    }

    fn of_features(&self, index: usize, views: &[Features]) -> PaintingResult {
        let mut result = PaintingResult::new(self.names[index]);
        let target = &self.targets[index];
        for (painted, plain) in views.iter().zip(&self.plain) {
            let loss = painted.statistics.distance(target);
            let others = self.targets.iter().enumerate().filter(|(i, _)| *i != index);
            let nearest = others
                .map(|(_, other)| painted.statistics.distance(other))
                .all(|other| other > loss);
            let content = painted.content.iter().zip(&plain.content);
            let content = content.map(|(a, b)| f64::from((a - b).powi(2)));
            let before = f64::from(plain.statistics.distance(target));
            result.style_loss += f64::from(loss);
            result.style_gain += 1.0 - f64::from(loss) / before;
            result.retrieved += f64::from(u8::from(nearest));
            result.content_loss += content.sum::<f64>() / plain.content.len() as f64;
        }
        result.divide(views.len().max(1) as f64);
        result
    }
}

impl StyleFidelity {
    /// Means over paintings.
    pub(crate) fn of(paintings: Vec<PaintingResult>, views: usize) -> Self {
        let mean = |get: fn(&PaintingResult) -> f64| {
            paintings.iter().map(get).sum::<f64>() / paintings.len().max(1) as f64
        };
        Self {
            style_loss: mean(|r| r.style_loss),
            style_gain: mean(|r| r.style_gain),
            retrieval: mean(|r| r.retrieved),
            content_loss: mean(|r| r.content_loss),
            views,
            paintings,
        }
    }
}

impl PaintingResult {
    fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            style_loss: 0.0,
            style_gain: 0.0,
            retrieved: 0.0,
            content_loss: 0.0,
            short: None,
            long: None,
            sharpness: None,
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

fn features(vgg: &Perceptual, image: &RgbImage) -> Result<Features, StyleError> {
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
