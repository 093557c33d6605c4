//! 3×3 convolutions of channels-last images with a border of one pixel, so that a convolution is
//! three matrix products over overlapping rows of the padded image: no patch matrix is ever built.

use super::padded::Padded;
use super::product::{Left, ProductTarget, Start, product};
use super::winograd::WinogradFilters;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// One 3×3 convolution (stride 1, as large as its input) with relu.
#[derive(Debug, Clone)]
pub struct ConvLayer {
    pub(crate) forward: Filters,
    /// The same filters as seen from the output: turned by half a turn, inputs for outputs.
    pub(crate) backward: Filters,
    pub(crate) bias: Vec<f32>,
    /// Whether a 2×2 max-pool comes before this layer.
    pub(crate) pool_before: bool,
    /// Whether mean and deviation of this layer's output are part of the result.
    pub(crate) statistics: bool,
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
pub(crate) struct Filters {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
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

    /// The weight of a tap, an input and an output.
    #[cfg(feature = "gpu")]
    pub(crate) fn weight(&self, tap: usize, input: usize, output: usize) -> f32 {
        let strip = &self.strips[output / STRIP * 9 * self.inputs * STRIP..];
        let channels = STRIP.min(self.outputs - output / STRIP * STRIP);
        strip[(tap * self.inputs + input) * channels + output % STRIP]
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
pub(crate) fn convolve(input: &Padded, filters: &Filters, bias: Option<&[f32]>) -> Padded {
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
        convolve_deep(input, filters, bias, first, target);
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
    start: usize,
    target: &mut [f32],
) {
    let count = target.len() / filters.outputs;
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
            count,
            inputs,
            3,
            row * inputs,
            3 * inputs,
        );
        let (stride, channels) = (self.stride, self.channels);
        let target = ProductTarget {
            out: &mut *self.target,
            start: self.bias.map_or(Start::Zero, Start::Row),
            width: channels,
            stride,
        };
        product(simd, target, neighbourhoods, self.filters);
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

/// Pixels of one product of [`filter_gradient`]: their gradients stay in the second-level cache.
const GRADIENT_PIXELS: usize = 256;

/// Gradient of a convolution's weight in `[output][input][dy][dx]` order: per tap, the shifted
/// input times the gradient of the output.
///
/// # Panics
/// If the images differ in size.
pub(crate) fn filter_gradient(input: &Padded, grad: &Padded) -> Vec<f32> {
    assert_eq!(
        (input.height, input.width),
        (grad.height, grad.width),
        "input of a convolution and gradient of its output"
    );
    let (inputs, outputs) = (input.channels, grad.channels);
    let taps: Vec<Vec<f32>> = (0..9)
        .into_par_iter()
        .map(|tap| Arch::new().dispatch(TapGradient { input, grad, tap }))
        .collect();
    let mut weight = vec![0.0; 9 * inputs * outputs];
    let filters = weight.par_chunks_mut(9 * inputs).enumerate();
    filters.for_each(|(o, filter)| {
        for (i, weight) in filter.iter_mut().enumerate() {
            *weight = taps[i % 9][i / 9 * outputs + o];
        }
    });
    weight
}

struct TapGradient<'a> {
    /// Border filled as the convolution saw it.
    input: &'a Padded,
    /// Border zero.
    grad: &'a Padded,
    tap: usize,
}

impl WithSimd for TapGradient<'_> {
    /// `inputs × outputs`.
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { input, grad, tap } = self;
        let (inputs, outputs) = (input.channels, grad.channels);
        let stride = grad.width + 2;
        // From the first pixel to the last, border columns between rows included: their gradient
        // is zero.
        let (first, count) = (stride + 1, (grad.height - 1) * stride + grad.width);
        let shifted = first - stride - 1 + tap / 3 * stride + tap % 3;
        let mut out = vec![0.0; inputs * outputs];
        for start in (0..count).step_by(GRADIENT_PIXELS) {
            let pixels = GRADIENT_PIXELS.min(count - start);
            let left = Left::transposed(&input.data[(shifted + start) * inputs..], pixels, inputs);
            let right = &grad.data[(first + start) * outputs..][..pixels * outputs];
            let target = ProductTarget::new(&mut out, Start::Sum, outputs);
            product(simd, target, left, right);
        }
        out
    }
}
