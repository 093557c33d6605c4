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

use crate::consistency::{ByRange, Consistency};
use crate::resize::scaled;
use crate::strokes::StrokeResult;
use image::RgbImage;
use image::imageops::FilterType;
use impasto_model::{STYLE_SIDE, square_statistics};
use impasto_style::{Features, Perceptual, Statistics, StyleError, picture, square_crop};
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
    /// The painting that most of the other views are nearest to; the first of several. `None` if
    /// there are no others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub taken_for: Option<String>,
    /// Mean squared difference of relu4_1 to the unstylised render.
    pub content_loss: f64,
    /// Whether there are strokes of the painting's kind; `None` of unstylised renders.
    #[serde(flatten)]
    pub strokes: Option<StrokeResult>,
    /// Agreement of frames in this style, by exact flow; `None` without a path.
    #[serde(flatten)]
    pub consistency: Option<ByRange<Consistency>>,
    /// Gradient energy of the frames in this style, relative to the unstylised ones.
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

/// What views are measured against: paintings, and the unstylised renders.
pub(crate) struct FidelityMetric<'a> {
    pub(crate) vgg: &'a Perceptual,
    names: Vec<&'a str>,
    targets: Vec<Statistics>,
    /// Per view.
    plain: Vec<Features>,
}

impl<'a> FidelityMetric<'a> {
    pub(crate) fn new(
        vgg: &'a Perceptual,
        paintings: &'a [(String, RgbImage)],
        plain: &[RgbImage],
    ) -> Result<Self, StyleError> {
        let targets = paintings
            .iter()
            .map(|(_, p)| square_statistics(vgg, &square_crop(p, 1.0, (0.5, 0.5), STYLE_SIDE)));
        let plain = plain.iter().map(|view| features(vgg, view));
        Ok(Self {
            vgg,
            names: paintings.iter().map(|(name, _)| name.as_str()).collect(),
            targets: targets.collect::<Result<_, _>>()?,
            plain: plain.collect::<Result<_, _>>()?,
        })
    }

    /// Measures the views of one painting.
    pub(crate) fn of_views(
        &self,
        index: usize,
        views: &[RgbImage],
    ) -> Result<PaintingResult, StyleError> {
        let views = views.iter().map(|view| features(self.vgg, view));
        let views = views.collect::<Result<Vec<_>, _>>()?;
        Ok(self.of_features(index, &views))
    }

    /// Measures the unstylised views as if they were that painting's.
    pub(crate) fn of_unstylised(&self, index: usize) -> PaintingResult {
        self.of_features(index, &self.plain)
    }

    fn of_features(&self, index: usize, views: &[Features]) -> PaintingResult {
        // Style loss, style gain, retrieval and content loss.
        let mut sums = [0.0; 4];
        let target = &self.targets[index];
        let mut taken = vec![0; self.targets.len()];
        for (painted, plain) in views.iter().zip(&self.plain) {
            let loss = painted.statistics.distance(target);
            let others = self.targets.iter().enumerate().filter(|(i, _)| *i != index);
            let others = others.map(|(i, other)| (i, painted.statistics.distance(other)));
            let other = others
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .filter(|(_, other)| *other <= loss);
            if let Some((other, _)) = other {
                taken[other] += 1;
            }
            let content = painted.content.iter().zip(&plain.content);
            let content = content.map(|(a, b)| f64::from((a - b).powi(2)));
            let before = f64::from(plain.statistics.distance(target));
            let found = [
                f64::from(loss),
                1.0 - f64::from(loss) / before,
                f64::from(u8::from(other.is_none())),
                content.sum::<f64>() / plain.content.len() as f64,
            ];
            (0..4).for_each(|i| sums[i] += found[i]);
        }
        let count = views.len().max(1) as f64;
        let [style_loss, style_gain, retrieved, content_loss] = sums.map(|sum| sum / count);
        let most = taken.iter().copied().max().filter(|most| *most > 0);
        let most = most.and_then(|most| taken.iter().position(|count| *count == most));
        PaintingResult {
            name: self.names[index].to_owned(),
            style_loss,
            style_gain,
            retrieved,
            taken_for: most.map(|other| self.names[other].to_owned()),
            content_loss,
            strokes: None,
            consistency: None,
            sharpness: None,
        }
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

fn features(vgg: &Perceptual, image: &RgbImage) -> Result<Features, StyleError> {
    let (width, height) = image.dimensions();
    let scale = f64::from(STYLE_SIDE) / f64::from(width.min(height));
    let image = scaled(image, scale, FilterType::Triangle);
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    vgg.features(&picture(&image), height, width)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use image::Rgb;

    #[test]
    fn views_of_another_painting_are_taken_for_it() {
        let vgg = Perceptual::vgg16().unwrap();
        // Stripes of several widths, in several colours.
        let picture = |width: u32, colour: [u8; 3]| {
            RgbImage::from_fn(STYLE_SIDE, STYLE_SIDE, |x, _| match x / width % 2 {
                0 => Rgb(colour),
                _ => Rgb([20, 30, 40]),
            })
        };
        let names = ["red", "green", "blue"];
        let pictures = [
            picture(3, [230, 40, 30]),
            picture(9, [60, 210, 50]),
            picture(20, [70, 80, 240]),
        ];
        let paintings = names.map(str::to_owned).into_iter().zip(pictures.clone());
        let paintings: Vec<_> = paintings.collect();
        let plain = vec![picture(40, [200, 200, 200]); 4];
        let metric = FidelityMetric::new(&vgg, &paintings, &plain).unwrap();
        let of = |views: [usize; 4]| {
            let views = views.map(|i| pictures[i].clone());
            let found = metric.of_views(1, &views).unwrap();
            (found.retrieved, found.taken_for)
        };
        assert_eq!(of([1, 1, 1, 1]), (1.0, None));
        assert_eq!(of([0, 1, 2, 2]), (0.25, Some("blue".to_owned())));
        assert_eq!(
            of([2, 0, 1, 1]),
            (0.5, Some("red".to_owned())),
            "the first of several"
        );
    }
}
