//! A tile's gradients, layer by layer, last to first.

use super::forward::{Quad, Tile, activated, positive, product};
use super::plan::{PlannedLayer, RELU, SIGMOID, TileShape};
use crate::gpu::launch::UNITS;
use burn_cubecl::cubecl::{self, prelude::*};

/// Derivative of an activation, by its result.
#[cube]
fn slope(result: Quad, activation: u32) -> Quad {
    let mut slope = Quad::new(1.0);
    if activation == RELU {
        slope = positive(result);
    } else if activation == SIGMOID {
        slope = result * (Quad::new(1.0) - result);
    }
    slope
}

/// From the gradient of normalised rows to that of what was normalised, in place.
#[cube]
fn normalise_back(
    gradient: &mut Shared<[Quad]>,
    kept: &mut [Quad],
    output: usize,
    channels: usize,
    #[comptime] quads: usize,
) {
    let quad = UNIT_POS as usize;
    if quad < quads {
        let n = Quad::new(f32::cast_from(channels));
        let mut sum = Quad::new(0.0);
        let mut along = Quad::new(0.0);
        for c in 0..channels {
            let g = gradient[c * quads + quad];
            sum += g;
            along += g * kept[output + c * quads + quad];
        }
        let deviation = kept[output + channels * quads + quad];
        for c in 0..channels {
            let at = c * quads + quad;
            let normal = kept[output + at];
            gradient[at] = (gradient[at] - (sum + normal * along) / n) / deviation;
        }
    }
}

/// Adds what the tile's rows say of a layer's weights and biases. `gradient` is that of the affine
/// map's result. Every number has its one unit, so that sums have one order.
#[cube]
fn add_to_params(
    gradient: &Shared<[Quad]>,
    kept: &mut [Quad],
    input: usize,
    sums: &mut [f32],
    sums_at: usize,
    layer: &PlannedLayer,
    #[comptime] quads: usize,
) {
    let (inputs, outputs) = (layer.inputs, layer.outputs);
    let down = outputs.div_ceil(4);
    let weights = sums_at + layer.params;
    for i in range_stepped(UNIT_POS as usize, inputs * down, UNITS as usize) {
        let (o, k) = (4 * (i / inputs), i % inputs);
        let mut a = 0.0f32;
        let mut b = 0.0f32;
        let mut c = 0.0f32;
        let mut d = 0.0f32;
        for q in 0..quads {
            let x = kept[input + k * quads + q];
            a += x.dot(gradient[o * quads + q]);
            b += x.dot(gradient[(o + 1) * quads + q]);
            c += x.dot(gradient[(o + 2) * quads + q]);
            d += x.dot(gradient[(o + 3) * quads + q]);
        }
        let at = weights + o * inputs + k;
        sums[at] += a;
        if o + 1 < outputs {
            sums[at + inputs] += b;
        }
        if o + 2 < outputs {
            sums[at + 2 * inputs] += c;
        }
        if o + 3 < outputs {
            sums[at + 3 * inputs] += d;
        }
    }
    let biases = weights + inputs * outputs;
    for o in range_stepped(UNIT_POS as usize, outputs, UNITS as usize) {
        sums[biases + o] += row_sum(gradient, o, quads);
    }
}

/// Sum of a channel over the tile's rows.
#[cube]
fn row_sum(tile: &Shared<[Quad]>, channel: usize, #[comptime] quads: usize) -> f32 {
    let mut sum = Quad::new(0.0);
    for q in 0..quads {
        sum += tile[channel * quads + q];
    }
    sum.dot(Quad::new(1.0))
}

/// From the gradient of a layer's result to that of what its activation was applied to, in place.
#[cube]
fn activation_back(
    tile: &mut Tile,
    kept: &mut [Quad],
    output: usize,
    around: usize,
    layer: &PlannedLayer,
    #[comptime] quads: usize,
) {
    let count = 4 * layer.outputs.div_ceil(4) * quads;
    for i in range_stepped(UNIT_POS as usize, count, UNITS as usize) {
        let mut gradient = Quad::new(0.0);
        // Behind the last channel of a quad there is nothing.
        if i < layer.outputs * quads {
            gradient = tile.from[i];
            if layer.entry != 0 {
                kept[around + i] = gradient;
            }
            let mut result = kept[output + i];
            if layer.layer_norm {
                result = activated(result, layer.activation);
            }
            gradient *= slope(result, layer.activation);
        }
        tile.from[i] = gradient;
    }
}

/// One layer back: `tile.from` holds the gradient of the layer's result and, afterwards, that of
/// its input.
#[cube]
pub(super) fn layer_backward(
    packed: &[Quad],
    tile: &mut Tile,
    kept: &mut [Quad],
    kept_at: usize,
    sums: &mut [f32],
    sums_at: usize,
    layer: &PlannedLayer,
    #[comptime] shape: TileShape,
) {
    let quads = comptime!(shape.quads);
    let unit = UNIT_POS as usize;
    let output = kept_at + layer.kept_output * quads;
    let around = kept_at + comptime!(shape.around * quads);
    activation_back(tile, kept, output, around, layer, quads);
    sync_storage();
    if layer.layer_norm {
        normalise_back(&mut tile.from, kept, output, layer.outputs, quads);
    }
    sync_cube();
    let input = kept_at + layer.kept_input * quads;
    add_to_params(&tile.from, kept, input, sums, sums_at, layer, quads);
    product(
        packed,
        &tile.from,
        &mut tile.to,
        layer.backward,
        0usize,
        layer.outputs,
        layer.inputs,
        false,
        quads,
    );
    sync_cube();
    for i in range_stepped(unit, layer.inputs * quads, UNITS as usize) {
        let mut value = tile.to[i];
        if layer.shift != 0 {
            value += kept[around + i];
        }
        tile.from[i] = value;
    }
    sync_cube();
    if layer.shift != 0 {
        let shift = sums_at + layer.shift;
        for c in range_stepped(unit, layer.inputs, UNITS as usize) {
            sums[shift + c] += row_sum(&tile.from, c, quads);
        }
    }
    sync_cube();
}
