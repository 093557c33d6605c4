//! The frozen perceptual stack: 3×3 convolutions with relu and 2×2 max-pooling (VGG), forward,
//! and backward to the image only.
//!
//! Activations are channels-last with a border of one zero pixel, so that a convolution is three
//! matrix products over overlapping rows of the padded image: no patch matrix is ever built.

use super::product::{View, add_product};
use rayon::prelude::*;

/// One 3×3 convolution (zero padding, stride 1) with relu.
#[derive(Debug, Clone)]
pub struct ConvLayer {
    inputs: usize,
    outputs: usize,
    /// `[dy][dx][input][output]`.
    forward: Vec<f32>,
    /// `[2 − dy][2 − dx][output][input]`: the same filters as seen from the output.
    backward: Vec<f32>,
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
        let mut forward = vec![0.0; weight.len()];
        let mut backward = vec![0.0; weight.len()];
        for o in 0..outputs {
            for i in 0..inputs {
                for tap in 0..9 {
                    let w = weight[(o * inputs + i) * 9 + tap];
                    forward[(tap * inputs + i) * outputs + o] = w;
                    backward[((8 - tap) * outputs + o) * inputs + i] = w;
                }
            }
        }
        Self {
            inputs,
            outputs,
            forward,
            backward,
            bias,
            pool_before,
            statistics,
        }
    }
}

/// A channels-last image with a border of one zero pixel.
#[derive(Debug, Clone)]
struct Padded {
    height: usize,
    width: usize,
    channels: usize,
    data: Vec<f32>,
}

impl Padded {
    fn zeros(height: usize, width: usize, channels: usize) -> Self {
        Self {
            height,
            width,
            channels,
            data: vec![0.0; (height + 2) * (width + 2) * channels],
        }
    }

    /// Pads `image · scale − offset`; the border is zero, not `−offset`.
    fn from_image(image: &[f32], width: usize, scale: f32, offset: [f32; 3]) -> Self {
        let mut padded = Self::zeros(image.len() / (width * 3), width, 3);
        for (y, row) in image.chunks_exact(width * 3).enumerate() {
            let start = padded.at(y, 0);
            let target = &mut padded.data[start..start + row.len()];
            for (to, from) in target.chunks_exact_mut(3).zip(row.chunks_exact(3)) {
                for c in 0..3 {
                    to[c] = from[c] * scale - offset[c];
                }
            }
        }
        padded
    }

    fn at(&self, y: usize, x: usize) -> usize {
        ((y + 1) * (self.width + 2) + x + 1) * self.channels
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.data[self.at(y, 0)..][..self.width * self.channels]
    }

    fn pixels(&self) -> usize {
        self.height * self.width
    }

    fn clear_border(&mut self) {
        let stride = (self.width + 2) * self.channels;
        for row in self.data.chunks_exact_mut(stride) {
            row[..self.channels].fill(0.0);
            row[stride - self.channels..].fill(0.0);
        }
    }
}

/// Most pixels of one task of a convolution.
const TASK: usize = 512;
/// An image of fewer pixels is deep rather than wide: cut by output channels, not by pixels,
/// because every task would have to rearrange all the filters for itself.
const DEEP: usize = 1024;
/// Tasks of a convolution over a deep image.
const DEEP_TASKS: usize = 4;

/// `weight`: `[3][3 · inputs][outputs]`. Computes every pixel between the first and the last of
/// the image, border columns included (those are cleared afterwards).
fn convolve(input: &Padded, weight: &[f32], bias: Option<&[f32]>, outputs: usize) -> Padded {
    let mut out = Padded::zeros(input.height, input.width, outputs);
    let stride = input.width + 2;
    let first = stride + 1;
    let count = (input.height - 1) * stride + input.width;
    let target = &mut out.data[first * outputs..(first + count) * outputs];
    if count < DEEP && outputs >= 16 * DEEP_TASKS {
        convolve_deep(input, weight, bias, (first, count, outputs), target);
    } else {
        let task = TASK.min(count.div_ceil(4));
        target
            .par_chunks_mut(task * outputs)
            .enumerate()
            .for_each(|(i, target)| {
                let pixels = (first + i * task, target.len() / outputs);
                convolve_task(input, pixels, (weight, outputs), bias, target);
            });
    }
    out.clear_border();
    out
}

