//! Hash-grid encoding: one unit a point and level, levels behind each other so that units that run
//! together read one level's table.

use super::launch::{MOST_CUBES, Rows, UNITS, argument, cube, empty, extent, is_finite, zeros};
use crate::HashGridSpec;
use burn_cubecl::cubecl::features::AtomicUsage;
use burn_cubecl::cubecl::ir::{ElemType, FloatKind, Type};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

/// What kernels need to know of a grid while they are compiled.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Shape {
    /// Corners along an axis and whether a level's table holds all of them, by level.
    levels: Vec<(u32, bool)>,
    features: usize,
    entries: usize,
}

impl Shape {
    fn of(spec: &HashGridSpec) -> Self {
        assert!(
            matches!(spec.features, 1 | 2 | 4 | 8),
            "a hash grid has 1, 2, 4 or 8 features an entry, not {}",
            spec.features
        );
        Self {
            levels: (0..spec.levels).map(|level| spec.corners(level)).collect(),
            features: spec.features,
            entries: 1 << spec.log2_entries,
        }
    }
}

/// The cell of a point at one level.
#[derive(CubeType)]
struct Cell {
    x: u32,
    y: u32,
    z: u32,
    along: f32,
    across: f32,
    up: f32,
    side: u32,
    dense: bool,
}

#[cube]
fn cell(points: &[f32], row: usize, level: usize, #[comptime] shape: &Shape) -> Cell {
    let mut side = 0u32;
    let mut dense = false;
    #[unroll]
    for l in 0..comptime!(shape.levels.len()) {
        if level == l {
            side = comptime!(shape.levels[l].0).runtime();
            dense = comptime!(shape.levels[l].1).runtime();
        }
    }
    let (x, along) = place(points[row * 3], side);
    let (y, across) = place(points[row * 3 + 1], side);
    let (z, up) = place(points[row * 3 + 2], side);
    Cell {
        x,
        y,
        z,
        along,
        across,
        up,
        side,
        dense,
    }
}

/// The lower corner of a coordinate's cell and how far behind it the coordinate lies.
#[cube]
fn place(x: f32, side: u32) -> (u32, f32) {
    let scaled = x.clamp(0.0, 1.0) * f32::cast_from(side - 1);
    let low = u32::cast_from(scaled).min(side.max(2) - 2);
    (low, scaled - f32::cast_from(low))
}

/// A corner's entry, taken modulo the table's length, and its share.
#[cube]
fn corner(cell: &Cell, #[comptime] corner: u32, #[comptime] entries: usize) -> (usize, f32) {
    let (dx, dy, dz) = comptime!((corner & 1, corner >> 1 & 1, corner >> 2));
    let (x, y, z) = (cell.x + dx, cell.y + dy, cell.z + dz);
    let straight = x + (y + z * cell.side) * cell.side;
    let hashed = x ^ (y * 2_654_435_761u32) ^ (z * 805_459_861u32);
    let entry = select(cell.dense, straight, hashed) & comptime!(entries as u32 - 1);
    let share = part(cell.along, dx) * part(cell.across, dy) * part(cell.up, dz);
    (entry as usize, share)
}

#[cube]
fn part(behind: f32, #[comptime] far: u32) -> f32 {
    if comptime!(far == 0) {
        1.0 - behind
    } else {
        behind
    }
}

#[cube]
fn counts(points: &[f32], row: usize) -> bool {
    is_finite(points[row * 3]) && is_finite(points[row * 3 + 1]) && is_finite(points[row * 3 + 2])
}

#[cube(launch_unchecked)]
#[allow(
    clippy::needless_pass_by_value,
    reason = "what is known at compile time is passed so"
)]
fn encode_kernel<N: Size>(
    points: &[f32],
    table: &[Vector<f32, N>],
    out: &mut [Vector<f32, N>],
    bounds: &[u32],
    bound: u32,
    most: u32,
    #[comptime] bounded: bool,
    #[comptime] shape: Shape,
    #[comptime] vectors: usize,
) {
    let row = row_of_unit();
    let level = CUBE_POS_Y as usize;
    let (start, end) = extent(bounds, bound, most, bounded);
    if row >= start && row < end {
        let at = (row * comptime!(shape.levels.len()) + level) * vectors;
        if counts(points, row) {
            let cell = cell(points, row, level, &shape);
            let entries = comptime!(shape.entries);
            #[unroll]
            for v in 0..vectors {
                let mut sum = Vector::<f32, N>::new(0.0);
                #[unroll]
                for c in 0..8u32 {
                    let (entry, share) = corner(&cell, c, entries);
                    let value = table[(level * entries + entry) * vectors + v];
                    sum += value * Vector::new(share);
                }
                out[at + v] = sum;
            }
        } else {
            #[unroll]
            for v in 0..vectors {
                out[at + v] = Vector::<f32, N>::new(0.0);
            }
        }
    }
}

/// See [`crate::cpu::hash_grid::forward`].
pub(crate) fn encode(points: &CubeTensor, table: &CubeTensor, spec: &HashGridSpec) -> CubeTensor {
    let rows = points.meta.shape()[0];
    let out = empty(points, [rows, spec.outputs()]);
    encode_into(points, table, spec, Rows::all(rows), &out);
    out
}

