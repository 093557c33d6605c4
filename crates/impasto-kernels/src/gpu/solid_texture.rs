//! Solid texture: one unit a place and octave.

use super::hash_grid::{Adds, Exchanged, Native, adds_natively, cubes, row_of_unit};
use super::launch::{Uploaded, argument, cube, empty, is_finite, zeros};
use crate::SolidTextureSpec;
use crate::cpu::solid_texture::{BENDS, FEATURES, FOOTPRINTS, Octaves};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

/// Numbers of an octave as uploaded: three rows of a matrix, then a shift.
const OCTAVE: usize = 12;
/// Numbers that are read together.
const VECTOR: usize = 4;

/// Which octaves a place is between: the finer one, and weights of it and of the next.
#[derive(CubeType)]
struct Between {
    octave: usize,
    own: f32,
    next: f32,
}

#[cube]
fn between(places: &[f32], row: usize, finest: f32, scale: f32, first: f32) -> Between {
    let [least, most] = comptime!(FOOTPRINTS);
    let footprint = places[row * 4 + 3].clamp(least, most);
    let level = (finest * footprint).ln() * scale;
    let below = level.floor();
    let next = level - below;
    let own = 1.0 - next;
    let length = (own * own + next * next).sqrt();
    Between {
        octave: usize::cast_from((below - first).max(0.0)),
        own: own / length,
        next: next / length,
    }
}

/// The cell of a place in an octave.
#[derive(CubeType)]
struct Cell {
    low: (usize, usize, usize),
    high: (usize, usize, usize),
    behind: (f32, f32, f32),
}

/// Shape of cells, known at compile time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Shape {
    side: usize,
    /// Bits of the floats of [`SolidTextureSpec`].
    stretch: u32,
    bend: u32,
}

impl Shape {
    fn new(spec: &SolidTextureSpec) -> Self {
        Self {
            side: spec.side,
            stretch: spec.stretch.to_bits(),
            bend: spec.bend.to_bits(),
        }
    }
}

#[cube]
fn cell(
    places: &[f32],
    row: usize,
    octaves: &[f32],
    octave: usize,
    #[comptime] shape: Shape,
) -> Cell {
    let x = straight(places, row, octaves, octave, 0usize);
    let y = straight(places, row, octaves, octave, 1usize);
    let z = straight(places, row, octaves, octave, 2usize);
    let bend = comptime!(f32::from_bits(shape.bend));
    let stretch = comptime!(f32::from_bits(shape.stretch));
    let (x0, x1, a) = along((x + bend * wave(y)) / stretch, shape.side);
    let (y0, y1, b) = along(y + bend * wave(z), shape.side);
    let (z0, z1, c) = along(z + bend * wave(x), shape.side);
    Cell {
        low: (x0, y0, z0),
        high: (x1, y1, z1),
        behind: (a, b, c),
    }
}

/// A coordinate in cells of an octave, before they are bent.
#[cube]
fn straight(
    places: &[f32],
    row: usize,
    octaves: &[f32],
    octave: usize,
    #[comptime] axis: usize,
) -> f32 {
    let from = octave * OCTAVE + axis * 3;
    octaves[from] * places[row * 4]
        + octaves[from + 1] * places[row * 4 + 1]
        + octaves[from + 2] * places[row * 4 + 2]
        + octaves[octave * OCTAVE + 9 + axis]
}

/// About a sine, as on the CPU.
#[cube]
fn wave(x: f32) -> f32 {
    let t = x * comptime!(1.0 / BENDS);
    let y = t - t.floor() - 0.5;
    y * (y.abs() * 2.0 - 1.0) * 8.0
}

/// Both entries of an axis between which a place is, and how far behind the first it lies.
#[cube]
fn along(x: f32, #[comptime] side: usize) -> (usize, usize, f32) {
    let below = x.floor();
    let period = comptime!(side as f32);
    let wrapped = below - period * (below * comptime!(1.0 / side as f32)).floor();
    let low = usize::cast_from(wrapped).min(side - 1);
    let high = select(low + 1 == side, 0, low + 1);
    (low, high, x - below)
}

/// A corner's entry and its share.
#[cube]
fn corner(cell: &Cell, #[comptime] corner: u32, #[comptime] side: usize) -> (usize, f32) {
    let (x, a) = pick(
        cell.low.0,
        cell.high.0,
        cell.behind.0,
        comptime!(corner & 1),
    );
    let (y, b) = pick(
        cell.low.1,
        cell.high.1,
        cell.behind.1,
        comptime!(corner >> 1 & 1),
    );
    let (z, c) = pick(
        cell.low.2,
        cell.high.2,
        cell.behind.2,
        comptime!(corner >> 2),
    );
    ((x * side + y) * side + z, a * b * c)
}

#[cube]
fn pick(low: usize, high: usize, behind: f32, #[comptime] far: u32) -> (usize, f32) {
    if comptime!(far == 0) {
        (low, 1.0 - behind)
    } else {
        (high, behind)
    }
}

#[cube]
fn counts(places: &[f32], row: usize) -> bool {
    is_finite(places[row * 4])
        && is_finite(places[row * 4 + 1])
        && is_finite(places[row * 4 + 2])
        && is_finite(places[row * 4 + 3])
}

