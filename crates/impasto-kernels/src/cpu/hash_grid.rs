//! Multi-resolution hash-grid encoding (Müller et al. 2022, "Instant Neural Graphics Primitives").

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::mem::MaybeUninit;

/// Corners of a cell.
const CORNERS: usize = 8;
/// Points handled together at one level, so that the level's table stays in cache.
const CHUNK: usize = 1024;
/// Points whose cells are found together, in vectors. Reading single numbers of a vector that was
/// stored a moment ago stalls; by the end of a group its beginning has reached the cache.
const GROUP: usize = 64;
/// Adding it to a small number leaves that number, rounded, in the last bits; converting to integers
/// would ask of every number whether it fits.
const ROUND: f32 = 12_582_912.0;
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// Sizes of a hash grid. The table is laid out `[level][entry][feature]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashGridSpec {
    /// Number of resolutions.
    pub levels: usize,
    /// Numbers per entry: 1, 2, 4 or 8.
    pub features: usize,
    /// log₂ of the entries per level.
    pub log2_entries: u32,
    /// Cells along an axis at the coarsest level.
    pub coarsest: f32,
    /// Cells along an axis at the finest level, at most four million.
    pub finest: f32,
}

impl HashGridSpec {
    /// Width of an encoded point.
    pub fn outputs(&self) -> usize {
        self.levels * self.features
    }

    /// Length of the table.
    pub fn params(&self) -> usize {
        self.levels * self.level_params()
    }

    /// Numbers in one level of the table.
    pub fn level_params(&self) -> usize {
        self.features << self.log2_entries
    }

    /// Cells along an axis at `level`.
    pub fn resolution(&self, level: usize) -> f32 {
        let steps = self.levels.saturating_sub(1).max(1) as f32;
        (self.coarsest * (self.finest / self.coarsest).powf(level as f32 / steps)).floor()
    }

    /// Corners of cells along an axis at `level`, and whether the table has an entry for each.
    pub(crate) fn corners(&self, level: usize) -> (u32, bool) {
        let side = self.resolution(level) as u64 + 1;
        (side as u32, side * side * side <= 1 << self.log2_entries)
    }

    fn level(&self, level: usize) -> Level {
        let (side, dense) = self.corners(level);
        Level {
            resolution: self.resolution(level),
            side,
            dense,
        }
    }
}

/// Coordinates of up to [`GROUP`] points, axis by axis, and whether each point counts. A point that
/// is not finite has weight nowhere, so that it encodes to zeros and receives no gradient.
struct Group {
    axes: [[f32; GROUP]; 3],
    scale: [f32; GROUP],
}

impl Group {
    /// Coordinates clamped to the unit cube; missing points count as not finite.
    #[inline(never)]
    fn of(points: &[f32]) -> Self {
        let mut group = Self {
            axes: [[0.0; GROUP]; 3],
            scale: [0.0; GROUP],
        };
        for (i, point) in points.chunks_exact(3).enumerate().take(GROUP) {
            if point.iter().all(|x| x.is_finite()) {
                group.scale[i] = 1.0;
                for (axis, x) in group.axes.iter_mut().zip(point) {
                    axis[i] = x.clamp(0.0, 1.0);
                }
            }
        }
        group
    }
}

#[derive(Clone, Copy)]
struct Level {
    resolution: f32,
    side: u32,
    dense: bool,
}

/// Table entries (still to be taken modulo the table's length) and interpolation weights of a
/// group's cells, corner by corner.
struct Cells {
    entries: [[u32; GROUP]; CORNERS],
    weights: [[f32; GROUP]; CORNERS],
    /// 0 for points that do not count.
    scale: [f32; GROUP],
}

impl Cells {
    fn none() -> Self {
        Self {
            entries: [[0; GROUP]; CORNERS],
            weights: [[0.0; GROUP]; CORNERS],
            scale: [0.0; GROUP],
        }
    }
}