/// The same for some rows of `points`, to the same rows of `out`; others stay as they are.
pub(crate) fn encode_into(
    points: &CubeTensor,
    table: &CubeTensor,
    spec: &HashGridSpec,
    rows: Rows<'_>,
    out: &CubeTensor,
) {
    let shape = Shape::of(spec);
    if rows.most() > 0 {
        let (bounds, bound, most) = rows.arguments(points);
        let vector = spec.features.min(4);
        // SAFETY: units look at their own row only, and entries are taken modulo the table's
        // length.
        unsafe {
            encode_kernel::launch_unchecked(
                &points.client,
                cubes(rows.most(), spec.levels),
                cube(),
                vector,
                argument(points),
                argument(table),
                argument(out),
                bounds,
                bound,
                most,
                rows.bounded(),
                shape,
                spec.features / vector,
            );
        }
    }
}

/// One unit a row, levels along the second axis; rows that one axis does not hold go on along the
/// third.
pub(super) fn cubes(rows: usize, levels: usize) -> CubeCount {
    let cubes = rows.div_ceil(UNITS as usize);
    let across = cubes.clamp(1, MOST_CUBES);
    CubeCount::Static(across as u32, levels as u32, cubes.div_ceil(across) as u32)
}

#[cube]
pub(super) fn row_of_unit() -> usize {
    ((CUBE_POS_Z * CUBE_COUNT_X + CUBE_POS_X) * CUBE_DIM_X + UNIT_POS_X) as usize
}

/// How a number is added to one that other units add to as well.
#[cube]
pub(super) trait Adds: Send + Sync + 'static {
    type Held: Numeric;
    fn add(to: &Atomic<Self::Held>, value: f32);
}

/// By the device's own instruction.
pub(super) struct Native;

#[cube]
impl Adds for Native {
    type Held = f32;
    fn add(to: &Atomic<f32>, value: f32) {
        to.fetch_add(value);
    }
}

/// By trying until nobody came between.
pub(super) struct Exchanged;

#[cube]
impl Adds for Exchanged {
    type Held = u32;
    fn add(to: &Atomic<u32>, value: f32) {
        let mut seen = to.load();
        loop {
            let before = seen;
            let sum = f32::from_bits(before) + value;
            seen = to.compare_exchange_weak(before, sum.to_bits());
            if seen == before {
                break;
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
    points: &[f32],
    grad: &[f32],
    table: &[Atomic<A::Held>],
    bounds: &[u32],
    bound: u32,
    most: u32,
    #[comptime] bounded: bool,
    #[comptime] shape: Shape,
) {
    let row = row_of_unit();
    let level = CUBE_POS_Y as usize;
    let (start, end) = extent(bounds, bound, most, bounded);
    // Adding zero times what is no number would spoil entries of other points.
    if row >= start && row < end && counts(points, row) {
        let cell = cell(points, row, level, &shape);
        let (entries, features) = comptime!((shape.entries, shape.features));
        let from = (row * comptime!(shape.levels.len()) + level) * features;
        #[unroll]
        for c in 0..8u32 {
            let (entry, share) = corner(&cell, c, entries);
            #[unroll]
            for f in 0..features {
                let value = grad[from + f] * share;
                if value != 0.0 {
                    A::add(&table[(level * entries + entry) * features + f], value);
                }
            }
        }
    }
}

/// See [`crate::cpu::hash_grid::backward`]; the order of sums, and so their last bits, may differ
/// from run to run.
pub(crate) fn spread(points: &CubeTensor, grad: &CubeTensor, spec: &HashGridSpec) -> CubeTensor {
    encode_backward(points, grad, spec, Rows::all(points.meta.shape()[0]))
}

/// The same for some rows.
pub(crate) fn encode_backward(
    points: &CubeTensor,
    grad: &CubeTensor,
    spec: &HashGridSpec,
    rows: Rows<'_>,
) -> CubeTensor {
    if adds_natively(points) {
        spread_by::<Native>(points, grad, spec, rows)
    } else {
        spread_by::<Exchanged>(points, grad, spec, rows)
    }
}

/// Whether the device of a tensor can add to a number that others add to.
pub(super) fn adds_natively(of: &CubeTensor) -> bool {
    let float = Type::atomic(ElemType::Float(FloatKind::F32));
    let usage = of.client.properties().atomic_type_usage(float);
    usage.contains(AtomicUsage::Add)
}

fn spread_by<A: Adds>(
    points: &CubeTensor,
    grad: &CubeTensor,
    spec: &HashGridSpec,
    rows: Rows<'_>,
) -> CubeTensor {
    let table = zeros(points, [spec.params()]);
    if rows.most() > 0 {
        let (bounds, bound, most) = rows.arguments(points);
        // SAFETY: as of `encode`.
        unsafe {
            spread_kernel::launch_unchecked::<A>(
                &points.client,
                cubes(rows.most(), spec.levels),
                cube(),
                argument(points),
                argument(grad),
                argument(&table),
                bounds,
                bound,
                most,
                rows.bounded(),
                Shape::of(spec),
            );
        }
    }
    table
}
