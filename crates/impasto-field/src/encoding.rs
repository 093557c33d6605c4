//! Encodings of positions and directions.

use crate::config::EncodingConfig;
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::ops;
use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Rows encoded by one task.
const ROWS: usize = 256;

/// `[x, sin 2⁰x, cos 2⁰x, …, sin 2^(bands−1) x, cos 2^(bands−1) x]` of every row, no π (PAPER §2).
///
/// # Shapes
/// `rows`: `n × dimensions`; result: `n × dimensions · (1 + 2 · bands)`.
pub fn frequencies(rows: &[f32], dimensions: usize, bands: usize) -> Vec<f32> {
    let width = dimensions * (1 + 2 * bands);
    let mut out = vec![0.0; rows.len() / dimensions * width];
    out.par_chunks_mut(ROWS * width)
        .zip(rows.par_chunks(ROWS * dimensions))
        .for_each(|(out, rows)| {
            for i in 0..rows.len() / dimensions {
                let x = &rows[i * dimensions..][..dimensions];
                let (known, out) = out.split_at_mut(i * width);
                // All samples of a ray are seen from one direction.
                match known.rchunks_exact(width).next() {
                    Some(known) if known[..dimensions] == *x => out[..width].copy_from_slice(known),
                    _ => encode_row(x, &mut out[..width]),
                }
            }
        });
    out
}

fn encode_row(x: &[f32], out: &mut [f32]) {
    let (dimensions, width) = (x.len(), out.len());
    out[..dimensions].copy_from_slice(x);
    for (axis, x) in x.iter().enumerate() {
        // Doubling an angle also doubles the error: harmless in double precision.
        let (mut sin, mut cos) = f64::from(*x).sin_cos();
        for at in (dimensions + axis..width).step_by(2 * dimensions) {
            (out[at], out[at + dimensions]) = (sin as f32, cos as f32);
            (sin, cos) = (2.0 * sin * cos, (cos - sin) * (cos + sin));
        }
    }
}

/// [`frequencies`] of rows that are on a device; in single precision, for few bands.
///
/// # Shapes
/// `rows`: `[n, dimensions]`; result: `[n, dimensions · (1 + 2 · bands)]`.
pub fn frequencies_of(rows: &Tensor<2>, bands: usize) -> Tensor<2> {
    let mut parts = vec![rows.clone()];
    for band in 0..bands {
        let turned = rows.clone() * (1u32 << band) as f32;
        parts.extend([turned.clone().sin(), turned.cos()]);
    }
    Tensor::cat(parts, 1)
}

/// Encodes positions with the encoding's weights (the hash table; unused for frequencies).
///
/// # Shapes
/// `points`: `n × dimensions`, raw coordinates; `cube`: `n × 3`, the same in the unit cube;
/// result: `[n, config.outputs(dimensions)]`. Positions are not differentiated.
pub fn encode(config: &EncodingConfig, weights: &Tensor<1>, points: &Positions<'_>) -> Tensor<2> {
    match config {
        EncodingConfig::HashGrid(spec) => {
            let cube = matrix(points.cube.to_vec(), 3, &weights.device());
            ops::hash_encode(cube, weights.clone(), *spec)
        }
        EncodingConfig::Frequency { bands } => {
            let rows = frequencies(points.raw, points.dimensions, *bands);
            matrix(rows, config.outputs(points.dimensions), &weights.device())
        }
    }
}

/// Positions in both forms that encodings ask for.
#[derive(Debug, Clone, Copy)]
pub struct Positions<'a> {
    /// `n × dimensions`.
    pub raw: &'a [f32],
    /// 3 (inner) or 4 (outer).
    pub dimensions: usize,
    /// `n × 3`.
    pub cube: &'a [f32],
}

/// Size of a hash table's first entries (Müller et al. 2022).
const FIRST_ENTRIES: f32 = 1e-4;

/// A hash table's first entries; one number where there is no table.
pub(crate) fn first_entries(length: usize, rng: &mut Pcg64, device: &Device) -> Tensor<1> {
    let entries = (0..length).map(|_| rng.random_range(-FIRST_ENTRIES..FIRST_ENTRIES));
    vector(entries.collect(), device)
}

/// A flat vector as a tensor.
pub fn vector(data: Vec<f32>, device: &Device) -> Tensor<1> {
    let length = data.len();
    Tensor::from_data(TensorData::new(data, [length]), device)
}

/// What a failure of [`host`] begins with.
pub const LOST: &str = "numbers cannot be read back";

/// The numbers of a tensor, in row-major order.
///
/// # Panics
/// If its device is lost or has no memory left: nothing that was computed there can be trusted.
pub fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    // Every tensor of this program is f32, so that a conversion never fails for its type.
    tensor
        .try_into_vec_as::<f32>()
        .unwrap_or_else(|error| panic!("{LOST}: {error}"))
}

/// A row-major matrix as a tensor.
pub fn matrix(data: Vec<f32>, width: usize, device: &Device) -> Tensor<2> {
    let rows = data.len() / width;
    Tensor::from_data(TensorData::new(data, [rows, width]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_repeat_are_encoded_like_rows_that_do_not() {
        let (a, b) = ([0.3, -1.2, 2.0], [f32::NAN, 0.5, 0.1]);
        let found = frequencies(&[a, a, b, b, a].concat(), 3, 4);
        let alone = [a, a, b, b, a].map(|row| frequencies(&row, 3, 4)).concat();
        let bits = |all: &[f32]| all.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found), bits(&alone));
    }
}
