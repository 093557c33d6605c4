//! Multi-resolution hash-grid encoding (Müller et al. 2022, "Instant Neural Graphics Primitives").

use rayon::prelude::*;

/// Corners of a cell.
const CORNERS: usize = 8;
/// Points handled together at one level, so that the level's table stays in cache.
const CHUNK: usize = 1024;
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// Sizes of a hash grid. The table is laid out `[level][entry][feature]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HashGridSpec {
    /// Number of resolutions.
    pub levels: usize,
    /// Numbers per entry: 1, 2, 4 or 8.
    pub features: usize,
    /// log₂ of the entries per level.
    pub log2_entries: u32,
    /// Cells along an axis at the coarsest level.
    pub coarsest: f32,
    /// Cells along an axis at the finest level.
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

    fn level(&self, level: usize) -> Level {
        let resolution = self.resolution(level);
        let side = resolution as u64 + 1;
        let entries = 1u64 << self.log2_entries;
        Level {
            resolution,
            side: side as u32,
            mask: (entries - 1) as u32,
            dense: side * side * side <= entries,
        }
    }
}

#[derive(Clone, Copy)]
struct Level {
    resolution: f32,
    side: u32,
    mask: u32,
    dense: bool,
}

impl Level {
    /// Table entries and interpolation weights of a point's cell. A point that is not finite has
    /// weight nowhere, so that it encodes to zeros and receives no gradient.
    #[inline(always)]
    fn cell(self, point: &[f32]) -> ([u32; CORNERS], [f32; CORNERS]) {
        let mut base = [0u32; 3];
        let mut frac = [0f32; 3];
        let mut scale = 1.0;
        for axis in 0..3 {
            let x = point[axis];
            if !x.is_finite() {
                scale = 0.0;
                continue;
            }
            let scaled = x.clamp(0.0, 1.0) * self.resolution;
            let floor = (scaled as u32).min(self.side.saturating_sub(2));
            base[axis] = floor;
            frac[axis] = scaled - floor as f32;
        }
        let mut entries = [0u32; CORNERS];
        let mut weights = [0f32; CORNERS];
        for corner in 0..CORNERS {
            let offset = [corner & 1, (corner >> 1) & 1, corner >> 2];
            let mut weight = scale;
            let mut at = [0u32; 3];
            for axis in 0..3 {
                at[axis] = base[axis] + offset[axis] as u32;
                weight *= if offset[axis] == 1 {
                    frac[axis]
                } else {
                    1.0 - frac[axis]
                };
            }
            entries[corner] = if self.dense {
                at[0] + self.side * (at[1] + self.side * at[2])
            } else {
                (at[0].wrapping_mul(PRIMES[0])
                    ^ at[1].wrapping_mul(PRIMES[1])
                    ^ at[2].wrapping_mul(PRIMES[2]))
                    & self.mask
            };
            weights[corner] = weight;
        }
        (entries, weights)
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
        .for_each(|(out, points)| match spec.features {
            1 => forward_chunk::<1>(spec, points, table, out),
            2 => forward_chunk::<2>(spec, points, table, out),
            4 => forward_chunk::<4>(spec, points, table, out),
            8 => forward_chunk::<8>(spec, points, table, out),
            other => unsupported(other),
        });
    out
}

fn unsupported(features: usize) -> ! {
    panic!("hash grids have 1, 2, 4 or 8 features an entry, not {features}")
}

fn forward_chunk<const F: usize>(
    spec: &HashGridSpec,
    points: &[f32],
    table: &[f32],
    out: &mut [f32],
) {
    for level_index in 0..spec.levels {
        let level = spec.level(level_index);
        let table = &table[level_index * spec.level_params()..][..spec.level_params()];
        let (entries, _) = table.as_chunks::<F>();
        for (point, out) in points
            .chunks_exact(3)
            .zip(out.chunks_exact_mut(spec.outputs()))
        {
            let (cells, weights) = level.cell(point);
            let mut sum = [0f32; F];
            for corner in 0..CORNERS {
                let entry = &entries[cells[corner] as usize];
                for f in 0..F {
                    sum[f] += weights[corner] * entry[f];
                }
            }
            out[level_index * F..][..F].copy_from_slice(&sum);
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
    let mut table_grad = vec![0.0; spec.params()];
    table_grad
        .par_chunks_mut(spec.level_params())
        .enumerate()
        .for_each(|(level, table_grad)| match spec.features {
            1 => backward_level::<1>(spec, level, points, grad, table_grad),
            2 => backward_level::<2>(spec, level, points, grad, table_grad),
            4 => backward_level::<4>(spec, level, points, grad, table_grad),
            8 => backward_level::<8>(spec, level, points, grad, table_grad),
            other => unsupported(other),
        });
    table_grad
}

fn backward_level<const F: usize>(
    spec: &HashGridSpec,
    level_index: usize,
    points: &[f32],
    grad: &[f32],
    table_grad: &mut [f32],
) {
    let level = spec.level(level_index);
    let (entries, _) = table_grad.as_chunks_mut::<F>();
    for (point, grad) in points
        .chunks_exact(3)
        .zip(grad.chunks_exact(spec.outputs()))
    {
        let grad = &grad[level_index * F..][..F];
        if grad.iter().all(|g| *g == 0.0) {
            continue;
        }
        let (cells, weights) = level.cell(point);
        for corner in 0..CORNERS {
            let entry = &mut entries[cells[corner] as usize];
            for f in 0..F {
                entry[f] += weights[corner] * grad[f];
            }
        }
    }
}