impl Level {
    /// Sets all of `cells` to a group's.
    #[inline(always)]
    fn find(self, group: &Group, cells: &mut Cells) {
        let last = self.side.saturating_sub(2) as f32;
        let mut low = [[0u32; GROUP]; 3];
        let mut high = [[0u32; GROUP]; 3];
        let mut frac = [[0f32; GROUP]; 3];
        for axis in 0..3 {
            let step = match (self.dense, axis) {
                (_, 0) => 1,
                (true, 1) => self.side,
                (true, _) => self.side * self.side,
                (false, axis) => PRIMES[axis],
            };
            for i in 0..GROUP {
                let scaled = group.axes[axis][i] * self.resolution;
                // On a cell's border either cell will do.
                let below = (scaled - 0.5 + ROUND) - ROUND;
                let below = if below < last { below } else { last };
                frac[axis][i] = scaled - below;
                let cell = (below + ROUND).to_bits().wrapping_sub(ROUND.to_bits());
                low[axis][i] = cell.wrapping_mul(step);
                high[axis][i] = low[axis][i].wrapping_add(step);
            }
        }
        cells.scale = group.scale;
        for corner in 0..CORNERS {
            let side = |axis: usize| match corner >> axis & 1 {
                0 => &low[axis],
                _ => &high[axis],
            };
            let (x, y, z) = (side(0), side(1), side(2));
            for i in 0..GROUP {
                cells.entries[corner][i] = if self.dense {
                    x[i] + y[i] + z[i]
                } else {
                    x[i] ^ y[i] ^ z[i]
                };
                let part = |axis: usize| match corner >> axis & 1 {
                    0 => 1.0 - frac[axis][i],
                    _ => frac[axis][i],
                };
                cells.weights[corner][i] = group.scale[i] * part(0) * part(1) * part(2);
            }
        }
    }
}

/// These two run outside of the vectorised code: its gather and scatter instructions are slower
/// than loading an entry, which is a short vector already.
impl Cells {
    /// Writes each point's interpolated entry at the beginning of every `width` numbers.
    #[inline(never)]
    fn interpolate<const F: usize>(&self, entries: &[[f32; F]], width: usize, out: &mut [f32]) {
        // Entries are as many as a power of two.
        let mask = entries.len() - 1;
        for (i, out) in out.chunks_mut(width).enumerate() {
            let mut sum = [0f32; F];
            for corner in 0..CORNERS {
                let entry = &entries[self.entries[corner][i] as usize & mask];
                for f in 0..F {
                    sum[f] += self.weights[corner][i] * entry[f];
                }
            }
            out[..F].copy_from_slice(&sum);
        }
    }

    /// Adds the gradients at the beginning of every `width` numbers to the points' entries.
    #[inline(never)]
    fn spread<const F: usize>(&self, grads: &[f32], width: usize, entries: &mut [[f32; F]]) {
        let mask = entries.len() - 1;
        for (i, grad) in grads.chunks(width).enumerate() {
            // Adding zero times what is no number would spoil entries of other points.
            if self.scale[i] == 0.0 {
                continue;
            }
            for corner in 0..CORNERS {
                let entry = &mut entries[self.entries[corner][i] as usize & mask];
                for f in 0..F {
                    entry[f] += self.weights[corner][i] * grad[f];
                }
            }
        }
    }
}

/// [`Cells::interpolate`] for four features, which are one short vector, where a product and a sum
/// are one instruction.
#[cfg(target_arch = "x86_64")]
struct Quads<'a> {
    simd: pulp::x86::V3,
    cells: &'a Cells,
    entries: &'a [[f32; 4]],
    width: usize,
    out: &'a mut [f32],
}

#[cfg(target_arch = "x86_64")]
impl WithSimd for Quads<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (simd, cells) = (self.simd, self.cells);
        let mask = self.entries.len() - 1;
        for (i, out) in self.out.chunks_mut(self.width).enumerate().take(GROUP) {
            let zero = pulp::cast([0f32; 4]);
            let mut sums: [core::arch::x86_64::__m128; 2] = [zero; 2];
            for corner in 0..CORNERS {
                let index = cells.entries[corner][i] as usize & mask;
                // SAFETY: a level has 2ⁿ entries; `mask` leaves n bits.
                let entry = unsafe { self.entries.get_unchecked(index) };
                let weight = simd.avx._mm_broadcast_ss(&cells.weights[corner][i]);
                let sum = &mut sums[corner & 1];
                *sum = simd.fma._mm_fmadd_ps(weight, pulp::cast(*entry), *sum);
            }
            let sum: [f32; 4] = pulp::cast(simd.sse._mm_add_ps(sums[0], sums[1]));
            out[..4].copy_from_slice(&sum);
        }
    }
}

/// Encodes points in the unit cube; coordinates outside are clamped to it.
///
/// # Shapes
/// `points`: `n × 3`; `table`: `spec.params()`; result: `n × spec.outputs()`.
///
/// # Panics
/// If a slice does not have its stated length or `features` is not 1, 2, 4 or 8.
pub fn forward(spec: &HashGridSpec, points: &[f32], table: &[f32]) -> Vec<f32> {
    assert_eq!(points.len() % 3, 0, "points of a hash grid are triples");
    assert_eq!(table.len(), spec.params(), "table of a hash grid");
    let mut out = vec![0.0; points.len() / 3 * spec.outputs()];
    out.par_chunks_mut(CHUNK * spec.outputs())
        .zip(points.par_chunks(CHUNK * 3))
        .for_each(|(out, points)| {
            Arch::new().dispatch(Forward {
                spec,
                points,
                table,
                out,
            });
        });
    out
}

