//! Chains of 3×3 convolutions over images of any number of channels, forward only: encoders and
//! decoders of two-dimensional style transfer.

use super::convolution::{ConvLayer, convolve};
use super::padded::{Padded, pool};
use super::perceptual::OddEnd;
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
}

/// A channels-last image.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureMap {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Numbers a pixel.
    pub channels: usize,
    /// `height × width × channels`.
    pub data: Vec<f32>,
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
        Self { layers }
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
        assert_eq!(
            (image.channels, image.data.len()),
            (self.inputs(), image.height * image.width * image.channels),
            "image of a chain of convolutions"
        );
        assert!(
            image.height.min(image.width) >= self.smallest(),
            "image of a chain of convolutions is too small"
        );
        let mut current = padded(image);
        for (resample, layer) in &self.layers {
            current = match resample {
                Resample::Keep => current,
                Resample::Halve => pool(&current, OddEnd::Dropped),
                Resample::Double => doubled(&current),
            };
            current.mirror_border();
            current = convolve(&current, &layer.forward, Some(&layer.bias));
        }
        let rows = (0..current.height).flat_map(|y| current.row(y));
        FeatureMap {
            height: current.height,
            width: current.width,
            channels: current.channels,
            data: rows.copied().collect(),
        }
    }
}

fn padded(image: &FeatureMap) -> Padded {
    let mut padded = Padded::zeros(image.height, image.width, image.channels);
    let rows = image.data.par_chunks_exact(image.width * image.channels);
    padded
        .par_rows_mut()
        .zip(rows)
        .for_each(|(to, from)| to.copy_from_slice(from));
    padded
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