/// Pixels `start..start + count` for as many output channels as `target` has room for; `weight`
/// starts at the first of them and its rows are `row` long.
fn convolve_task(
    input: &Padded,
    (start, count): (usize, usize),
    (weight, row): (&[f32], usize),
    bias: Option<&[f32]>,
    target: &mut [f32],
) {
    let (inputs, stride) = (input.channels, input.width + 2);
    let channels = target.len() / count;
    if let Some(bias) = bias {
        for pixel in target.chunks_exact_mut(channels) {
            pixel.copy_from_slice(&bias[..channels]);
        }
    }
    for dy in 0..3 {
        let corner = (start + dy * stride - stride - 1) * inputs;
        add_product(
            target,
            View::strided(&input.data[corner..], (count, 3 * inputs), (inputs, 1)),
            View::strided(
                &weight[dy * 3 * inputs * row..],
                (3 * inputs, channels),
                (row, 1),
            ),
        );
    }
}

fn convolve_deep(
    input: &Padded,
    weight: &[f32],
    bias: Option<&[f32]>,
    (first, count, outputs): (usize, usize, usize),
    target: &mut [f32],
) {
    let width = outputs.div_ceil(DEEP_TASKS);
    let pieces: Vec<(usize, Vec<f32>)> = (0..outputs)
        .step_by(width)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|from| {
            let channels = width.min(outputs - from);
            let mut piece = vec![0.0; count * channels];
            let filters = (&weight[from..], outputs);
            convolve_task(
                input,
                (first, count),
                filters,
                bias.map(|b| &b[from..]),
                &mut piece,
            );
            (from, piece)
        })
        .collect();
    for (from, piece) in pieces {
        let channels = piece.len() / count;
        for (pixel, values) in target
            .chunks_exact_mut(outputs)
            .zip(piece.chunks_exact(channels))
        {
            pixel[from..from + channels].copy_from_slice(values);
        }
    }
}

fn relu(image: &mut Padded) {
    image.data.par_chunks_mut(1 << 14).for_each(|chunk| {
        for v in chunk {
            // Not `max`, which would turn NaN into 0 and hide a broken input.
            *v = if *v < 0.0 { 0.0 } else { *v };
        }
    });
}

fn pool(input: &Padded) -> Padded {
    let (channels, mut out) = (
        input.channels,
        Padded::zeros(input.height / 2, input.width / 2, input.channels),
    );
    for y in 0..out.height {
        let (top, bottom) = (input.row(2 * y), input.row(2 * y + 1));
        let start = out.at(y, 0);
        let width = out.width * channels;
        for (x, out) in out.data[start..start + width]
            .chunks_exact_mut(channels)
            .enumerate()
        {
            let at = 2 * x * channels;
            for (c, v) in out.iter_mut().enumerate() {
                let (a, b) = (
                    top[at + c].max(top[at + channels + c]),
                    bottom[at + c].max(bottom[at + channels + c]),
                );
                *v = a.max(b);
            }
        }
    }
    out
}

/// Hands each pooled gradient to the first of the (up to four) inputs that reached the maximum.
fn pool_backward(input: &Padded, pooled: &Padded, grad: &Padded) -> Padded {
    let channels = input.channels;
    let mut out = Padded::zeros(input.height, input.width, channels);
    for y in 0..grad.height {
        for x in 0..grad.width {
            let from = grad.at(y, x);
            let corners =
                [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| input.at(2 * y + dy, 2 * x + dx));
            for c in 0..channels {
                let winner = corners
                    .iter()
                    .find(|at| input.data[**at + c] == pooled.data[from + c]);
                if let Some(at) = winner {
                    out.data[at + c] = grad.data[from + c];
                }
            }
        }
    }
    out
}

/// Added to the variance under the root (PAPER §5).
const VARIANCE_EPS: f64 = 1e-5;

