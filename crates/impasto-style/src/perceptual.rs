//! VGG features (Simonyan & Zisserman 2015), normalised as in Gatys et al. 2016: every filter is
//! rescaled so that its mean activation over photos and paintings is 1. VGG-16 is here, VGG-19 is
//! in [`crate::weights`].

use crate::{StyleError, TensorFile};
use burn::tensor::Tensor;
use impasto_kernels::{ConvLayer, PerceptualStack, ops};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

pub(crate) const VGG16_FILE: &str = "vgg16_conv1_1_to_conv4_1_f16.safetensors";
pub(crate) const MEANS_FILE: &str = "vgg16_mean_activations_f16.safetensors";
/// The shipped filters, see `assets/ATTRIBUTION.md`.
pub(crate) const VGG16: &[u8] =
    include_bytes!("../../../assets/vgg16_conv1_1_to_conv4_1_f16.safetensors");
/// Mean activation of every filter, made by `examples/measure_activations.rs`.
pub(crate) const MEANS: &[u8] =
    include_bytes!("../../../assets/vgg16_mean_activations_f16.safetensors");

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

/// Which perceptual network: what styles and contents are measured with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Network {
    /// VGG-16, shipped.
    #[default]
    Vgg16,
    /// VGG-19 (the paper's), which users install.
    Vgg19,
}

impl Network {
    /// Reads its weights.
    ///
    /// # Errors
    /// If an asset is damaged, or VGG-19 is not installed.
    pub fn load(self) -> Result<Perceptual, StyleError> {
        match self {
            Self::Vgg16 => Perceptual::vgg16(),
            Self::Vgg19 => Perceptual::vgg19_installed(),
        }
    }

    /// The number in its name.
    pub(crate) fn number(self) -> f32 {
        match self {
            Self::Vgg16 => 16.0,
            Self::Vgg19 => 19.0,
        }
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "vgg{}", self.number())
    }
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
        let means = TensorFile::open(MEANS_FILE, MEANS)?;
        Self::with_means(|layer| means.floats(layer))
    }

    fn with_means(
        means: impl Fn(&str) -> Result<Vec<f32>, StyleError>,
    ) -> Result<Self, StyleError> {
        let file = TensorFile::open(VGG16_FILE, VGG16)?;
        let mut inputs = vec![1.0f32; 3];
        let mut layers = Vec::with_capacity(LAYERS.len());
        for (name, pool_before, statistics) in LAYERS {
            let mut bias = file.floats(&format!("{name}.bias"))?;
            let mut weight =
                file.floats_of(&format!("{name}.weight"), bias.len() * inputs.len() * 9)?;
            let mut scale = means(name)?;
            scale.resize(bias.len(), 1.0);
            scale.iter_mut().for_each(|m| *m = m.max(LEAST_MEAN));
            if name == "conv1_1" {
                reverse_channels(&mut weight);
            }
            rescale(&mut weight, &mut bias, &inputs, &scale);
            layers.push(ConvLayer::new(&weight, bias, pool_before, statistics));
            inputs = scale;
        }
        let stack = PerceptualStack::new(layers, 255.0, MEAN_COLOUR);
        Ok(Self::of_stack(stack))
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
        let file = TensorFile::open(VGG16_FILE, VGG16)?;
        (1..=LAYERS.len())
            .map(|count| {
                let layers = LAYERS[..count]
                    .iter()
                    .enumerate()
                    .map(|(i, (name, pool_before, _))| {
                        let mut weight = file.floats(&format!("{name}.weight"))?;
                        if i == 0 {
                            reverse_channels(&mut weight);
                        }
                        let bias = file.floats(&format!("{name}.bias"))?;
                        Ok(ConvLayer::new(&weight, bias, *pool_before, i + 1 == count))
                    })
                    .collect::<Result<Vec<_>, StyleError>>()?;
                Ok((
                    LAYERS[count - 1].0,
                    PerceptualStack::new(layers, 255.0, MEAN_COLOUR),
                ))
            })
            .collect()
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
        let least = self.stack.smallest();
        if height.min(width) < least || image.len() != height * width * 3 {
            return Err(StyleError::TooSmall {
                width,
                height,
                least,
            });
        }
        let mut content = self.stack.forward(image, height, width).0;
        let statistics = Statistics(content.split_off(self.content_len(height, width)));
        Ok(Features {
            content,
            statistics,
        })
    }

    /// The same in an autodiff graph: content feature, then statistics, as one vector.
    ///
    /// # Shapes
    /// `image`: `[height, width, 3]`, at least 8 pixels a side (VGG-19: 9).
    pub fn traced(&self, image: Tensor<3>) -> Tensor<1> {
        ops::perceptual(image, Arc::clone(&self.stack))
    }
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
