//! VGG features (Simonyan & Zisserman 2015), normalised as in Gatys et al. 2016: every filter is
//! rescaled so that its mean activation over photos and paintings is 1. VGG-16 is here, VGG-19 is
//! in [`crate::weights`].

use crate::{StyleError, TensorFile};
use burn::tensor::{Device, Tensor};
use impasto_kernels::{ConvLayer, FeatureMap, PerceptualStack, ops};
use std::sync::Arc;

pub(crate) const VGG16_FILE: &str = "vgg16_conv1_1_to_conv4_1_f16.safetensors";
const DIRECTIONS_FILE: &str = "vgg16_stroke_directions_f16.safetensors";
pub(crate) const MEANS_FILE: &str = "vgg16_mean_activations_f16.safetensors";
/// The shipped filters, see `assets/ATTRIBUTION.md`.
pub(crate) static VGG16: [u8; 5_832_976] =
    *include_bytes!("../../../assets/vgg16_conv1_1_to_conv4_1_f16.safetensors");
/// Mean activation of every filter, made by `examples/measure_activations.rs`.
pub(crate) static MEANS: [u8; 3_864] =
    *include_bytes!("../../../assets/vgg16_mean_activations_f16.safetensors");

/// Directions that most of the features of relu3_1 and of relu4_1 lie along, made by
/// `impasto-eval`'s `examples/stroke_directions.rs`.
static DIRECTIONS: [u8; 196_760] =
    *include_bytes!("../../../assets/vgg16_stroke_directions_f16.safetensors");

/// How many of those directions there are at each of the two layers.
pub const STROKE_DIRECTIONS: usize = 128;

/// Layer, whether a pool comes before it, whether its statistics are part of a style.
const LAYERS: [(&str, bool, bool); 8] = [
    ("conv1_1", false, true),
    ("conv1_2", false, false),
    ("conv2_1", true, true),
    ("conv2_2", false, false),
    ("conv3_1", true, true),
    ("conv3_2", false, false),
    ("conv3_3", false, false),
    ("conv4_1", true, true),
];
/// Filters that hardly fire would get absurd scales; on the 0–255 scale of VGG's inputs a mean
/// below this counts as this.
const LEAST_MEAN: f32 = 1.0;
/// ImageNet's mean colour on the 0–255 scale, RGB.
const MEAN_COLOUR: [f32; 3] = [123.68, 116.779, 103.939];

/// Mean and deviation per filter at relu1_1, relu2_1, relu3_1, relu4_1: 1,920 numbers,
/// `[mean₁, std₁, …, mean₄, std₄]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics(pub Vec<f32>);

impl Statistics {
    /// Length of every statistics vector.
    pub const LEN: usize = 2 * (64 + 128 + 256 + 512);

    /// Where each layer's means and each layer's deviations lie.
    pub fn parts() -> impl Iterator<Item = std::ops::Range<usize>> {
        let widths = [64, 128, 256, 512].into_iter();
        widths.flat_map(|w| [w, w]).scan(0, |end, width| {
            let start = *end;
            *end += width;
            Some(start..*end)
        })
    }

    /// As a tensor.
    pub fn tensor(&self, device: &Device) -> Tensor<1> {
        Tensor::from_data(self.0.as_slice(), device)
    }

    /// Mean squared difference over all numbers: the style loss (PAPER §8, reference form).
    pub fn distance(&self, other: &Self) -> f32 {
        self.0
            .iter()
            .zip(&other.0)
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f32>()
            / Self::LEN as f32
    }

    /// `self` and `other` mixed linearly, `share` of the latter.
    pub fn mixed(&self, other: &Self, share: f32) -> Self {
        Self(
            self.0
                .iter()
                .zip(&other.0)
                .map(|(a, b)| a + (b - a) * share)
                .collect(),
        )
    }
}

/// What the network says of one image.
#[derive(Debug, Clone)]
pub struct Features {
    /// relu4_1, channels-last.
    pub content: Vec<f32>,
    /// Style statistics.
    pub statistics: Statistics,
}