/// Appends mean and `sqrt(unbiased variance + 1e-5)` per channel.
fn push_statistics(image: &Padded, out: &mut Vec<f32>) {
    let (mean, std) = statistics(image);
    out.extend(mean.iter().map(|m| *m as f32));
    out.extend(std.iter().map(|s| *s as f32));
}

fn statistics(image: &Padded) -> (Vec<f64>, Vec<f64>) {
    let n = image.pixels() as f64;
    let mut mean = vec![0f64; image.channels];
    for y in 0..image.height {
        for pixel in image.row(y).chunks_exact(image.channels) {
            for (m, v) in mean.iter_mut().zip(pixel) {
                *m += f64::from(*v);
            }
        }
    }
    mean.iter_mut().for_each(|m| *m /= n);
    let mut std = vec![0f64; image.channels];
    for y in 0..image.height {
        for pixel in image.row(y).chunks_exact(image.channels) {
            for ((s, m), v) in std.iter_mut().zip(&mean).zip(pixel) {
                *s += (f64::from(*v) - m).powi(2);
            }
        }
    }
    // One pixel has no unbiased variance; it counts as none.
    let freedom = (n - 1.0).max(1.0);
    std.iter_mut()
        .for_each(|s| *s = (*s / freedom + VARIANCE_EPS).sqrt());
    (mean, std)
}

/// Adds the gradient of mean and deviation to `into`.
fn statistics_backward(image: &Padded, grad: &[f32], into: &mut Padded) {
    let channels = image.channels;
    let (mean, std) = statistics(image);
    let n = image.pixels() as f64;
    let freedom = (n - 1.0).max(1.0);
    let constant: Vec<f32> = grad[..channels]
        .iter()
        .map(|g| (f64::from(*g) / n) as f32)
        .collect();
    let slope: Vec<f32> = (0..channels)
        .map(|c| (f64::from(grad[channels + c]) / (freedom * std[c])) as f32)
        .collect();
    for y in 0..image.height {
        let start = into.at(y, 0);
        for (x, pixel) in image.row(y).chunks_exact(channels).enumerate() {
            let target = &mut into.data[start + x * channels..][..channels];
            for c in 0..channels {
                target[c] += constant[c] + slope[c] * (pixel[c] - mean[c] as f32);
            }
        }
    }
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
    /// If there is no layer or neighbouring widths differ.
    pub fn new(layers: Vec<ConvLayer>, input_scale: f32, input_offset: [f32; 3]) -> Self {
        let mut channels = 3;
        for layer in &layers {
            assert_eq!(
                layer.inputs, channels,
                "channels of neighbouring convolutions"
            );
            channels = layer.outputs;
        }
        assert!(!layers.is_empty(), "a perceptual stack has layers");
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
            .map(|l| l.outputs)
            .collect()
    }

    /// Length of the statistics part: mean and deviation of every such channel.
    pub fn statistics_len(&self) -> usize {
        2 * self.statistics_channels().iter().sum::<usize>()
    }

    /// Height, width and channels of the content feature of an image.
    pub fn content_shape(&self, height: usize, width: usize) -> [usize; 3] {
        let pools = self.layers.iter().filter(|l| l.pool_before).count();
        let channels = self.layers[self.layers.len() - 1].outputs;
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
        };
        let mut statistics = Vec::with_capacity(self.statistics_len());
        for layer in &self.layers {
            let pooled = layer
                .pool_before
                .then(|| pool(tape.outputs.last().unwrap_or(&current)));
            let input = pooled.as_ref().or(tape.outputs.last()).unwrap_or(&current);
            let mut out = convolve(input, &layer.forward, Some(&layer.bias), layer.outputs);
            relu(&mut out);
            if layer.statistics {
                push_statistics(&out, &mut statistics);
            }
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
            if layer.statistics {
                let (rest, own) = statistics.split_at(statistics.len() - 2 * layer.outputs);
                statistics_backward(out, own, &mut current);
                statistics = rest;
            }
            for (g, y) in current.data.iter_mut().zip(&out.data) {
                *g = if *y > 0.0 { *g } else { 0.0 };
            }
            current = convolve(&current, &layer.backward, None, layer.inputs);
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
