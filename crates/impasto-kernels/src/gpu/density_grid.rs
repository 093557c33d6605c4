//! Density grids on a GPU: levels as integers, mean opacities as numbers, one of each a cell.

use super::launch::{Rows, UNITS, argument, cube, cubes_for, empty, extent, is_finite, zeros_u32};
use crate::cpu::density_grid::{MOST_OPACITY, RATE, RATIO, THINNEST};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

/// A grid's cells on the device.
#[derive(Debug, Clone)]
pub(crate) struct Cells {
    pub(crate) levels: CubeTensor,
    /// The bits of mean opacities.
    pub(crate) opacity: CubeTensor,
    pub(crate) side: usize,
}

/// The cell around a point of the unit cube, `side³` outside of it and for what is no number.
#[cube]
fn cell_of(points: &[f32], row: usize, side: u32) -> usize {
    let mut inside = true;
    let mut cell = 0u32;
    #[unroll]
    for back in 0..3usize {
        let x = points[row * 3 + 2 - back];
        let scaled = x * f32::cast_from(side);
        inside = inside && is_finite(x) && scaled >= 0.0 && scaled < f32::cast_from(side);
        let index = u32::cast_from(scaled.clamp(0.0, f32::cast_from(side)));
        cell = cell * side + index.min(side - 1);
    }
    select(inside, cell, side * side * side) as usize
}

/// Moves what is remembered of the cells around some points towards what was seen there.
#[cube(launch_unchecked)]
fn observe_kernel(
    points: &[f32],
    densities: &[f32],
    opacity: &[Atomic<u32>],
    bounds: &[u32],
    bound: u32,
    most: u32,
    side: u32,
    #[comptime] bounded: bool,
) {
    let row = ABSOLUTE_POS;
    let (start, end) = extent(bounds, bound, most, bounded);
    if row >= start && row < end {
        let cell = cell_of(points, row, side);
        if cell < (side * side * side) as usize {
            let density = densities[row];
            let found = 1.0 - f32::exp(-density.max(0.0) / f32::cast_from(side));
            // What cannot be measured counts as opaque, so that it is not skipped.
            let seen = select(is_finite(density) && is_finite(found), found, 1.0f32);
            let mut held = opacity[cell].load();
            loop {
                let before = held;
                let old = f32::from_bits(before);
                let new = old + RATE * (seen - old);
                held = opacity[cell].compare_exchange_weak(before, new.to_bits());
                if held == before {
                    break;
                }
            }
        }
    }
}

/// See [`crate::DensityGrid::observe`]: takes note of the densities at some rows of points.
pub(crate) fn observe(cells: &Cells, points: &CubeTensor, densities: &CubeTensor, rows: Rows<'_>) {
    if rows.most() == 0 {
        return;
    }
    let (bounds, bound, most) = rows.arguments(points);
    // SAFETY: units look at their own row and at cells of the grid.
    unsafe {
        observe_kernel::launch_unchecked(
            &points.client,
            cubes_for(rows.most()),
            cube(),
            argument(points),
            argument(densities),
            argument(&cells.opacity),
            bounds,
            bound,
            most,
            cells.side as u32,
            rows.bounded(),
        );
    }
}

#[cube(launch_unchecked)]
fn settle_kernel(opacity: &[f32], levels: &mut [u32], side: u32) {
    let cell = ABSOLUTE_POS;
    if cell < (side * side * side) as usize {
        let passed = 1.0 - opacity[cell].min(MOST_OPACITY);
        let density = -f32::ln(passed) * f32::cast_from(side);
        let found = f32::ln(density.max(THINNEST) / THINNEST) / RATIO + 1.5;
        levels[cell] = select(density < THINNEST, 0u32, u32::cast_from(found.min(255.0)));
    }
}

/// See [`crate::DensityGrid::settle`].
pub(crate) fn settle(cells: &Cells) {
    // SAFETY: units look at their own cell.
    unsafe {
        settle_kernel::launch_unchecked(
            &cells.levels.client,
            cubes_for(cells.side.pow(3)),
            cube(),
            argument(&cells.opacity),
            argument(&cells.levels),
            cells.side as u32,
        );
    }
}

/// A well-mixed number of another (O'Neill 2014, PCG-RXS-M-XS-32).
#[cube]
fn mixed(x: u32) -> u32 {
    let state = x * 747_796_405u32 + 2_891_336_453u32;
    let word = ((state >> ((state >> 28u32) + 4u32)) ^ state) * 277_803_737u32;
    (word >> 22u32) ^ word
}

/// A number in `[0, 1)` by the upper bits of another.
#[cube]
fn unit(x: u32) -> f32 {
    f32::cast_from(x >> 8u32) / 16_777_216.0f32
}

/// Draws a random place in some cells; of the outer volume only where an outer point lies.
#[cube(launch_unchecked)]
#[allow(
    clippy::manual_range_contains,
    reason = "kernels know no ranges of numbers"
)]
fn places_kernel(
    levels: &[u32],
    visible: &[u32],
    points: &mut [f32],
    bounds: &[Atomic<u32>],
    side: u32,
    most: u32,
    seed: u32,
    thin: f32,
    thick: f32,
    dense: u32,
    #[comptime] outer: bool,
) {
    let cell = ABSOLUTE_POS;
    if cell < (side * side * side) as usize {
        let drawn = mixed(seed ^ mixed(cell as u32));
        let share = select(levels[cell] >= dense, thick, thin);
        if visible[cell] != 0 && unit(drawn) < share {
            let (a, b) = (mixed(drawn + 1u32), mixed(drawn + 2u32));
            let c = mixed(drawn + 3u32);
            let at = cell as u32;
            let scale = 1.0 / f32::cast_from(side);
            let x = (f32::cast_from(at % side) + unit(a)) * scale;
            let y = (f32::cast_from(at / side % side) + unit(b)) * scale;
            let z = (f32::cast_from(at / (side * side)) + unit(c)) * scale;
            let mut there = true;
            if outer {
                let (p, q, r) = (2.0 * x - 1.0, 2.0 * y - 1.0, 2.0 * z - 1.0);
                let square = p * p + q * q + r * r;
                there = square >= 0.25 && square <= 1.0;
            }
            if there {
                let place = bounds[1].fetch_add(1u32);
                if place < most {
                    points[3 * place as usize] = x;
                    points[3 * place as usize + 1] = y;
                    points[3 * place as usize + 2] = z;
                }
            }
        }
    }
}

/// Which random places are drawn.
pub(crate) struct Places {
    /// Share of the visible cells under level `dense`, and of the others.
    pub(crate) shares: [f32; 2],
    pub(crate) dense: u8,
    /// Whether the outer volume's.
    pub(crate) outer: bool,
    pub(crate) seed: u32,
    /// Most of them.
    pub(crate) most: usize,
}

/// Random places in visible cells, `[most, 3]`, and the bounds of those that there are.
pub(crate) fn draw(
    cells: &Cells,
    visible: &CubeTensor,
    places: &Places,
) -> (CubeTensor, CubeTensor) {
    let points = empty(visible, [places.most, 3]);
    let bounds = zeros_u32(visible, 2);
    // SAFETY: units look at their own cell and write where there is room.
    unsafe {
        places_kernel::launch_unchecked(
            &visible.client,
            cubes_for(cells.side.pow(3)),
            CubeDim::new_1d(UNITS),
            argument(&cells.levels),
            argument(visible),
            argument(&points),
            argument(&bounds),
            cells.side as u32,
            places.most as u32,
            places.seed,
            places.shares[0],
            places.shares[1],
            u32::from(places.dense),
            places.outer,
        );
    }
    (points, bounds)
}