/// The perceptual network. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Perceptual {
    stack: Arc<PerceptualStack>,
}

impl Perceptual {
    /// The shipped, normalised VGG-16.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn vgg16() -> Result<Self, StyleError> {
        Ok(Self::of_stack(vgg16_stack(LAYERS.len())?))
    }

    /// A normalised stack whose statistics are those of [`Statistics`].
    pub(crate) fn of_stack(stack: PerceptualStack) -> Self {
        Self {
            stack: Arc::new(stack),
        }
    }

    /// Names of all layers with the stack of the layers up to each, statistics of the last one
    /// only: for measuring activations.
    ///
    /// # Errors
    /// If the asset is damaged.
    pub fn raw_prefixes() -> Result<Vec<(&'static str, PerceptualStack)>, StyleError> {
        let file = TensorFile::open(VGG16_FILE, &VGG16)?;
        let mut inputs = 3;
        let mut all = Vec::with_capacity(LAYERS.len());
        for (name, ..) in LAYERS {
            let (weight, bias) = filters(&file, name, inputs)?;
            inputs = bias.len();
            all.push((weight, bias));
        }
        let prefix = |count: usize| {
            let layers = LAYERS.iter().zip(&all).take(count).enumerate();
            let layers = layers.map(|(i, ((_, pool_before, _), (weight, bias)))| {
                ConvLayer::new(weight, bias.clone(), *pool_before, i + 1 == count)
            });
            let stack = PerceptualStack::new(layers.collect(), 255.0, MEAN_COLOUR);
            (LAYERS[count - 1].0, stack)
        };
        Ok((1..=LAYERS.len()).map(prefix).collect())
    }

    /// Numbers of the content feature of an image.
    pub fn content_len(&self, height: usize, width: usize) -> usize {
        self.stack.content_shape(height, width).iter().product()
    }

    /// Features of an image, `height × width × 3` in `[0, 1]`, without gradients.
    ///
    /// # Errors
    /// If a side has fewer than 8 pixels (VGG-19: 9).
    pub fn features(
        &self,
        image: &[f32],
        height: usize,
        width: usize,
    ) -> Result<Features, StyleError> {
        self.check(image, height, width)?;
        let mut content = self.stack.forward(image, height, width).0;
        let statistics = Statistics(content.split_off(self.content_len(height, width)));
        Ok(Features {
            content,
            statistics,
        })
    }

    /// How different two images look to the network: LPIPS' form (Zhang et al. 2018) without its
    /// learned weights. Not LPIPS, and not comparable with its values.
    ///
    /// At each of relu1_1, relu2_1, relu3_1 and relu4_1 the features of every pixel are scaled to
    /// unit length; the squared length of their difference is averaged over the pixels, and the
    /// layers are summed. From 0 to 8, for features are not negative; a pixel without features is
    /// the zero vector. Images are `height × width × 3` in `[0, 1]`.
    ///
    /// # Errors
    /// If a side has fewer than 8 pixels (VGG-19: 9).
    pub fn unweighted_distance(
        &self,
        [a, b]: [&[f32]; 2],
        height: usize,
        width: usize,
    ) -> Result<f64, StyleError> {
        self.check(a, height, width)?;
        self.check(b, height, width)?;
        let [a, b] = [a, b].map(|image| self.stack.forward(image, height, width).1);
        let layers = a.features().zip(b.features());
        Ok(layers.map(|(a, b)| direction_difference(&a, &b)).sum())
    }

    /// What the filters of relu1_1, relu2_1, relu3_1 and relu4_1 see in an image, `height × width ×
    /// 3` in `[0, 1]`.
    ///
    /// # Errors
    /// If a side has fewer than 8 pixels (VGG-19: 9).
    pub fn maps(
        &self,
        image: &[f32],
        height: usize,
        width: usize,
    ) -> Result<[FeatureMap; 4], StyleError> {
        self.check(image, height, width)?;
        let maps: Vec<FeatureMap> = self
            .stack
            .forward(image, height, width)
            .1
            .features()
            .collect();
        let maps = maps.try_into();
        Ok(maps.unwrap_or_else(|_| unreachable!("four layers have statistics")))
    }

    fn check(&self, image: &[f32], height: usize, width: usize) -> Result<(), StyleError> {
        // Of an image of another length than it says nothing can be seen.
        let whole = image.len() == height * width * 3;
        let height = if whole { height } else { 0 };
        check_size(&self.stack, height, width)
    }

    /// [`Perceptual::features`] of an image that stays where it is: content feature and statistics.
    ///
    /// # Shapes
    /// `image`: `[height, width, 3]`; results: one vector each.
    ///
    /// # Errors
    /// As of [`Perceptual::features`].
    pub fn features_of(&self, image: Tensor<3>) -> Result<[Tensor<1>; 2], StyleError> {
        let [height, width, _] = image.dims();
        check_size(&self.stack, height, width)?;
        let split = self.content_len(height, width);
        let all = self.traced(image);
        Ok([0..split, split..split + Statistics::LEN].map(|part| all.clone().slice(part)))
    }

    /// [`Perceptual::features`] in an autodiff graph: content feature, then statistics, as one vector.
    ///
    /// # Shapes
    /// `image`: `[height, width, 3]`, at least 8 pixels a side (VGG-19: 9).
    pub fn traced(&self, image: Tensor<3>) -> Tensor<1> {
        ops::perceptual(image, Arc::clone(&self.stack))
    }
}

