//! Texture by example: one unit a place.

use super::hash_grid::{Adds, Exchanged, Native, adds_natively, cubes, row_of_unit};
use super::launch::{Uploaded, argument, cube, empty, is_finite, zeros};
use crate::cpu::exemplar::{
    AXES, FACING, FACTORS, FEATURES, FOOTPRINTS, FREE, LEAN, LEAST_SHARE, OFFSETS, PARAMS, ROUNDS,
    SHARPNESS, SIDE, SPACING, frames,
};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

/// Numbers that are read together.
const VECTOR: usize = 4;
/// Number of the finest octave that any footprint asks for, and how many there are.
const OCTAVES: [i32; 2] = [-17, 19];
/// Where in what is uploaded the scales of octaves begin: behind three directions of every axis.
const SCALES: usize = AXES * 9;

const _: () = assert!(FACING == 8 && SHARPNESS == 6 && FEATURES == 3 * VECTOR && ROUNDS.len() == 2);

/// Which octaves a place is between: the finer one's number, and how far it is on the way to the next.
#[derive(CubeType)]
struct Between {
    octave: f32,
    next: f32,
}

#[cube]
fn between(places: &[f32], row: usize) -> Between {
    let [least, most] = comptime!(FOOTPRINTS);
    let level = places[row * 4 + 3].clamp(least, most).ln() * comptime!(std::f32::consts::LOG2_E);
    let octave = level.floor().max(comptime!(OCTAVES[0] as f32));
    Between {
        octave,
        next: level - octave,
    }
}

/// Three windows that reach a place along an axis, in an octave.
#[derive(CubeType)]
struct Windows {
    /// The place, in texels.
    x: f32,
    y: f32,
    /// The lattice cell it lies in, and whether nearer to its lower corner.
    i: f32,
    j: f32,
    lower: bool,
    shares: (f32, f32, f32),
}

#[cube]
fn direction(places: &[f32], row: usize, axes: &[f32], from: usize) -> f32 {
    axes[from] * places[row * 4]
        + axes[from + 1] * places[row * 4 + 1]
        + axes[from + 2] * places[row * 4 + 2]
}

#[cube]
fn sixth(x: f32) -> f32 {
    let square = x * x;
    square * square * square
}

#[cube]
fn windows(places: &[f32], row: usize, axes: &[f32], axis: usize, octave: f32) -> Windows {
    let scale = axes[SCALES + usize::cast_from(octave - comptime!(OCTAVES[0] as f32))];
    let x = direction(places, row, axes, axis * 9) * scale;
    let y = direction(places, row, axes, axis * 9 + 3) * scale;
    let v = y / SPACING / LEAN;
    let u = x / SPACING - 0.5 * v;
    let i = u.floor();
    let j = v.floor();
    let a = u - i;
    let b = v - j;
    let rest = 1.0 - a - b;
    let lower = rest > 0.0;
    let first = sixth(rest);
    let second = sixth(select(lower, a, 1.0 - b));
    let third = sixth(select(lower, b, 1.0 - a));
    let sum = (first + second + third).max(1e-20);
    Windows {
        x,
        y,
        i,
        j,
        lower,
        shares: (first / sum, second / sum, third / sum),
    }
}

/// Four texels between which a place lies in a window: the first, and how far behind it.
#[derive(CubeType)]
struct Tap {
    first: usize,
    right: f32,
    below: f32,
}

#[cube]
fn share(windows: &Windows, #[comptime] which: u32) -> f32 {
    if comptime!(which == 0) {
        windows.shares.0
    } else if comptime!(which == 1) {
        windows.shares.1
    } else {
        windows.shares.2
    }
}

