//! 3×3 convolutions of channels-last images as one product of matrices, whose left one (what is
//! around each pixel) only ever exists piece by piece in shared memory.

use crate::gpu::launch::{argument, empty};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

type Quad = Vector<f32, Const<4>>;

/// Pixels and output channels of a cube, in quads, and input channels that it looks at together.
const PIXELS: usize = 8;
const OUTPUTS: usize = 8;
const DEPTH: usize = 16;
/// A unit computes four outputs of four pixels.
const UNITS: usize = PIXELS * OUTPUTS;

/// Sizes of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Size {
    pub(super) height: usize,
    pub(super) width: usize,
}

impl Size {
    pub(super) fn pixels(self) -> usize {
        self.height * self.width
    }
}

/// What a convolution does beside multiplying.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Mode {
    inputs: usize,
    outputs: usize,
    /// Pixels that the result has on each side beyond the input, behind whose border are zeros.
    wider: usize,
    /// Whether the input is mirrored at its border; zeros otherwise.
    mirrored: bool,
    /// Whether a bias and relu follow.
    relu: bool,
    /// Whether input counts only where `mask` is positive.
    masked: bool,
}

/// A coordinate of the input, `-1` where there is nothing.
#[cube]
fn source(at: i32, size: i32, #[comptime] mirrored: bool) -> i32 {
    let mut inside = at;
    if mirrored {
        if at < 0 {
            inside = -at;
        }
        if at >= size {
            inside = 2 * size - 2 - at;
        }
    } else if at >= size {
        inside = -1i32;
    }
    inside
}

/// A channel of the input at a place that may lie outside.
#[cube]
fn number_at(
    input: &[f32],
    mask: &[f32],
    y: i32,
    x: i32,
    channel: usize,
    height: u32,
    width: u32,
    #[comptime] mode: Mode,
) -> f32 {
    let y = source(y, height as i32, comptime!(mode.mirrored));
    let x = source(x, width as i32, comptime!(mode.mirrored));
    let mut number = 0.0f32;
    if y >= 0 && x >= 0 {
        let at = (y as usize * width as usize + x as usize) * comptime!(mode.inputs) + channel;
        if comptime!(mode.masked) {
            if mask[at] > 0.0 {
                number = input[at];
            }
        } else {
            number = input[at];
        }
    }
    number
}

/// Leaves in `around` what a tap sees of the cube's pixels, from input channel `first` on.
#[cube]
fn load_pixels(
    input: &[f32],
    mask: &[f32],
    around: &mut Shared<[Quad]>,
    first_pixel: usize,
    first: usize,
    tap: usize,
    height: u32,
    width: u32,
    #[comptime] mode: Mode,
) {
    let wide = width as usize + comptime!(2 * mode.wider);
    let pixels = wide * (height as usize + comptime!(2 * mode.wider));
    let dy = (tap / 3) as i32 - comptime!(mode.wider as i32 + 1);
    let dx = (tap % 3) as i32 - comptime!(mode.wider as i32 + 1);
    for i in range_stepped(UNIT_POS as usize, comptime!(DEPTH * PIXELS), UNITS) {
        let (channel, quad) = (first + i % DEPTH, i / DEPTH);
        let mut value = Quad::new(0.0);
        #[unroll]
        for p in 0..4usize {
            let pixel = first_pixel + 4 * quad + p;
            if pixel < pixels && channel < comptime!(mode.inputs) {
                let (y, x) = ((pixel / wide) as i32 + dy, (pixel % wide) as i32 + dx);
                let found = number_at(input, mask, y, x, channel, height, width, mode);
                value.insert(p, found);
            }
        }
        around[(i % DEPTH) * PIXELS + quad] = value;
    }
}

/// Leaves in `taken` a tap's filters of the cube's outputs, from input channel `first` on.
#[cube]
fn load_filters(
    filters: &[Quad],
    taken: &mut Shared<[Quad]>,
    first_output: usize,
    first: usize,
    tap: usize,
    #[comptime] mode: Mode,
) {
    let inputs = comptime!(mode.inputs);
    let output_quads = comptime!(mode.outputs.div_ceil(4));
    for i in range_stepped(UNIT_POS as usize, comptime!(DEPTH * OUTPUTS), UNITS) {
        let (channel, quad) = (first + i / OUTPUTS, first_output + i % OUTPUTS);
        let mut value = Quad::new(0.0);
        if channel < inputs && quad < output_quads {
            value = filters[(tap * inputs + channel) * output_quads + quad];
        }
        taken[i] = value;
    }
}

