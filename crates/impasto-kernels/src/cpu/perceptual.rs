//! The frozen perceptual stack: 3×3 convolutions with relu and 2×2 max-pooling (VGG), forward,
//! and backward to the image only.
//!
//! Activations are channels-last with a border of one zero pixel, so that a convolution is three
//! matrix products over overlapping rows of the padded image: no patch matrix is ever built.

use super::padded::{Padded, pool, pool_backward};
use super::product::{Left, Start, product};
use super::winograd::WinogradFilters;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// One 3×3 convolution (zero padding, stride 1) with relu.
#[derive(Debug, Clone)]
pub struct ConvLayer {
    forward: Filters,
    /// The same filters as seen from the output: turned by half a turn, inputs for outputs.
    backward: Filters,
    bias: Vec<f32>,
    /// Whether a 2×2 max-pool comes before this layer.
    pool_before: bool,
    /// Whether mean and deviation of this layer's output are part of the result.
    statistics: bool,
}

impl ConvLayer {
    /// Takes a weight in `[output][input][dy][dx]` order, as stored by common frameworks.
    ///
    /// # Panics
    /// If the lengths do not fit each other.
    pub fn new(weight: &[f32], bias: Vec<f32>, pool_before: bool, statistics: bool) -> Self {
        let outputs = bias.len();
        assert!(
            outputs > 0 && !weight.is_empty() && weight.len().is_multiple_of(outputs * 9),
            "a 3×3 convolution's weight is outputs × inputs × 9"
        );
        let inputs = weight.len() / (outputs * 9);
        let weight = |tap, i, o| weight[(o * inputs + i) * 9 + tap];
        Self {
            forward: Filters::new(inputs, outputs, weight),
            backward: Filters::new(outputs, inputs, |tap, o, i| weight(8 - tap, i, o)),
            bias,
            pool_before,
            statistics,
        }
    }
}

/// Output channels computed together: their filters for one pixel's neighbourhood stay in the
/// second-level cache while an image passes by.
const STRIP: usize = 64;

/// Filters of one direction, rearranged for [`convolve`]: per strip of output channels
/// `[dy][dx][input][output of the strip]`.
#[derive(Debug, Clone)]
struct Filters {
    inputs: usize,
    outputs: usize,
    strips: Vec<f32>,
    /// The same for images that are not small, where there are channels enough.
    winograd: Option<WinogradFilters>,
}

impl Filters {
    /// Filters whose weight for a tap, an input and an output is `weight(tap, input, output)`.
    fn new(inputs: usize, outputs: usize, weight: impl Fn(usize, usize, usize) -> f32) -> Self {
        let mut strips = Vec::with_capacity(9 * inputs * outputs);
        for first in (0..outputs).step_by(STRIP) {
            for tap in 0..9 {
                for input in 0..inputs {
                    let strip = first..(first + STRIP).min(outputs);
                    strips.extend(strip.map(|output| weight(tap, input, output)));
                }
            }
        }
        let wide = inputs.min(outputs) >= WINOGRAD_CHANNELS;
        Self {
            inputs,
            outputs,
            strips,
            winograd: wide.then(|| WinogradFilters::new(inputs, outputs, weight)),
        }
    }

    /// First channel, number of channels and filters of each strip.
    fn strips(&self) -> impl Iterator<Item = (usize, usize, &[f32])> {
        let strips = self.strips.chunks(9 * self.inputs * STRIP).enumerate();
        strips.map(|(i, strip)| (i * STRIP, strip.len() / (9 * self.inputs), strip))
    }
}

/// With fewer channels than this, transforming patches costs more than it saves.
const WINOGRAD_CHANNELS: usize = 32;
/// Most pixels of one task of a convolution.
const TASK: usize = 384;
/// An image of fewer pixels is deep rather than wide: cut by output channels, not by pixels,
/// because every task would have to fetch all the filters for itself.
const DEEP: usize = 192;

