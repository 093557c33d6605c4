//! How an MLP is laid out for the kernels, which read its layers from a table: one compiled kernel
//! serves every MLP of a width.

use crate::{Activation, MlpSpec};
use burn_cubecl::cubecl::{self, prelude::*};

/// Numbers of activations that a cube keeps at most, of one layer. Twice that is the memory that
/// WebGPU promises every cube, 16 KiB.
const KEPT: usize = 2048;

/// Numbers of a layer in the table.
pub(super) const FIELDS: usize = 12;

pub(super) const LINEAR: u32 = 0;
pub(super) const RELU: u32 = 1;
pub(super) const SIGMOID: u32 = 2;

/// An MLP and how its rows are cut into tiles. Weights and biases are packed in quads of
/// neighbouring channels.
#[derive(Debug, Clone)]
pub(super) struct TilePlan {
    /// [`FIELDS`] numbers a layer, see [`PlannedLayer`].
    pub(super) table: Vec<u32>,
    pub(super) layers: usize,
    pub(super) params: usize,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// Quads of packed parameters.
    pub(super) packed: usize,
    pub(super) shape: TileShape,
}

/// What a kernel must know while it is compiled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct TileShape {
    /// Quads of rows in a tile.
    pub(super) quads: usize,
    /// Channels that a tile has room for.
    pub(super) room: usize,
    /// Channels that a cube keeps of a tile for the way back: of all inputs and outputs, of the
    /// deviations of normalised layers, and of the gradient that goes around residual blocks.
    pub(super) kept: usize,
    /// First kept channel of the gradient that goes around a block.
    pub(super) around: usize,
}

impl TileShape {
    /// Rows of a tile.
    pub(super) fn rows(&self) -> usize {
        4 * self.quads
    }
}

impl TilePlan {
    pub(super) fn of(spec: &MlpSpec) -> Self {
        let (mut packed, mut kept) = (0, 0);
        let take = |counter: &mut usize, count: usize| {
            *counter += count;
            *counter - count
        };
        let widths = spec.layers().iter().map(|l| l.inputs.max(l.outputs));
        // Powers of two, so that few kernels serve many MLPs.
        let room = widths.max().unwrap_or(4).next_power_of_two().max(16);
        let mut inputs_at = Vec::new();
        let mut table = Vec::new();
        for (l, layer) in spec.layers().iter().enumerate() {
            let (input_quads, output_quads) = (layer.inputs.div_ceil(4), layer.outputs.div_ceil(4));
            let kept_input = take(&mut kept, layer.inputs);
            inputs_at.push(kept_input);
            let activation = match layer.activation {
                Activation::Linear => LINEAR,
                Activation::Relu => RELU,
                Activation::Sigmoid => SIGMOID,
            };
            let shift = spec
                .block_from(l)
                .map(|block| spec.shift_range(block).start);
            let entry = spec
                .block_to(l)
                .map(|block| inputs_at[spec.blocks()[block].start]);
            // Zero stands for none: a block is never the first layer.
            let fields = [
                layer.inputs,
                layer.outputs,
                activation as usize,
                usize::from(layer.layer_norm),
                spec.layer_range(l).start,
                take(&mut packed, layer.inputs * output_quads),
                take(&mut packed, output_quads),
                take(&mut packed, layer.outputs * input_quads),
                shift.unwrap_or(0),
                entry.unwrap_or(0),
                kept_input,
                // Behind the output, what its rows were divided by.
                take(&mut kept, layer.outputs + 1),
            ];
            table.extend(fields.map(|field| field as u32));
        }
        let around = take(&mut kept, room);
        Self {
            table,
            layers: spec.layers().len(),
            params: spec.params(),
            inputs: spec.inputs(),
            outputs: spec.outputs(),
            packed,
            shape: TileShape {
                quads: (KEPT / room / 4).clamp(1, 16),
                room,
                kept,
                around,
            },
        }
    }

    /// Whether a tile of four rows has room.
    pub(super) fn fits(&self) -> bool {
        4 * self.shape.room <= KEPT
    }

    /// Tiles of so many rows.
    pub(super) fn tiles(&self, rows: usize) -> usize {
        rows.div_ceil(self.shape.rows())
    }

    /// Numbers that so many cubes keep.
    pub(super) fn kept(&self, cubes: usize) -> usize {
        4 * cubes * self.shape.kept * self.shape.quads
    }
}

/// One layer of the table.
#[derive(CubeType, Clone, Copy)]
pub(super) struct PlannedLayer {
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) activation: u32,
    pub(super) layer_norm: bool,
    /// Where its parameters lie.
    pub(super) params: usize,
    /// First quad of its weights as `[input][output]`, of its biases, and of its weights as
    /// `[output][input]`.
    pub(super) forward: usize,
    pub(super) bias: usize,
    pub(super) backward: usize,
    /// Where the vector of the residual block that begins here lies; 0 for none.
    pub(super) shift: usize,
    /// What was kept of the input of the first layer of the block that ends here; 0 for none.
    pub(super) entry: usize,
    /// First channel of what is kept of a row's input and of its output.
    pub(super) kept_input: usize,
    pub(super) kept_output: usize,
}

#[cube]
pub(super) fn layer_at(table: &[u32], index: usize) -> PlannedLayer {
    let at = index * FIELDS;
    PlannedLayer {
        inputs: table[at] as usize,
        outputs: table[at + 1] as usize,
        activation: table[at + 2],
        layer_norm: table[at + 3] != 0,
        params: table[at + 4] as usize,
        forward: table[at + 5] as usize,
        bias: table[at + 6] as usize,
        backward: table[at + 7] as usize,
        shift: table[at + 8] as usize,
        entry: table[at + 9] as usize,
        kept_input: table[at + 10] as usize,
        kept_output: table[at + 11] as usize,
    }
}
