//! Small MLPs: a cube takes a tile of rows through all layers without leaving its shared memory.
//! The way back computes the activations again and keeps them in a piece of memory that the cube
//! has for itself and that stays in the device's cache.

mod backward;
mod forward;
mod plan;

use super::launch::{
    MOST_CUBES, Rows, UNITS, Uploaded, argument, cube, cubes_for, empty, extent, zeros,
};
use crate::MlpSpec;
use backward::layer_backward;
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;
use forward::{Quad, Tile, layer_forward, new_tile, read_rows, write_rows};
use plan::{TilePlan, TileShape, layer_at};

/// Most cubes of a pass that keeps activations or sums: enough to fill a large device.
const CUBES: usize = 512;

/// Whether a tile of an MLP's rows has room in the shared memory that every device has.
pub(crate) fn fits(spec: &MlpSpec) -> bool {
    TilePlan::of(spec).fits()
}

/// Puts every weight where [`forward::product`] looks for it, forward and backward.
#[cube(launch_unchecked)]
fn pack_kernel(params: &[f32], table: &[u32], packed: &mut [f32], layers: u32) {
    let i = ABSOLUTE_POS;
    for l in 0..layers as usize {
        let layer = layer_at(table, l);
        let weights = layer.inputs * layer.outputs;
        if i >= layer.params && i < layer.params + weights + layer.outputs {
            let own = i - layer.params;
            if own < weights {
                let (o, k) = (own / layer.inputs, own % layer.inputs);
                let (across, down) = (layer.outputs.div_ceil(4), layer.inputs.div_ceil(4));
                packed[4 * (layer.forward + k * across) + o] = params[i];
                packed[4 * (layer.backward + o * down) + k] = params[i];
            } else {
                packed[4 * layer.bias + own - weights] = params[i];
            }
        }
    }
}

/// An MLP's layers and packed weights on the device.
struct PackedLayers {
    table: Uploaded,
    packed: CubeTensor,
}

impl PackedLayers {
    fn new(params: &CubeTensor, plan: &TilePlan) -> Self {
        let table = Uploaded::u32(params, &plan.table);
        let packed = zeros(params, [4 * plan.packed]);
        // SAFETY: units look at their own parameter, behind the last one at none.
        unsafe {
            pack_kernel::launch_unchecked(
                &params.client,
                cubes_for(plan.params),
                cube(),
                argument(params),
                table.argument(),
                argument(&packed),
                plan.layers as u32,
            );
        }
        Self { table, packed }
    }
}

/// All layers, see [`layer_forward`].
#[cube]
fn all_forward(
    params: &[f32],
    table: &[u32],
    packed: &[Quad],
    tile: &mut Tile,
    kept: &mut [Quad],
    kept_at: usize,
    layers: u32,
    #[comptime] keep: bool,
    #[comptime] shape: TileShape,
) {
    for l in 0..layers as usize {
        let layer = layer_at(table, l);
        layer_forward(params, packed, tile, kept, kept_at, &layer, keep, shape);
    }
}

/// All layers back, last to first, see [`layer_backward`].
#[cube]
fn all_backward(
    table: &[u32],
    packed: &[Quad],
    tile: &mut Tile,
    kept: &mut [Quad],
    kept_at: usize,
    sums: &mut [f32],
    sums_at: usize,
    layers: u32,
    #[comptime] shape: TileShape,
) {
    for back in 0..layers as usize {
        let layer = layer_at(table, layers as usize - 1 - back);
        layer_backward(packed, tile, kept, kept_at, sums, sums_at, &layer, shape);
    }
}

#[cube(launch_unchecked)]
fn forward_kernel(
    x: &[f32],
    params: &[f32],
    table: &[u32],
    packed: &[Quad],
    kept: &mut [Quad],
    out: &mut [f32],
    bounds: &[u32],
    bound: u32,
    most: u32,
    layers: u32,
    inputs: u32,
    outputs: u32,
    #[comptime] bounded: bool,
    #[comptime] shape: TileShape,
) {
    let quads = comptime!(shape.quads);
    let mut tile = new_tile(shape);
    let kept_at = CUBE_POS_X as usize * comptime!(shape.kept * quads);
    let (start, rows) = extent(bounds, bound, most, bounded);
    let tiles = (rows - start).div_ceil(comptime!(shape.rows())) as u32;
    for index in range_stepped(CUBE_POS_X, tiles, CUBE_COUNT_X) {
        let first_row = start + index as usize * comptime!(shape.rows());
        read_rows(x, &mut tile.from, first_row, rows, inputs as usize, quads);
        sync_cube();
        all_forward(
            params, table, packed, &mut tile, kept, kept_at, layers, false, shape,
        );
        write_rows(&tile.from, out, first_row, rows, outputs as usize, quads);
        sync_cube();
    }
}

/// See [`crate::cpu::mlp::forward`].
pub(crate) fn forward(x: &CubeTensor, params: &CubeTensor, spec: &MlpSpec) -> CubeTensor {
    let rows = x.meta.shape()[0];
    let out = empty(x, [rows, spec.outputs()]);
    forward_into(x, params, spec, Rows::all(rows), &out);
    out
}