/// Computes every pixel between the first and the last of the image, border columns included
/// (those are cleared afterwards). With a bias, relu follows.
fn convolve(input: &Padded, filters: &Filters, bias: Option<&[f32]>) -> Padded {
    let outputs = filters.outputs;
    let mut out = Padded::zeros(input.height, input.width, outputs);
    let stride = input.width + 2;
    let first = stride + 1;
    let count = (input.height - 1) * stride + input.width;
    if let (Some(winograd), true) = (&filters.winograd, count >= DEEP) {
        winograd.convolve(input, bias, &mut out);
        return out;
    }
    let target = &mut out.data[first * outputs..(first + count) * outputs];
    if count < DEEP && outputs > STRIP {
        convolve_deep(input, filters, bias, (first, count), target);
    } else {
        let task = TASK.min(count.div_ceil(4).next_multiple_of(6));
        let tasks = target.par_chunks_mut(task * outputs).enumerate();
        tasks.for_each(|(i, target)| {
            for (channel, channels, filters) in filters.strips() {
                Arch::new().dispatch(Convolve {
                    input,
                    start: first + i * task,
                    filters,
                    bias: bias.map(|b| &b[channel..channel + channels]),
                    target: &mut target[channel..],
                    stride: outputs,
                    channels,
                });
            }
        });
    }
    out.clear_border();
    out
}

fn convolve_deep(
    input: &Padded,
    filters: &Filters,
    bias: Option<&[f32]>,
    (start, count): (usize, usize),
    target: &mut [f32],
) {
    let strips: Vec<_> = filters.strips().collect();
    let pieces: Vec<_> = strips
        .into_par_iter()
        .map(|(channel, channels, filters)| {
            let mut piece = vec![0.0; count * channels];
            Arch::new().dispatch(Convolve {
                input,
                start,
                filters,
                bias: bias.map(|b| &b[channel..channel + channels]),
                target: &mut piece,
                stride: channels,
                channels,
            });
            (channel, channels, piece)
        })
        .collect();
    for (channel, channels, piece) in pieces {
        let pixels = target.chunks_exact_mut(filters.outputs);
        for (pixel, values) in pixels.zip(piece.chunks_exact(channels)) {
            pixel[channel..channel + channels].copy_from_slice(values);
        }
    }
}

/// Pixels of one strip of channels: as many as `target` has, from pixel `start` on.
struct Convolve<'a> {
    input: &'a Padded,
    start: usize,
    filters: &'a [f32],
    bias: Option<&'a [f32]>,
    /// Pixels are `stride` apart.
    target: &'a mut [f32],
    stride: usize,
    channels: usize,
}

impl WithSimd for Convolve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (inputs, row) = (self.input.channels, self.input.width + 2);
        let count = self.target.len().div_ceil(self.stride);
        let corner = (self.start - row - 1) * inputs;
        let neighbourhoods = Left::overlapping(
            &self.input.data[corner..],
            (count, inputs),
            (3, row * inputs),
            3 * inputs,
        );
        let (stride, channels) = (self.stride, self.channels);
        let start = self.bias.map_or(Start::Zero, Start::Row);
        let target = (&mut *self.target, start, stride);
        product(simd, target, neighbourhoods, self.filters, channels);
        if self.bias.is_some() {
            for pixel in self.target.chunks_mut(stride) {
                for v in &mut pixel[..channels] {
                    // Not `max`, which would turn NaN into 0 and hide a broken input.
                    *v = if *v < 0.0 { 0.0 } else { *v };
                }
            }
        }
    }
}

/// Added to the variance under the root (PAPER §5).
const VARIANCE_EPS: f64 = 1e-5;

/// Mean and `sqrt(unbiased variance + 1e-5)` of each channel.
#[derive(Debug)]
struct Statistics {
    mean: Vec<f64>,
    std: Vec<f64>,
}

impl Statistics {
    fn of(image: &Padded) -> Self {
        let n = image.pixels() as f64;
        let mut mean = sum_of_pixels(image, |sum, pixel| {
            sum.iter_mut().zip(pixel).for_each(|(s, v)| *s += v);
        });
        mean.iter_mut().for_each(|m| *m /= n);
        let centre: Vec<f32> = mean.iter().map(|m| *m as f32).collect();
        let mut std = sum_of_pixels(image, |sum, pixel| {
            for ((s, m), v) in sum.iter_mut().zip(&centre).zip(pixel) {
                *s += (v - m) * (v - m);
            }
        });
        // One pixel has no unbiased variance; it counts as none.
        let freedom = (n - 1.0).max(1.0);
        std.iter_mut()
            .for_each(|s| *s = (*s / freedom + VARIANCE_EPS).sqrt());
        Self { mean, std }
    }