#[cube(launch_unchecked)]
#[allow(
    clippy::needless_pass_by_value,
    reason = "what is known at compile time is passed so"
)]
fn read_kernel<N: Size>(
    places: &[f32],
    table: &[Vector<f32, N>],
    octaves: &[f32],
    out: &mut [Vector<f32, N>],
    finest: f32,
    scale: f32,
    first: f32,
    rows: u32,
    #[comptime] shape: Shape,
    #[comptime] slots: usize,
    #[comptime] vectors: usize,
) {
    let row = row_of_unit();
    let slot = CUBE_POS_Y as usize;
    if row < rows as usize {
        let at = (row * slots + slot) * vectors;
        #[unroll]
        for v in 0..vectors {
            out[at + v] = Vector::<f32, N>::new(0.0);
        }
        if counts(places, row) {
            let between = between(places, row, finest, scale, first);
            #[unroll]
            for turn in 0..2usize {
                let cell = cell(places, row, octaves, between.octave + slot + turn, shape);
                let weight = if comptime!(turn == 0) {
                    between.own
                } else {
                    between.next
                };
                #[unroll]
                for c in 0..8u32 {
                    let (entry, share) = corner(&cell, c, shape.side);
                    #[unroll]
                    for v in 0..vectors {
                        out[at + v] += table[entry * vectors + v] * Vector::new(weight * share);
                    }
                }
            }
        }
    }
}

#[cube(launch_unchecked)]
#[allow(
    clippy::needless_pass_by_value,
    reason = "what is known at compile time is passed so"
)]
fn spread_kernel<A: Adds>(
    places: &[f32],
    grad: &[f32],
    octaves: &[f32],
    table: &[Atomic<A::Held>],
    finest: f32,
    scale: f32,
    first: f32,
    rows: u32,
    #[comptime] shape: Shape,
    #[comptime] slots: usize,
    #[comptime] features: usize,
) {
    let row = row_of_unit();
    let slot = CUBE_POS_Y as usize;
    // Adding zero times what is no number would spoil entries of other places.
    if row < rows as usize && counts(places, row) {
        let from = (row * slots + slot) * features;
        let between = between(places, row, finest, scale, first);
        #[unroll]
        for turn in 0..2usize {
            let cell = cell(places, row, octaves, between.octave + slot + turn, shape);
            let weight = if comptime!(turn == 0) {
                between.own
            } else {
                between.next
            };
            #[unroll]
            for c in 0..8u32 {
                let (entry, share) = corner(&cell, c, shape.side);
                #[unroll]
                for f in 0..features {
                    let value = grad[from + f] * weight * share;
                    if value != 0.0 {
                        A::add(&table[entry * features + f], value);
                    }
                }
            }
        }
    }
}

/// What kernels need of a specification beside its sizes.
struct Prepared {
    octaves: Uploaded,
    scale: f32,
    first: f32,
}

impl Prepared {
    fn new(like: &CubeTensor, spec: &SolidTextureSpec) -> Self {
        let octaves = Octaves::new(spec);
        Self {
            octaves: Uploaded::f32(like, &octaves.numbers()),
            scale: spec.ratio.ln().recip(),
            first: octaves.first as f32,
        }
    }
}

/// See [`crate::cpu::solid_texture::forward`].
pub(crate) fn read(places: &CubeTensor, table: &CubeTensor, spec: &SolidTextureSpec) -> CubeTensor {
    let rows = places.meta.shape()[0];
    let out = empty(places, [rows, spec.outputs()]);
    if rows > 0 {
        let prepared = Prepared::new(places, spec);
        // SAFETY: units look at their own row only, entries are below the table's length, and octaves
        // cover every footprint.
        unsafe {
            read_kernel::launch_unchecked(
                &places.client,
                cubes(rows, spec.octaves),
                cube(),
                VECTOR,
                argument(places),
                argument(table),
                prepared.octaves.argument(),
                argument(&out),
                spec.finest,
                prepared.scale,
                prepared.first,
                rows as u32,
                Shape::new(spec),
                spec.octaves,
                FEATURES / VECTOR,
            );
        }
    }
    out
}

/// See [`crate::cpu::solid_texture::backward`]; the order of sums, and so their last bits, may differ from
/// run to run.
pub(crate) fn spread(
    places: &CubeTensor,
    grad: &CubeTensor,
    spec: &SolidTextureSpec,
) -> CubeTensor {
    if adds_natively(places) {
        spread_by::<Native>(places, grad, spec)
    } else {
        spread_by::<Exchanged>(places, grad, spec)
    }
}

fn spread_by<A: Adds>(
    places: &CubeTensor,
    grad: &CubeTensor,
    spec: &SolidTextureSpec,
) -> CubeTensor {
    let rows = places.meta.shape()[0];
    let table = zeros(places, [spec.params()]);
    if rows > 0 {
        let prepared = Prepared::new(places, spec);
        // SAFETY: as of `read`.
        unsafe {
            spread_kernel::launch_unchecked::<A>(
                &places.client,
                cubes(rows, spec.octaves),
                cube(),
                argument(places),
                argument(grad),
                prepared.octaves.argument(),
                argument(&table),
                spec.finest,
                prepared.scale,
                prepared.first,
                rows as u32,
                Shape::new(spec),
                spec.octaves,
                FEATURES,
            );
        }
    }
    table
}