#[cube]
fn tap(windows: &Windows, octave: f32, axis: usize, #[comptime] which: u32) -> Tap {
    let (i, j) = if comptime!(which == 0) {
        let far = select(windows.lower, 0.0, 1.0);
        (windows.i + far, windows.j + far)
    } else if comptime!(which == 1) {
        (windows.i + 1.0, windows.j)
    } else {
        (windows.i, windows.j + 1.0)
    };
    let [window, number] = comptime!([OFFSETS[0] as f32, OFFSETS[1] as f32]);
    let hash = (u32::cast_from(i + window) * comptime!(FACTORS[0]))
        ^ (u32::cast_from(j + window) * comptime!(FACTORS[1]))
        ^ (u32::cast_from(octave + number) * comptime!(FACTORS[2]))
        ^ (u32::cast_from(axis) * comptime!(FACTORS[3]));
    let hash = (hash ^ (hash >> comptime!(ROUNDS[0].0))) * comptime!(ROUNDS[0].1);
    let hash = (hash ^ (hash >> comptime!(ROUNDS[1].0))) * comptime!(ROUNDS[1].1);
    let hash = hash ^ (hash >> 16u32);
    let unit = comptime!(FREE / 65536.0);
    let u = SPACING + f32::cast_from(hash & 0xffffu32) * unit;
    let v = SPACING + f32::cast_from(hash >> 16u32) * unit;
    let most = comptime!(SIDE as f32 - 1.001);
    let x = (u + (windows.x - SPACING * (i + 0.5 * j))).clamp(0.0, most);
    let y = (v + (windows.y - SPACING * LEAN * j)).clamp(0.0, most);
    let column = x.floor();
    let line = y.floor();
    Tap {
        first: usize::cast_from(line) * SIDE + usize::cast_from(column),
        right: x - column,
        below: y - line,
    }
}

/// One of a tap's texels and its share.
#[cube]
fn texel(tap: &Tap, #[comptime] corner: u32) -> (usize, f32) {
    let (column, a) = if comptime!(corner & 1 == 0) {
        (tap.first, 1.0 - tap.right)
    } else {
        (tap.first + 1, tap.right)
    };
    if comptime!(corner >> 1 == 0) {
        (column, a * (1.0 - tap.below))
    } else {
        (column + SIDE, a * tap.below)
    }
}

/// How much a surface faces an axis, before shares are made of it.
#[cube]
fn faces(normals: &[f32], row: usize, axes: &[f32], axis: usize) -> f32 {
    let from = axis * 9 + 6;
    let along = axes[from] * normals[row * 3]
        + axes[from + 1] * normals[row * 3 + 1]
        + axes[from + 2] * normals[row * 3 + 2];
    let square = along * along;
    let fourth = square * square;
    fourth * fourth
}

#[cube]
fn facing(normals: &[f32], row: usize, axes: &[f32]) -> f32 {
    let mut sum = 0.0f32;
    for axis in 0..AXES {
        sum += faces(normals, row, axes, axis);
    }
    sum.max(1e-20)
}

#[cube]
fn counts(places: &[f32], normals: &[f32], row: usize) -> bool {
    is_finite(places[row * 4])
        && is_finite(places[row * 4 + 1])
        && is_finite(places[row * 4 + 2])
        && is_finite(places[row * 4 + 3])
        && is_finite(normals[row * 3])
        && is_finite(normals[row * 3 + 1])
        && is_finite(normals[row * 3 + 2])
}

/// What makes the squares of all weights of a place sum to one.
#[cube]
fn gain(places: &[f32], normals: &[f32], row: usize, axes: &[f32]) -> f32 {
    let between = between(places, row);
    let all = facing(normals, row, axes);
    let mut squares = 0.0f32;
    for axis in 0..AXES {
        let facing = faces(normals, row, axes, axis) / all;
        if facing >= LEAST_SHARE {
            #[unroll]
            for turn in 0..2u32 {
                let fade = fade(&between, turn);
                if fade >= LEAST_SHARE {
                    let octave = between.octave + comptime!(turn as f32);
                    let windows = windows(places, row, axes, axis, octave);
                    #[unroll]
                    for which in 0..3u32 {
                        let share = share(&windows, which);
                        if share >= LEAST_SHARE {
                            let weight = facing * fade * share;
                            squares += weight * weight;
                        }
                    }
                }
            }
        }
    }
    1.0 / squares.max(1e-20).sqrt()
}

#[cube]
fn fade(between: &Between, #[comptime] turn: u32) -> f32 {
    if comptime!(turn == 0) {
        1.0 - between.next
    } else {
        between.next
    }
}

