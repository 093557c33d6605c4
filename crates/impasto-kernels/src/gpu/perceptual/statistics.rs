//! Mean and deviation of every channel of an image: of chunks of its pixels first, then of all.

use super::convolution::Size;
use crate::gpu::launch::{argument, cube, cubes_for, empty};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

/// Added to the variance under the root (PAPER §5).
const VARIANCE_EPS: f32 = 1e-5;
/// Pixels of a chunk.
const CHUNK: usize = 64;

/// Mean and sum of squared differences from it, of one channel over a chunk: a unit each.
#[cube(launch_unchecked)]
fn chunk_kernel(
    image: &[f32],
    parts: &mut [f32],
    pixels: u32,
    count: u32,
    #[comptime] channels: usize,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let (channel, chunk) = (i % channels, i / channels);
        let first = chunk * CHUNK;
        let last = usize::min(first + CHUNK, pixels as usize);
        let mut mean = 0.0f32;
        for pixel in first..last {
            mean += image[pixel * channels + channel];
        }
        mean /= (last - first) as f32;
        let mut squares = 0.0f32;
        for pixel in first..last {
            let off = image[pixel * channels + channel] - mean;
            squares += off * off;
        }
        parts[i * 2] = mean;
        parts[i * 2 + 1] = squares;
    }
}

/// Joins the chunks of a channel (Chan et al. 1979), a unit each.
#[cube(launch_unchecked)]
fn join_kernel(
    parts: &[f32],
    out: &mut [f32],
    pixels: u32,
    chunks: u32,
    #[comptime] channels: usize,
) {
    let channel = ABSOLUTE_POS;
    if channel < channels {
        let mut count = 0.0f32;
        let mut mean = 0.0f32;
        let mut squares = 0.0f32;
        for chunk in 0..chunks as usize {
            let i = (chunk * channels + channel) * 2;
            let own = usize::min(CHUNK, pixels as usize - chunk * CHUNK) as f32;
            let apart = parts[i] - mean;
            let all = count + own;
            mean += apart * own / all;
            squares += parts[i + 1] + apart * apart * count * own / all;
            count = all;
        }
        out[channel] = mean;
        // One pixel has no unbiased variance; it counts as none.
        out[channels + channel] = f32::sqrt(squares / f32::max(count - 1.0, 1.0) + VARIANCE_EPS);
    }
}

/// Means, then `sqrt(unbiased variance + 1e-5)`, of each channel.
pub(super) fn of(image: &CubeTensor, size: Size, channels: usize) -> CubeTensor {
    let chunks = size.pixels().div_ceil(CHUNK);
    let parts = empty(image, [chunks * channels * 2]);
    let out = empty(image, [2 * channels]);
    // SAFETY: chunks end with the image.
    unsafe {
        chunk_kernel::launch_unchecked(
            &image.client,
            cubes_for(chunks * channels),
            cube(),
            argument(image),
            argument(&parts),
            size.pixels() as u32,
            (chunks * channels) as u32,
            channels,
        );
        join_kernel::launch_unchecked(
            &image.client,
            cubes_for(channels),
            cube(),
            argument(&parts),
            argument(&out),
            size.pixels() as u32,
            chunks as u32,
            channels,
        );
    }
    out
}

#[cube(launch_unchecked)]
fn backward_kernel(
    image: &[f32],
    own: &[f32],
    grad: &[f32],
    into: &mut [f32],
    grad_at: u32,
    pixels: f32,
    count: u32,
    #[comptime] channels: usize,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let channel = i % channels;
        let at = grad_at as usize + channel;
        let freedom = f32::max(pixels - 1.0, 1.0);
        let slope = grad[at + channels] / (freedom * own[channels + channel]);
        into[i] += grad[at] / pixels + slope * (image[i] - own[channel]);
    }
}

/// Adds the gradient of `own`, the statistics of `image`, to `into`; it begins at `grad_at`.
pub(super) fn backward(
    image: &CubeTensor,
    own: &CubeTensor,
    grad: &CubeTensor,
    grad_at: usize,
    into: &CubeTensor,
) {
    let count = image.meta.num_elements();
    let channels = own.meta.num_elements() / 2;
    // SAFETY: units look at their own number.
    unsafe {
        backward_kernel::launch_unchecked(
            &image.client,
            cubes_for(count),
            cube(),
            argument(image),
            argument(own),
            argument(grad),
            argument(into),
            grad_at as u32,
            (count / channels) as f32,
            count as u32,
            channels,
        );
    }
}