/// The same for some rows of `x`, to the same rows of `out`; others stay as they are.
pub(crate) fn forward_into(
    x: &CubeTensor,
    params: &CubeTensor,
    spec: &MlpSpec,
    rows: Rows<'_>,
    out: &CubeTensor,
) {
    if rows.most() == 0 {
        return;
    }
    let plan = TilePlan::of(spec);
    let tiles = plan.tiles(rows.most());
    // Only residual blocks keep anything here.
    let (cubes, kept) = if spec.blocks().is_empty() {
        (tiles.min(MOST_CUBES), 4)
    } else {
        (tiles.min(CUBES), plan.kept(tiles.min(CUBES)))
    };
    let packed = PackedLayers::new(params, &plan);
    let (bounds, bound, most) = rows.arguments(x);
    // SAFETY: rows are looked at as far as there are any; the rest is laid out by the plan.
    unsafe {
        forward_kernel::launch_unchecked(
            &x.client,
            CubeCount::new_1d(cubes as u32),
            cube(),
            argument(x),
            argument(params),
            packed.table.argument(),
            argument(&packed.packed),
            argument(&empty(x, [kept])),
            argument(out),
            bounds,
            bound,
            most,
            plan.layers as u32,
            plan.inputs as u32,
            plan.outputs as u32,
            rows.bounded(),
            plan.shape,
        );
    }
}

/// Sets numbers to zero, for the whole cube to see.
#[cube]
fn clear(numbers: &mut [f32], first: usize, count: usize) {
    for i in range_stepped(UNIT_POS as usize, count, UNITS as usize) {
        numbers[first + i] = 0.0;
    }
    sync_storage();
}

#[cube(launch_unchecked)]
fn backward_kernel(
    x: &[f32],
    params: &[f32],
    table: &[u32],
    packed: &[Quad],
    grad: &[f32],
    kept: &mut [Quad],
    sums: &mut [f32],
    input_grad: &mut [f32],
    bounds: &[u32],
    bound: u32,
    most: u32,
    layers: u32,
    inputs: u32,
    outputs: u32,
    count: u32,
    #[comptime] bounded: bool,
    #[comptime] need_input: bool,
    #[comptime] shape: TileShape,
) {
    let quads = comptime!(shape.quads);
    let mut tile = new_tile(shape);
    let kept_at = CUBE_POS_X as usize * comptime!(shape.kept * quads);
    let sums_at = (CUBE_POS_X * count) as usize;
    clear(sums, sums_at, count as usize);
    let (start, rows) = extent(bounds, bound, most, bounded);
    let tiles = (rows - start).div_ceil(comptime!(shape.rows())) as u32;
    for index in range_stepped(CUBE_POS_X, tiles, CUBE_COUNT_X) {
        let first_row = start + index as usize * comptime!(shape.rows());
        read_rows(x, &mut tile.from, first_row, rows, inputs as usize, quads);
        sync_cube();
        all_forward(
            params, table, packed, &mut tile, kept, kept_at, layers, true, shape,
        );
        read_rows(
            grad,
            &mut tile.from,
            first_row,
            rows,
            outputs as usize,
            quads,
        );
        sync_storage();
        all_backward(
            table, packed, &mut tile, kept, kept_at, sums, sums_at, layers, shape,
        );
        if need_input {
            write_rows(
                &tile.from,
                input_grad,
                first_row,
                rows,
                inputs as usize,
                quads,
            );
        }
        sync_storage();
    }
}

/// Adds up what the cubes have found, in their order.
#[cube(launch_unchecked)]
fn sum_kernel(sums: &[f32], out: &mut [f32], parts: u32, length: u32) {
    let i = ABSOLUTE_POS;
    if i < length as usize {
        let mut sum = 0.0f32;
        for part in 0..parts as usize {
            sum += sums[part * length as usize + i];
        }
        out[i] = sum;
    }
}

/// See [`crate::cpu::mlp::backward`].
pub(crate) fn backward(
    x: &CubeTensor,
    params: &CubeTensor,
    grad: &CubeTensor,
    spec: &MlpSpec,
    need_input: bool,
) -> (Option<CubeTensor>, CubeTensor) {
    let rows = x.meta.shape()[0];
    let input_grad = empty(x, [if need_input { rows } else { 1 }, spec.inputs()]);
    let wanted = need_input.then_some(&input_grad);
    let params_grad = backward_into(x, params, grad, spec, Rows::all(rows), wanted);
    (need_input.then_some(input_grad), params_grad)
}

/// The same for some rows, whose gradients go to the same rows of `input_grad`, where that is
/// wanted; returns the parameters' gradients.
pub(crate) fn backward_into(
    x: &CubeTensor,
    params: &CubeTensor,
    grad: &CubeTensor,
    spec: &MlpSpec,
    rows: Rows<'_>,
    input_grad: Option<&CubeTensor>,
) -> CubeTensor {
    let plan = TilePlan::of(spec);
    if rows.most() == 0 {
        return zeros(x, [plan.params]);
    }
    let params_grad = empty(x, [plan.params]);
    let cubes = plan.tiles(rows.most()).min(CUBES);
    let sums = empty(x, [cubes * plan.params]);
    let packed = PackedLayers::new(params, &plan);
    let (bounds, bound, most) = rows.arguments(x);
    let unwanted = empty(x, [1]);
    // SAFETY: as of `forward`; every cube has its own part of what is kept and summed up.
    unsafe {
        backward_kernel::launch_unchecked(
            &x.client,
            CubeCount::new_1d(cubes as u32),
            cube(),
            argument(x),
            argument(params),
            packed.table.argument(),
            argument(&packed.packed),
            argument(grad),
            argument(&empty(x, [plan.kept(cubes)])),
            argument(&sums),
            argument(input_grad.unwrap_or(&unwanted)),
            bounds,
            bound,
            most,
            plan.layers as u32,
            plan.inputs as u32,
            plan.outputs as u32,
            plan.params as u32,
            rows.bounded(),
            input_grad.is_some(),
            plan.shape,
        );
        sum_kernel::launch_unchecked(
            &x.client,
            cubes_for(plan.params),
            cube(),
            argument(&sums),
            argument(&params_grad),
            cubes as u32,
            plan.params as u32,
        );
    }
    params_grad
}