/// The fixed directions along which features of rank-matched grey pictures vary most, at relu3_1 and
/// at relu4_1 of the shipped network: orthonormal rows, [`STROKE_DIRECTIONS`] of them, of as many
/// numbers as the layer has channels.
///
/// # Errors
/// If the asset is damaged.
pub fn stroke_directions() -> Result<[Vec<f32>; 2], StyleError> {
    let file = TensorFile::open(DIRECTIONS_FILE, &DIRECTIONS)?;
    let of = |name, channels| file.floats_of(name, STROKE_DIRECTIONS * channels);
    Ok([of("conv3_1", 256)?, of("conv4_1", 512)?])
}

/// Refuses images in which a convolution of the stack would see nothing.
pub(crate) fn check_size(
    stack: &PerceptualStack,
    height: usize,
    width: usize,
) -> Result<(), StyleError> {
    let least = stack.smallest();
    if height.min(width) < least {
        return Err(StyleError::TooSmall {
            width,
            height,
            least,
        });
    }
    Ok(())
}

/// The first `count` layers of the shipped, normalised VGG-16.
pub(crate) fn vgg16_stack(count: usize) -> Result<PerceptualStack, StyleError> {
    let means = TensorFile::open(MEANS_FILE, &MEANS)?;
    let file = TensorFile::open(VGG16_FILE, &VGG16)?;
    let mut inputs = vec![1.0f32; 3];
    let mut layers = Vec::with_capacity(count);
    for (name, pool_before, statistics) in LAYERS.into_iter().take(count) {
        let (mut weight, mut bias) = filters(&file, name, inputs.len())?;
        let mut scale = means.floats(name)?;
        scale.resize(bias.len(), 1.0);
        scale.iter_mut().for_each(|m| *m = m.max(LEAST_MEAN));
        rescale(&mut weight, &mut bias, &inputs, &scale);
        layers.push(ConvLayer::new(&weight, bias, pool_before, statistics));
        inputs = scale;
    }
    Ok(PerceptualStack::new(layers, 255.0, MEAN_COLOUR))
}

/// Weight and bias of a layer of VGG-16 that takes so many channels.
fn filters(
    file: &TensorFile<'_>,
    layer: &str,
    inputs: usize,
) -> Result<(Vec<f32>, Vec<f32>), StyleError> {
    let bias = file.floats(&format!("{layer}.bias"))?;
    let mut weight = file.floats_of(&format!("{layer}.weight"), bias.len() * inputs * 9)?;
    if layer == "conv1_1" {
        reverse_channels(&mut weight);
    }
    Ok((weight, bias))
}

