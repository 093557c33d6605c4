//! What happens to images between convolutions, one unit a number.

use super::convolution::Size;
use crate::gpu::launch::{argument, cube, cubes_for, empty};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

#[cube(launch_unchecked)]
fn pool_kernel(
    input: &[f32],
    out: &mut [f32],
    height: u32,
    width: u32,
    pooled_width: u32,
    count: u32,
    #[comptime] channels: usize,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let (channel, pixel) = (i % channels, i / channels);
        let (y, x) = (
            2 * (pixel / pooled_width as usize),
            2 * (pixel % pooled_width as usize),
        );
        // A row or column that stands for two is the first of them.
        let below = usize::min(y + 1, height as usize - 1);
        let beside = usize::min(x + 1, width as usize - 1);
        let width = width as usize;
        let a = input[(y * width + x) * channels + channel];
        let b = input[(y * width + beside) * channels + channel];
        let c = input[(below * width + x) * channels + channel];
        let d = input[(below * width + beside) * channels + channel];
        out[i] = f32::max(f32::max(a, b), f32::max(c, d));
    }
}

/// The largest of every 2×2 pixels.
pub(super) fn pool(input: &CubeTensor, from: Size, to: Size, channels: usize) -> CubeTensor {
    let count = to.pixels() * channels;
    let out = empty(input, [count]);
    // SAFETY: units look at pixels inside the input only.
    unsafe {
        pool_kernel::launch_unchecked(
            &input.client,
            cubes_for(count),
            cube(),
            argument(input),
            argument(&out),
            from.height as u32,
            from.width as u32,
            to.width as u32,
            count as u32,
            channels,
        );
    }
    out
}

#[cube(launch_unchecked)]
fn pool_backward_kernel(
    input: &[f32],
    pooled: &[f32],
    grad: &[f32],
    out: &mut [f32],
    width: u32,
    pooled_height: u32,
    pooled_width: u32,
    count: u32,
    #[comptime] channels: usize,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let width = width as usize;
        let (channel, pixel) = (i % channels, i / channels);
        let (y, x) = (pixel / width, pixel % width);
        let (py, px) = (y / 2, x / 2);
        let mut value = 0.0f32;
        if py < pooled_height as usize && px < pooled_width as usize {
            let cell = (py * pooled_width as usize + px) * channels + channel;
            let largest = pooled[cell];
            // The first of the (up to four) inputs that reached the maximum has the gradient.
            let mut wins = input[i] == largest;
            let top = ((2 * py) * width + 2 * px) * channels + channel;
            if wins && x % 2 == 1 {
                wins = input[i - channels] != largest;
            }
            if wins && y % 2 == 1 {
                wins = input[top] != largest;
                if wins && 2 * px + 1 < width {
                    wins = input[top + channels] != largest;
                }
            }
            if wins {
                value = grad[cell];
            }
        }
        out[i] = value;
    }
}

/// Hands each pooled gradient to the first of the inputs that reached the maximum. Sizes are those
/// of the input and of what is pooled.
pub(super) fn pool_backward(
    input: &CubeTensor,
    pooled: &CubeTensor,
    grad: &CubeTensor,
    [from, to]: [Size; 2],
    channels: usize,
) -> CubeTensor {
    let count = from.pixels() * channels;
    let out = empty(input, [count]);
    // SAFETY: as of `pool`.
    unsafe {
        pool_backward_kernel::launch_unchecked(
            &input.client,
            cubes_for(count),
            cube(),
            argument(input),
            argument(pooled),
            argument(grad),
            argument(&out),
            from.width as u32,
            to.height as u32,
            to.width as u32,
            count as u32,
            channels,
        );
    }
    out
}

/// The rows or columns of a widened image that belong to one of the image: its own, and the outer
/// ones where they mirror it. `-1` stands for none.
#[cube]
fn mirrors(at: usize, size: usize) -> (i32, i32) {
    let low = select(at == 1, 0i32, -1i32);
    let high = select(at + 2 == size, size as i32 + 1, -1i32);
    (low, high)
}

#[cube(launch_unchecked)]
fn fold_kernel(
    wide: &[f32],
    out: &mut [f32],
    height: u32,
    width: u32,
    count: u32,
    #[comptime] channels: usize,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let (height, width) = (height as usize, width as usize);
        let (channel, pixel) = (i % channels, i / channels);
        let (y, x) = (pixel / width, pixel % width);
        let (above, under) = mirrors(y, height);
        let (left, right) = mirrors(x, width);
        let mut sum = 0.0f32;
        #[unroll]
        for dy in 0..3usize {
            #[unroll]
            for dx in 0..3usize {
                let row = match dy {
                    0 => y as i32 + 1,
                    1 => above,
                    _ => under,
                };
                let column = match dx {
                    0 => x as i32 + 1,
                    1 => left,
                    _ => right,
                };
                if row >= 0 && column >= 0 {
                    sum +=
                        wide[(row as usize * (width + 2) + column as usize) * channels + channel];
                }
            }
        }
        out[i] = sum;
    }
}

/// What is left when a widened image's outermost pixels are added to those that they mirror.
pub(super) fn fold(wide: &CubeTensor, size: Size, channels: usize) -> CubeTensor {
    let count = size.pixels() * channels;
    let out = empty(wide, [count]);
    // SAFETY: the widened image has two rows and columns more.
    unsafe {
        fold_kernel::launch_unchecked(
            &wide.client,
            cubes_for(count),
            cube(),
            argument(wide),
            argument(&out),
            size.height as u32,
            size.width as u32,
            count as u32,
            channels,
        );
    }
    out
}

#[cube(launch_unchecked)]
fn input_kernel(image: &[f32], offset: &[f32], out: &mut [f32], scale: f32, count: u32) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        out[i] = image[i] * scale - offset[i % 3];
    }
}

/// What the first layer sees of an RGB image.
pub(super) fn input(image: &CubeTensor, scale: f32, offset: &CubeTensor) -> CubeTensor {
    let count = image.meta.num_elements();
    let out = empty(image, [count]);
    // SAFETY: units look at their own number.
    unsafe {
        input_kernel::launch_unchecked(
            &image.client,
            cubes_for(count),
            cube(),
            argument(image),
            argument(offset),
            argument(&out),
            scale,
            count as u32,
        );
    }
    out
}