    /// Adds the gradient of both to `into`, where `grad` holds means first.
    fn backward(&self, image: &Padded, grad: &[f32], into: &mut Padded) {
        let channels = image.channels;
        let n = image.pixels() as f64;
        let freedom = (n - 1.0).max(1.0);
        let slope: Vec<f32> = (0..channels)
            .map(|c| (f64::from(grad[channels + c]) / (freedom * self.std[c])) as f32)
            .collect();
        let constant: Vec<f32> = (0..channels)
            .map(|c| (f64::from(grad[c]) / n - f64::from(slope[c]) * self.mean[c]) as f32)
            .collect();
        into.par_rows_mut().enumerate().for_each(|(y, into)| {
            let pixels = image.row(y).chunks_exact(channels);
            for (into, pixel) in into.chunks_exact_mut(channels).zip(pixels) {
                for c in 0..channels {
                    into[c] += constant[c] + slope[c] * pixel[c];
                }
            }
        });
    }
}

/// Per channel, what `add` sums up over all pixels: in single precision along a row, in double
/// precision over the rows.
fn sum_of_pixels(image: &Padded, add: impl Fn(&mut [f32], &[f32]) + Sync) -> Vec<f64> {
    let rows: Vec<Vec<f32>> = (0..image.height)
        .into_par_iter()
        .with_min_len(4)
        .map(|y| {
            let mut sum = vec![0.0; image.channels];
            for pixel in image.row(y).chunks_exact(image.channels) {
                add(&mut sum, pixel);
            }
            sum
        })
        .collect();
    let mut total = vec![0.0; image.channels];
    for row in rows {
        total
            .iter_mut()
            .zip(row)
            .for_each(|(t, r)| *t += f64::from(r));
    }
    total
}

/// A frozen stack of convolutions over an RGB image in `[0, 1]`.
#[derive(Debug, Clone)]
pub struct PerceptualStack {
    layers: Vec<ConvLayer>,
    input_scale: f32,
    input_offset: [f32; 3],
}

/// Activations kept from a forward pass.
#[derive(Debug)]
pub struct PerceptualTape {
    outputs: Vec<Padded>,
    pooled: Vec<Option<Padded>>,
    statistics: Vec<Option<Statistics>>,
}

impl PerceptualTape {
    /// Height and width of the image.
    pub fn image_size(&self) -> (usize, usize) {
        (self.outputs[0].height, self.outputs[0].width)
    }
}

impl PerceptualStack {
    /// Chains `layers`; the first takes RGB, the last one's output is the content feature.
    ///
    /// The first layer sees `image · input_scale − input_offset`, with zeros around it. An offset
    /// folded into the first bias would be wrong at the image's border.
    ///
    /// # Panics
    /// If there is no layer, the first one follows a pool, or neighbouring widths differ.
    pub fn new(layers: Vec<ConvLayer>, input_scale: f32, input_offset: [f32; 3]) -> Self {
        let mut channels = 3;
        for layer in &layers {
            assert_eq!(
                layer.forward.inputs, channels,
                "channels of neighbouring convolutions"
            );
            channels = layer.forward.outputs;
        }
        assert!(
            layers.first().is_some_and(|first| !first.pool_before),
            "a perceptual stack has layers, the first of which sees the image itself"
        );
        Self {
            layers,
            input_scale,
            input_offset,
        }
    }

    /// Smallest height and width that every pooling leaves at least one pixel of.
    pub fn smallest(&self) -> usize {
        1 << self.layers.iter().filter(|l| l.pool_before).count()
    }

    /// Channels of the layers that contribute statistics, in order.
    pub fn statistics_channels(&self) -> Vec<usize> {
        self.layers
            .iter()
            .filter(|l| l.statistics)
            .map(|l| l.forward.outputs)
            .collect()
    }

    /// Length of the statistics part: mean and deviation of every such channel.
    pub fn statistics_len(&self) -> usize {
        2 * self.statistics_channels().iter().sum::<usize>()
    }

