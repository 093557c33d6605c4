//! A tile of rows through all layers, its activations in shared memory.
//!
//! Activations lie channel by channel, rows in quads: what four neighbouring output channels of
//! four rows need of one input channel is one vector of it and one of the packed weights.

use super::plan::{PlannedLayer, RELU, SIGMOID, TileShape};
use crate::gpu::launch::UNITS;
use burn_cubecl::cubecl::{self, prelude::*};

/// Four rows' numbers of one channel, or four channels' weights.
pub(super) type Quad = Vector<f32, Const<4>>;

/// Added to the variance under the root of LayerNorm.
const NORM_EPS: f32 = 1e-5;

/// A tile's activations before and after a layer.
#[derive(CubeType)]
pub(super) struct Tile {
    pub(super) from: Shared<[Quad]>,
    pub(super) to: Shared<[Quad]>,
}

/// Room for a tile.
#[cube]
pub(super) fn new_tile(#[comptime] shape: TileShape) -> Tile {
    Tile {
        from: Shared::<[Quad]>::new_slice(comptime!(shape.room * shape.quads)),
        to: Shared::<[Quad]>::new_slice(comptime!(shape.room * shape.quads)),
    }
}

/// Reads `channels` channels of the tile's rows, zeros behind the last row.
#[cube]
pub(super) fn read_rows(
    source: &[f32],
    into: &mut Shared<[Quad]>,
    first_row: usize,
    rows: usize,
    channels: usize,
    #[comptime] quads: usize,
) {
    for i in range_stepped(UNIT_POS as usize, channels * quads, UNITS as usize) {
        let (channel, quad) = (i / quads, i % quads);
        let row = first_row + 4 * quad;
        let mut value = Quad::new(0.0);
        #[unroll]
        for r in 0..4usize {
            if row + r < rows {
                value.insert(r, source[(row + r) * channels + channel]);
            }
        }
        into[i] = value;
    }
}

/// Writes `channels` channels of the tile's rows, as far as there are rows.
#[cube]
pub(super) fn write_rows(
    from: &Shared<[Quad]>,
    target: &mut [f32],
    first_row: usize,
    rows: usize,
    channels: usize,
    #[comptime] quads: usize,
) {
    for i in range_stepped(UNIT_POS as usize, channels * quads, UNITS as usize) {
        let (channel, quad) = (i / quads, i % quads);
        let row = first_row + 4 * quad;
        let value = from[i];
        #[unroll]
        for r in 0..4usize {
            if row + r < rows {
                target[(row + r) * channels + channel] = value.extract(r);
            }
        }
    }
}

/// `to[o] = bias[o] + Σ_k weights[k][o] · from[k]`, four outputs and four rows a unit at a time.
/// `weights` is the first quad of `[k][o]`; without `biased`, sums start from zero.
#[cube]
pub(super) fn product(
    packed: &[Quad],
    from: &Shared<[Quad]>,
    to: &mut Shared<[Quad]>,
    weights: usize,
    bias: usize,
    inputs: usize,
    outputs: usize,
    #[comptime] biased: bool,
    #[comptime] quads: usize,
) {
    let output_quads = outputs.div_ceil(4);
    for i in range_stepped(UNIT_POS as usize, output_quads * quads, UNITS as usize) {
        let (o, q) = (i / quads, i % quads);
        let mut start = Quad::new(0.0);
        if biased {
            start = packed[bias + o];
        }
        let mut a = Quad::new(start.extract(0usize));
        let mut b = Quad::new(start.extract(1usize));
        let mut c = Quad::new(start.extract(2usize));
        let mut d = Quad::new(start.extract(3usize));
        for k in 0..inputs {
            let x = from[k * quads + q];
            let w = packed[weights + k * output_quads + o];
            a += x * Quad::new(w.extract(0usize));
            b += x * Quad::new(w.extract(1usize));
            c += x * Quad::new(w.extract(2usize));
            d += x * Quad::new(w.extract(3usize));
        }
        let at = 4 * o * quads + q;
        to[at] = a;
        to[at + quads] = b;
        to[at + 2 * quads] = c;
        to[at + 3 * quads] = d;
    }
}

/// `1` where a number is positive, `0` elsewhere.
#[cube]
pub(super) fn positive(x: Quad) -> Quad {
    select_many(
        x.greater_than(&Quad::new(0.0)),
        Quad::new(1.0),
        Quad::new(0.0),
    )
}

#[cube]
pub(super) fn activated(x: Quad, activation: u32) -> Quad {
    let mut result = x;
    if activation == RELU {
        result = x * positive(x);
    } else if activation == SIGMOID {
        result = Quad::new(1.0) / (Quad::new(1.0) + Quad::exp(-x));
    }
    result
}

/// Normalises the tile's rows over their channels, four rows a unit; what each row was divided by
/// goes to `kept`.
#[cube]
fn normalise(
    tile: &mut Shared<[Quad]>,
    kept: &mut [Quad],
    deviations: usize,
    channels: usize,
    #[comptime] keep: bool,
    #[comptime] quads: usize,
) {
    let quad = UNIT_POS as usize;
    if quad < quads {
        let n = Quad::new(f32::cast_from(channels));
        let mut mean = Quad::new(0.0);
        for c in 0..channels {
            mean += tile[c * quads + quad];
        }
        mean /= n;
        let mut variance = Quad::new(0.0);
        for c in 0..channels {
            let off = tile[c * quads + quad] - mean;
            variance += off * off;
        }
        let deviation = Quad::sqrt(variance / n + Quad::new(NORM_EPS));
        for c in 0..channels {
            let at = c * quads + quad;
            tile[at] = (tile[at] - mean) / deviation;
        }
        if keep {
            kept[deviations + quad] = deviation;
        }
    }
}

/// One layer: reads `tile.from`, leaves its result there. With `keep`, what the way back needs goes
/// to `kept`, from `kept_at` on: the layer's input, and its output, of normalised layers before
/// the activation.
#[cube]
pub(super) fn layer_forward(
    params: &[f32],
    packed: &[Quad],
    tile: &mut Tile,
    kept: &mut [Quad],
    kept_at: usize,
    layer: &PlannedLayer,
    #[comptime] keep: bool,
    #[comptime] shape: TileShape,
) {
    let quads = comptime!(shape.quads);
    let unit = UNIT_POS as usize;
    let to = kept_at + layer.kept_input * quads;
    for i in range_stepped(unit, layer.inputs * quads, UNITS as usize) {
        let mut value = tile.from[i];
        if layer.shift != 0 {
            value += Quad::new(params[layer.shift + i / quads]);
            tile.from[i] = value;
        }
        // A block's entry is needed again at its end.
        if keep || layer.shift != 0 {
            kept[to + i] = value;
        }
    }
    sync_cube();
    product(
        packed,
        &tile.from,
        &mut tile.to,
        layer.forward,
        layer.bias,
        layer.inputs,
        layer.outputs,
        true,
        quads,
    );
    sync_cube();
    let output = kept_at + layer.kept_output * quads;
    if layer.layer_norm {
        let deviations = output + layer.outputs * quads;
        normalise(&mut tile.to, kept, deviations, layer.outputs, keep, quads);
    }
    sync_cube();
    for i in range_stepped(unit, layer.outputs * quads, UNITS as usize) {
        let value = tile.to[i];
        let mut result = activated(value, layer.activation);
        if keep {
            kept[output + i] = select_many(Vector::new(layer.layer_norm), value, result);
        }
        if layer.entry != 0 {
            result += kept[kept_at + layer.entry * quads + i];
        }
        tile.from[i] = result;
    }
    sync_storage();
}