#[cube(launch_unchecked)]
fn read_kernel<N: Size>(
    places: &[f32],
    normals: &[f32],
    table: &[Vector<f32, N>],
    axes: &[f32],
    out: &mut [Vector<f32, N>],
    rows: u32,
    #[comptime] vectors: usize,
) {
    let row = row_of_unit();
    if row < rows as usize {
        let at = row * vectors;
        #[unroll]
        for v in 0..vectors {
            out[at + v] = Vector::<f32, N>::new(0.0);
        }
        if counts(places, normals, row) {
            let gain = gain(places, normals, row, axes);
            let between = between(places, row);
            let all = facing(normals, row, axes);
            for axis in 0..AXES {
                let facing = faces(normals, row, axes, axis) / all;
                if facing >= LEAST_SHARE {
                    #[unroll]
                    for turn in 0..2u32 {
                        let fade = fade(&between, turn);
                        if fade >= LEAST_SHARE {
                            let octave = between.octave + comptime!(turn as f32);
                            let windows = windows(places, row, axes, axis, octave);
                            #[unroll]
                            for which in 0..3u32 {
                                let share = share(&windows, which);
                                if share >= LEAST_SHARE {
                                    let weight = facing * fade * share * gain;
                                    let tap = tap(&windows, octave, axis, which);
                                    #[unroll]
                                    for c in 0..4u32 {
                                        let (entry, part) = texel(&tap, c);
                                        #[unroll]
                                        for v in 0..vectors {
                                            out[at + v] += table[entry * vectors + v]
                                                * Vector::new(weight * part);
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cube(launch_unchecked)]
fn spread_kernel<A: Adds>(
    places: &[f32],
    normals: &[f32],
    grad: &[f32],
    axes: &[f32],
    table: &[Atomic<A::Held>],
    rows: u32,
    #[comptime] features: usize,
) {
    let row = row_of_unit();
    // Adding zero times what is no number would spoil texels of other places.
    if row < rows as usize && counts(places, normals, row) {
        let from = row * features;
        let gain = gain(places, normals, row, axes);
        let between = between(places, row);
        let all = facing(normals, row, axes);
        for axis in 0..AXES {
            let facing = faces(normals, row, axes, axis) / all;
            if facing >= LEAST_SHARE {
                #[unroll]
                for turn in 0..2u32 {
                    let fade = fade(&between, turn);
                    if fade >= LEAST_SHARE {
                        let octave = between.octave + comptime!(turn as f32);
                        let windows = windows(places, row, axes, axis, octave);
                        #[unroll]
                        for which in 0..3u32 {
                            let share = share(&windows, which);
                            if share >= LEAST_SHARE {
                                let weight = facing * fade * share * gain;
                                let tap = tap(&windows, octave, axis, which);
                                #[unroll]
                                for c in 0..4u32 {
                                    let (entry, part) = texel(&tap, c);
                                    for f in 0..features {
                                        let value = grad[from + f] * weight * part;
                                        if value != 0.0 {
                                            A::add(&table[entry * features + f], value);
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Directions of all axes, then texels a unit of every octave.
fn axes(like: &CubeTensor) -> Uploaded {
    let directions = frames();
    let directions = directions.iter().flatten().flatten().copied();
    let [first, count] = OCTAVES;
    let scales = (first..first + count).map(|octave| (-(octave as f32)).exp2());
    let numbers: Vec<f32> = directions.chain(scales).collect();
    Uploaded::f32(like, &numbers)
}

/// See [`crate::cpu::exemplar::forward`].
pub(crate) fn read(places: &CubeTensor, normals: &CubeTensor, table: &CubeTensor) -> CubeTensor {
    let rows = places.meta.shape()[0];
    let out = empty(places, [rows, FEATURES]);
    if rows > 0 {
        let axes = axes(places);
        // SAFETY: units look at their own row only, texels are below the table's length, and scales are
        // there for every octave that a footprint asks for.
        unsafe {
            read_kernel::launch_unchecked(
                &places.client,
                cubes(rows, 1),
                cube(),
                VECTOR,
                argument(places),
                argument(normals),
                argument(table),
                axes.argument(),
                argument(&out),
                rows as u32,
                FEATURES / VECTOR,
            );
        }
    }
    out
}

/// See [`crate::cpu::exemplar::backward`]; the order of sums, and so their last bits, may differ from
/// run to run.
pub(crate) fn spread(places: &CubeTensor, normals: &CubeTensor, grad: &CubeTensor) -> CubeTensor {
    if adds_natively(places) {
        spread_by::<Native>(places, normals, grad)
    } else {
        spread_by::<Exchanged>(places, normals, grad)
    }
}

fn spread_by<A: Adds>(places: &CubeTensor, normals: &CubeTensor, grad: &CubeTensor) -> CubeTensor {
    let rows = places.meta.shape()[0];
    let table = zeros(places, [PARAMS]);
    if rows > 0 {
        let axes = axes(places);
        // SAFETY: as of `read`.
        unsafe {
            spread_kernel::launch_unchecked::<A>(
                &places.client,
                cubes(rows, 1),
                cube(),
                argument(places),
                argument(normals),
                argument(grad),
                axes.argument(),
                argument(&table),
                rows as u32,
                FEATURES,
            );
        }
    }
    table
}
