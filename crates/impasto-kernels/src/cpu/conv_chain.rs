//! Chains of 3×3 convolutions over images of any number of channels: encoders and decoders of
//! two-dimensional style transfer, and the gradients with which decoders are trained.

use super::convolution::{ConvLayer, convolve, filter_gradient};
use super::padded::{FeatureMap, OddEnd, Padded, pool, pool_backward};
use rayon::prelude::*;

/// What happens to an image before a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resample {
    /// Nothing.
    Keep,
    /// 2×2 max-pooling; the last row and column of odd sizes are dropped.
    Halve,
    /// Every pixel becomes 2×2.
    Double,
}

/// A chain of 3×3 convolutions with relu, borders mirrored (PyTorch's `ReflectionPad2d(1)`).
#[derive(Debug, Clone)]
pub struct ConvChain {
    layers: Vec<(Resample, ConvLayer)>,
    /// Whether the last convolution is without relu.
    ends_linear: bool,
}

/// What [`ConvChain::taped`] keeps.
#[derive(Debug)]
pub struct ChainTape {
    image: Padded,
    /// Per layer what it saw, where that is not the layer before it.
    resampled: Vec<Option<Padded>>,
    /// Per layer, borders mirrored except the last one's.
    outputs: Vec<Padded>,
}

/// Gradient of one convolution.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterGradient {
    /// `[output][input][dy][dx]`, like [`ConvLayer::new`]'s weight.
    pub weight: Vec<f32>,
    /// One an output.
    pub bias: Vec<f32>,
}

impl ConvChain {
    /// Chains layers, each with what comes before it.
    ///
    /// # Panics
    /// If there is no layer, or neighbouring widths differ.
    pub fn new(layers: Vec<(Resample, ConvLayer)>) -> Self {
        assert!(!layers.is_empty(), "a chain has at least one convolution");
        for pair in layers.windows(2) {
            assert_eq!(
                pair[0].1.forward.outputs, pair[1].1.forward.inputs,
                "channels of neighbouring convolutions"
            );
        }
        Self {
            layers,
            ends_linear: false,
        }
    }

    /// The same chain without relu after its last convolution.
    #[must_use]
    pub fn ending_linear(mut self) -> Self {
        self.ends_linear = true;
        self
    }

    /// Channels of the image it takes.
    pub fn inputs(&self) -> usize {
        self.layers[0].1.forward.inputs
    }

    /// Smallest height and width of an image that every convolution can mirror.
    pub fn smallest(&self) -> usize {
        let (mut least, mut factor) = (2, 1.0f64);
        for (resample, _) in &self.layers {
            match resample {
                Resample::Keep => {}
                Resample::Halve => factor *= 2.0,
                Resample::Double => factor /= 2.0,
            }
            least = least.max((2.0 * factor).ceil() as usize);
        }
        least
    }

    /// Sends an image through all layers.
    ///
    /// # Panics
    /// If the image has other channels or is smaller than [`Self::smallest`].
    pub fn forward(&self, image: &FeatureMap) -> FeatureMap {
        let mut current = self.checked(image);
        for (i, (resample, layer)) in self.layers.iter().enumerate() {
            current = resampled(&current, *resample).unwrap_or(current);
            current.mirror_border();
            current = self.layer(i, layer, &current);
        }
        FeatureMap::of(&current)
    }

    /// [`Self::forward`], keeping what [`Self::backward`] needs.
    ///
    /// # Panics
    /// Like [`Self::forward`].
    pub fn taped(&self, image: &FeatureMap) -> (FeatureMap, ChainTape) {
        let mut image = self.checked(image);
        image.mirror_border();
        let mut tape = ChainTape {
            image,
            resampled: Vec::with_capacity(self.layers.len()),
            outputs: Vec::with_capacity(self.layers.len()),
        };
        for (i, (resample, layer)) in self.layers.iter().enumerate() {
            let mut other = resampled(tape.before(i), *resample);
            other.iter_mut().for_each(Padded::mirror_border);
            tape.resampled.push(other);
            let mut out = self.layer(i, layer, tape.seen(i));
            if i + 1 < self.layers.len() {
                out.mirror_border();
            }
            tape.outputs.push(out);
        }
        (FeatureMap::of(tape.before(self.layers.len())), tape)
    }

