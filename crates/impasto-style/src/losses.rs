//! Losses of the style stage (PAPER §8).

use crate::perceptual::Statistics;
use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// How a style loss sums up statistics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StyleReduction {
    /// One mean squared difference of all 1,920 numbers (the published implementation's): layers
    /// weigh by their width.
    Concatenated,
    /// The sum, over layers, of the Euclidean distances of means and of deviations (the paper's).
    Layers,
}

/// Added under a distance's root, which has no gradient at zero.
const LEAST_SQUARE: f32 = 1e-12;

/// Content and style loss of a traced feature vector.
///
/// Content: mean squared difference of relu4_1 to the photo's. Style: difference of the statistics
/// to the painting's, summed up by `reduction`.
///
/// # Shapes
/// `traced`: the result of [`crate::Perceptual::traced`]; `photo`: relu4_1 of the photo, a constant
/// of the same graph; results: one number each.
pub fn content_and_style(
    traced: &Tensor<1>,
    photo: &Tensor<1>,
    painting: &Statistics,
    reduction: StyleReduction,
) -> (Tensor<1>, Tensor<1>) {
    let device = traced.device();
    let [split] = photo.dims();
    let content = traced.clone().slice(0..split) - photo.clone();
    let style = traced.clone().slice(split..split + Statistics::LEN) - painting.tensor(&device);
    let style = match reduction {
        StyleReduction::Concatenated => style.square().mean(),
        StyleReduction::Layers => {
            let distances = Statistics::parts().map(|part| {
                let square = style.clone().slice(part).square().sum();
                (square + LEAST_SQUARE).sqrt()
            });
            Tensor::cat(distances.collect(), 0).sum()
        }
    };
    (content.square().mean(), style)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn reductions_weigh_layers_by_width_or_alike() {
        let photo = Tensor::zeros([4], &Device::flex().autodiff());
        let painting = Statistics(vec![0.0; Statistics::LEN]);
        let of = |first: usize, width: usize, reduction| {
            let mut numbers = vec![0.5; 4];
            numbers.resize(4 + Statistics::LEN, 0.0);
            numbers[4 + first..4 + first + width].fill(2.0);
            let traced = Tensor::from_data(numbers.as_slice(), &Device::flex().autodiff());
            let (content, style) =
                content_and_style(&traced.require_grad(), &photo, &painting, reduction);
            assert!((content.into_scalar::<f32>() - 0.25).abs() < 1e-6);
            style.into_scalar::<f32>()
        };
        // Means of relu1_1, deviations of relu4_1.
        for (first, width) in [(0, 64), (1920 - 512, 512)] {
            let mean = of(first, width, StyleReduction::Concatenated);
            assert!((mean - 4.0 * width as f32 / 1920.0).abs() < 1e-5);
            let distance = of(first, width, StyleReduction::Layers);
            assert!((distance - (4.0 * width as f32).sqrt()).abs() < 1e-3);
        }
    }
}