/// A part of the points.
struct Forward<'a> {
    spec: &'a HashGridSpec,
    points: &'a [f32],
    table: &'a [f32],
    out: &'a mut [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        encode(simd, self.spec, self.points, self.table, self.out);
    }
}

fn unsupported(features: usize) -> ! {
    panic!("hash grids have 1, 2, 4 or 8 features an entry, not {features}")
}

/// [`forward`] on the calling thread, in code compiled for `simd`.
#[inline(always)]
pub(crate) fn encode<S: Simd>(
    simd: S,
    spec: &HashGridSpec,
    points: &[f32],
    table: &[f32],
    out: &mut [f32],
) {
    match spec.features {
        1 => simd.vectorize(ForwardChunk::<1>(spec, points, table, out)),
        2 => simd.vectorize(ForwardChunk::<2>(spec, points, table, out)),
        4 => simd.vectorize(ForwardChunk::<4>(spec, points, table, out)),
        8 => simd.vectorize(ForwardChunk::<8>(spec, points, table, out)),
        other => unsupported(other),
    }
}

/// Points, table and encoded points.
struct ForwardChunk<'a, const F: usize>(&'a HashGridSpec, &'a [f32], &'a [f32], &'a mut [f32]);

impl<const F: usize> WithSimd for ForwardChunk<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self(spec, points, table, out) = self;
        let groups: Vec<Group> = points.chunks(GROUP * 3).map(Group::of).collect();
        let width = spec.outputs();
        #[cfg(target_arch = "x86_64")]
        let quads = pulp::x86::V3::try_new().filter(|_| F == 4);
        let mut cells = Cells::none();
        for index in 0..spec.levels {
            let level = spec.level(index);
            let table = &table[index * spec.level_params()..][..spec.level_params()];
            for (group, out) in groups.iter().zip(out.chunks_mut(GROUP * width)) {
                level.find(group, &mut cells);
                let out = &mut out[index * F..];
                #[cfg(target_arch = "x86_64")]
                if let Some(simd) = quads {
                    let quads = Quads {
                        simd,
                        cells: &cells,
                        entries: table.as_chunks().0,
                        width,
                        out,
                    };
                    Simd::vectorize(simd, quads);
                    continue;
                }
                cells.interpolate::<F>(table.as_chunks().0, width, out);
            }
        }
    }
}

/// Gradient of [`forward`] for the table. The points are not differentiated.
///
/// # Shapes
/// `grad`: `n × spec.outputs()`; result: `spec.params()`.
pub fn backward(spec: &HashGridSpec, points: &[f32], grad: &[f32]) -> Vec<f32> {
    assert_eq!(
        grad.len(),
        points.len() / 3 * spec.outputs(),
        "gradient of a hash encoding"
    );
    let mut table_grad = Vec::with_capacity(spec.params());
    table_grad.spare_capacity_mut()[..spec.params()]
        .par_chunks_mut(spec.level_params())
        .enumerate()
        // A level's zeros are still in this core's cache when gradients are added to them.
        .map(|(level, table_grad)| (level, zeroed(table_grad)))
        .for_each(|(level, table_grad)| match spec.features {
            1 => Arch::new().dispatch(BackwardLevel::<1>(spec, level, points, grad, table_grad)),
            2 => Arch::new().dispatch(BackwardLevel::<2>(spec, level, points, grad, table_grad)),
            4 => Arch::new().dispatch(BackwardLevel::<4>(spec, level, points, grad, table_grad)),
            8 => Arch::new().dispatch(BackwardLevel::<8>(spec, level, points, grad, table_grad)),
            other => unsupported(other),
        });
    // SAFETY: every level was zeroed, and the levels are all of it.
    unsafe { table_grad.set_len(spec.params()) };
    table_grad
}

fn zeroed(level: &mut [MaybeUninit<f32>]) -> &mut [f32] {
    level.fill(MaybeUninit::new(0.0));
    // SAFETY: just written.
    unsafe { level.assume_init_mut() }
}

/// Level, points, their gradient and the level's.
struct BackwardLevel<'a, const F: usize>(
    &'a HashGridSpec,
    usize,
    &'a [f32],
    &'a [f32],
    &'a mut [f32],
);

impl<const F: usize> WithSimd for BackwardLevel<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self(spec, index, points, grad, table_grad) = self;
        let (level, width) = (spec.level(index), spec.outputs());
        let (entries, _) = table_grad.as_chunks_mut::<F>();
        let grads = grad.chunks(GROUP * width);
        let mut cells = Cells::none();
        for (points, grads) in points.chunks(GROUP * 3).zip(grads) {
            level.find(&Group::of(points), &mut cells);
            cells.spread(&grads[index * F..], width, entries);
        }
    }
}