    /// Gradients of all convolutions, in their order. The image is a constant.
    ///
    /// # Shapes
    /// `grad`: like the result of [`Self::taped`].
    ///
    /// # Panics
    /// If the gradient has another shape, or the tape is of another chain.
    pub fn backward(&self, tape: &ChainTape, grad: &FeatureMap) -> Vec<FilterGradient> {
        let last = tape.before(self.layers.len());
        assert_eq!(
            [grad.height, grad.width, grad.channels, tape.outputs.len()],
            [last.height, last.width, last.channels, self.layers.len()],
            "gradient of a chain of convolutions"
        );
        let mut current = Padded::of(grad);
        let mut gradients = Vec::with_capacity(self.layers.len());
        for (i, (resample, layer)) in self.layers.iter().enumerate().rev() {
            if !(self.ends_linear && i + 1 == self.layers.len()) {
                current.back_through_relu(&tape.outputs[i]);
            }
            gradients.push(FilterGradient {
                weight: filter_gradient(tape.seen(i), &current),
                bias: sums(&current),
            });
            if i > 0 {
                // What falls on a mirrored border belongs to the pixels that it mirrors.
                let wide = convolve(&current.widened(), &layer.backward, None);
                let seen = wide.folded_back();
                current = match (resample, &tape.resampled[i]) {
                    (Resample::Halve, Some(pooled)) => pool_backward(tape.before(i), pooled, &seen),
                    (Resample::Double, _) => summed(&seen),
                    _ => seen,
                };
            }
        }
        gradients.reverse();
        gradients
    }

    fn checked(&self, image: &FeatureMap) -> Padded {
        assert_eq!(
            (image.channels, image.data.len()),
            (self.inputs(), image.height * image.width * image.channels),
            "image of a chain of convolutions"
        );
        assert!(
            image.height.min(image.width) >= self.smallest(),
            "image of a chain of convolutions is too small"
        );
        Padded::of(image)
    }

    fn layer(&self, index: usize, layer: &ConvLayer, input: &Padded) -> Padded {
        if !(self.ends_linear && index + 1 == self.layers.len()) {
            return convolve(input, &layer.forward, Some(&layer.bias));
        }
        let mut out = convolve(input, &layer.forward, None);
        out.par_rows_mut().for_each(|row| {
            for pixel in row.chunks_exact_mut(layer.bias.len()) {
                pixel.iter_mut().zip(&layer.bias).for_each(|(v, b)| *v += b);
            }
        });
        out
    }
}

impl ChainTape {
    /// What came before a layer, its own resampling not included.
    fn before(&self, layer: usize) -> &Padded {
        layer
            .checked_sub(1)
            .map_or(&self.image, |before| &self.outputs[before])
    }

    /// A layer's input.
    fn seen(&self, layer: usize) -> &Padded {
        self.resampled[layer]
            .as_ref()
            .unwrap_or_else(|| self.before(layer))
    }
}

/// Another image where resampling makes one.
fn resampled(image: &Padded, resample: Resample) -> Option<Padded> {
    match resample {
        Resample::Keep => None,
        Resample::Halve => Some(pool(image, OddEnd::Dropped)),
        Resample::Double => Some(doubled(image)),
    }
}

/// Sum over pixels of every channel.
fn sums(image: &Padded) -> Vec<f32> {
    let mut sums = vec![0.0f64; image.channels];
    for y in 0..image.height {
        for pixel in image.row(y).chunks_exact(image.channels) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                *sum += f64::from(*value);
            }
        }
    }
    sums.into_iter().map(|sum| sum as f32).collect()
}

fn doubled(image: &Padded) -> Padded {
    let channels = image.channels;
    let mut out = Padded::zeros(2 * image.height, 2 * image.width, channels);
    out.par_rows_mut().enumerate().for_each(|(y, row)| {
        let from = image.row(y / 2).chunks_exact(channels);
        for (pair, pixel) in row.chunks_exact_mut(2 * channels).zip(from) {
            pair[..channels].copy_from_slice(pixel);
            pair[channels..].copy_from_slice(pixel);
        }
    });
    out
}

/// Sums of 2×2 pixels: the transpose of [`doubled`].
fn summed(image: &Padded) -> Padded {
    let channels = image.channels;
    let mut out = Padded::zeros(image.height / 2, image.width / 2, channels);
    out.par_rows_mut().enumerate().for_each(|(y, row)| {
        for from in [image.row(2 * y), image.row(2 * y + 1)] {
            let pairs = from.chunks_exact(2 * channels);
            for (to, pair) in row.chunks_exact_mut(channels).zip(pairs) {
                let (left, right) = pair.split_at(channels);
                for c in 0..channels {
                    to[c] += left[c] + right[c];
                }
            }
        }
    });
    out
}