#[cube(launch_unchecked)]
fn convolve_kernel(
    input: &[f32],
    mask: &[f32],
    filters: &[Quad],
    bias: &[f32],
    out: &mut [f32],
    height: u32,
    width: u32,
    #[comptime] mode: Mode,
) {
    let inputs = comptime!(mode.inputs);
    let wide = width as usize + comptime!(2 * mode.wider);
    let pixels = wide * (height as usize + comptime!(2 * mode.wider));
    let first_pixel = CUBE_POS_X as usize * comptime!(4 * PIXELS);
    let first_output = CUBE_POS_Y as usize * OUTPUTS;
    let unit = UNIT_POS as usize;
    let mut around = Shared::<[Quad]>::new_slice(comptime!(DEPTH * PIXELS));
    let mut taken = Shared::<[Quad]>::new_slice(comptime!(DEPTH * OUTPUTS));
    let (own_pixel, own_output) = (unit / OUTPUTS, unit % OUTPUTS);
    let mut a = Quad::new(0.0);
    let mut b = Quad::new(0.0);
    let mut c = Quad::new(0.0);
    let mut d = Quad::new(0.0);
    for tap in 0..9usize {
        for first in range_stepped(0usize, inputs, DEPTH) {
            load_pixels(
                input,
                mask,
                &mut around,
                first_pixel,
                first,
                tap,
                height,
                width,
                mode,
            );
            load_filters(filters, &mut taken, first_output, first, tap, mode);
            sync_cube();
            for k in 0..DEPTH {
                let x = around[k * PIXELS + own_pixel];
                let w = taken[k * OUTPUTS + own_output];
                a += w * Quad::new(x.extract(0usize));
                b += w * Quad::new(x.extract(1usize));
                c += w * Quad::new(x.extract(2usize));
                d += w * Quad::new(x.extract(3usize));
            }
            sync_cube();
        }
    }
    let pixel = first_pixel + 4 * own_pixel;
    let output = 4 * (first_output + own_output);
    write_pixel(a, out, bias, pixel, pixels, output, mode);
    write_pixel(b, out, bias, pixel + 1, pixels, output, mode);
    write_pixel(c, out, bias, pixel + 2, pixels, output, mode);
    write_pixel(d, out, bias, pixel + 3, pixels, output, mode);
}

/// Writes four channels of a pixel, as far as there are both.
#[cube]
fn write_pixel(
    sums: Quad,
    out: &mut [f32],
    bias: &[f32],
    pixel: usize,
    pixels: usize,
    output: usize,
    #[comptime] mode: Mode,
) {
    let outputs = comptime!(mode.outputs);
    if pixel < pixels {
        #[unroll]
        for o in 0..4usize {
            if output + o < outputs {
                let mut value = sums.extract(o);
                if comptime!(mode.relu) {
                    value += bias[output + o];
                    // Written so that NaN stays NaN.
                    value = select(value < 0.0, 0.0f32, value);
                }
                out[pixel * outputs + output + o] = value;
            }
        }
    }
}

/// A convolution to be done.
pub(super) struct Convolution<'a> {
    pub(super) input: &'a CubeTensor,
    /// The input counts only where this is positive; everywhere without it.
    pub(super) mask: Option<&'a CubeTensor>,
    pub(super) filters: &'a CubeTensor,
    /// Added to the result, before relu; without it there is neither.
    pub(super) bias: Option<&'a CubeTensor>,
    /// Of the input.
    pub(super) size: Size,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// As of [`Mode`].
    pub(super) wider: usize,
    /// As of [`Mode`].
    pub(super) mirrored: bool,
}

/// The result of a convolution.
pub(super) fn convolve(of: &Convolution<'_>) -> CubeTensor {
    let (height, width) = (of.size.height + 2 * of.wider, of.size.width + 2 * of.wider);
    let out = empty(of.input, [height * width * of.outputs]);
    let cubes = |count: usize, of: usize| count.div_ceil(4 * of) as u32;
    // SAFETY: pixels and channels are looked at as far as there are any.
    unsafe {
        convolve_kernel::launch_unchecked(
            &of.input.client,
            CubeCount::new_2d(cubes(height * width, PIXELS), cubes(of.outputs, OUTPUTS)),
            CubeDim::new_1d(UNITS as u32),
            argument(of.input),
            argument(of.mask.unwrap_or(of.input)),
            argument(of.filters),
            argument(of.bias.unwrap_or(of.input)),
            argument(&out),
            of.size.height as u32,
            of.size.width as u32,
            Mode {
                inputs: of.inputs,
                outputs: of.outputs,
                wider: of.wider,
                mirrored: of.mirrored,
                relu: of.bias.is_some(),
                masked: of.mask.is_some(),
            },
        );
    }
    out
}