    /// Height, width and channels of the content feature of an image.
    pub fn content_shape(&self, height: usize, width: usize) -> [usize; 3] {
        let pools = self.layers.iter().filter(|l| l.pool_before).count();
        let channels = self.layers[self.layers.len() - 1].forward.outputs;
        [height >> pools, width >> pools, channels]
    }

    /// Content feature (channels-last), then mean and deviation of each statistics layer in order
    /// (`[mean₁, std₁, mean₂, std₂, …]`).
    ///
    /// # Shapes
    /// `image`: `height × width × 3`; result: `content_shape` numbers plus `statistics_len`.
    ///
    /// # Panics
    /// If the image is smaller than [`PerceptualStack::smallest`] or the slice has another length.
    pub fn forward(
        &self,
        image: &[f32],
        height: usize,
        width: usize,
    ) -> (Vec<f32>, PerceptualTape) {
        assert_eq!(
            image.len(),
            height * width * 3,
            "image of a perceptual stack"
        );
        assert!(
            height.min(width) >= self.smallest(),
            "image of {width}×{height} is too small for the perceptual stack"
        );
        let mut current = Padded::from_image(image, width, self.input_scale, self.input_offset);
        let mut tape = PerceptualTape {
            outputs: Vec::with_capacity(self.layers.len()),
            pooled: Vec::with_capacity(self.layers.len()),
            statistics: Vec::with_capacity(self.layers.len()),
        };
        let mut statistics = Vec::with_capacity(self.statistics_len());
        for layer in &self.layers {
            let pooled = layer
                .pool_before
                .then(|| pool(tape.outputs.last().unwrap_or(&current)));
            let input = pooled.as_ref().or(tape.outputs.last()).unwrap_or(&current);
            let out = convolve(input, &layer.forward, Some(&layer.bias));
            tape.statistics.push(layer.statistics.then(|| {
                let own = Statistics::of(&out);
                statistics.extend(own.mean.iter().chain(&own.std).map(|x| *x as f32));
                own
            }));
            tape.pooled.push(pooled);
            tape.outputs.push(out);
            if tape.outputs.len() == 1 {
                current = Padded::zeros(1, 1, 1);
            }
        }
        let mut result = Vec::new();
        if let Some(last) = tape.outputs.last() {
            (0..last.height).for_each(|y| result.extend_from_slice(last.row(y)));
        }
        result.extend(statistics);
        (result, tape)
    }

    /// Gradient of [`PerceptualStack::forward`] for the image. The filters are constants.
    ///
    /// # Shapes
    /// `grad`: like the result of `forward`; result: `height × width × 3`.
    pub fn backward(&self, tape: &PerceptualTape, grad: &[f32]) -> Vec<f32> {
        let last = &tape.outputs[tape.outputs.len() - 1];
        let content = last.pixels() * last.channels;
        assert_eq!(
            grad.len(),
            content + self.statistics_len(),
            "gradient of a perceptual stack"
        );
        let mut current = Padded::zeros(last.height, last.width, last.channels);
        for (y, row) in grad[..content]
            .chunks_exact(last.width * last.channels)
            .enumerate()
        {
            let start = current.at(y, 0);
            current.data[start..start + row.len()].copy_from_slice(row);
        }
        let mut statistics = &grad[content..];
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let out = &tape.outputs[i];
            if let Some(of_layer) = &tape.statistics[i] {
                let (rest, own) = statistics.split_at(statistics.len() - 2 * out.channels);
                of_layer.backward(out, own, &mut current);
                statistics = rest;
            }
            current.par_rows_mut().enumerate().for_each(|(y, row)| {
                for (g, y) in row.iter_mut().zip(out.row(y)) {
                    *g = if *y > 0.0 { *g } else { 0.0 };
                }
            });
            current = convolve(&current, &layer.backward, None);
            if let (Some(pooled), true) = (&tape.pooled[i], i > 0) {
                current = pool_backward(&tape.outputs[i - 1], pooled, &current);
            }
        }
        let mut result = Vec::with_capacity(current.pixels() * 3);
        for y in 0..current.height {
            result.extend(current.row(y).iter().map(|g| g * self.input_scale));
        }
        result
    }
}