/// Mean over pixels of the squared difference of their features' directions.
fn direction_difference(a: &FeatureMap, b: &FeatureMap) -> f64 {
    let unit = |pixel: &[f32]| {
        let square: f32 = pixel.iter().map(|v| v * v).sum();
        square.max(f32::MIN_POSITIVE).sqrt().recip()
    };
    let pixels = a.data.chunks_exact(a.channels);
    let pairs = pixels.zip(b.data.chunks_exact(b.channels));
    let squares = pairs.map(|(a, b)| {
        let (to_a, to_b) = (unit(a), unit(b));
        let squares = a.iter().zip(b).map(|(a, b)| (a * to_a - b * to_b).powi(2));
        f64::from(squares.sum::<f32>())
    });
    squares.sum::<f64>() / (a.height * a.width).max(1) as f64
}

/// Divides a layer's outputs by `scale`, when its inputs were divided by `inputs` before.
pub(crate) fn rescale(weight: &mut [f32], bias: &mut [f32], inputs: &[f32], scale: &[f32]) {
    for (o, filter) in weight.chunks_exact_mut(inputs.len() * 9).enumerate() {
        for (tap, w) in filter.iter_mut().enumerate() {
            *w *= inputs[tap / 9] / scale[o];
        }
        bias[o] /= scale[o];
    }
}

/// The stored filters take BGR; ours take RGB.
fn reverse_channels(weight: &mut [f32]) {
    for filter in weight.chunks_exact_mut(27) {
        for tap in 0..9 {
            filter.swap(tap, 18 + tap);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn the_unweighted_distance_compares_directions_of_features() {
        // Two layers that pass red and green on.
        let mut first = vec![0.0; 2 * 3 * 9];
        (first[4], first[3 * 9 + 9 + 4]) = (1.0, 1.0);
        let mut second = vec![0.0; 2 * 2 * 9];
        (second[4], second[2 * 9 + 9 + 4]) = (1.0, 1.0);
        let layers = vec![
            ConvLayer::new(&first, vec![0.0; 2], false, true),
            ConvLayer::new(&second, vec![0.0; 2], true, true),
        ];
        let network = Perceptual::of_stack(PerceptualStack::new(layers, 255.0, [0.0; 3]));
        let distance = |a: [f32; 3], b: [f32; 3]| {
            let [a, b] = [a, b].map(|colour| colour.repeat(4 * 6));
            network.unweighted_distance([&a, &b], 4, 6).unwrap()
        };
        let near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-6;
        let (red, green) = ([1.0, 0.0, 0.3], [0.0, 1.0, 0.9]);
        // Of each of the two layers.
        assert!(near(distance(red, green), 2.0 * 2.0));
        assert!(near(distance(red, [0.5, 0.0, 0.0]), 0.0));
        let yellow = 2.0 - 2.0 * 0.5f64.sqrt();
        assert!(near(distance(red, [0.7, 0.7, 0.0]), 2.0 * yellow));
        assert!(near(distance(red, [0.0; 3]), 2.0));
        assert!(network.unweighted_distance([&[0.0; 6]; 2], 1, 2).is_err());
    }

    #[test]
    fn the_unweighted_distance_grows_with_blur() {
        let vgg = Perceptual::vgg16().unwrap();
        let stripes = image::RgbImage::from_fn(40, 32, |x, y| {
            image::Rgb([(x * 53 % 200) as u8, (y * 37 % 180) as u8, 90])
        });
        let sharp = crate::picture(&stripes);
        let distance = |sigma: f32| {
            let soft = crate::picture(&image::imageops::blur(&stripes, sigma));
            let there = vgg.unweighted_distance([&sharp, &soft], 32, 40).unwrap();
            let back = vgg.unweighted_distance([&soft, &sharp], 32, 40).unwrap();
            assert!((there - back).abs() < 1e-6);
            there
        };
        let rising = [0.6, 1.0, 2.0].map(distance);
        assert!(
            rising.is_sorted_by(|a, b| a < b) && rising[0] > 0.01 && rising[2] < 8.0,
            "{rising:?}"
        );
        assert!(vgg.unweighted_distance([&sharp; 2], 32, 40).unwrap() < 1e-9);
    }
}
