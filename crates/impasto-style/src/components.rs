//! Principal components of a set of vectors.

use crate::hypernetwork::normal;
use burn::tensor::{Device, Tensor, TensorData};
use rand_pcg::Pcg64;

/// Orthonormal directions, most variance first.
#[derive(Debug, Clone)]
pub(crate) struct Components {
    /// Row-major, `count × dimensions`.
    pub directions: Vec<f32>,
    /// Variance along each direction.
    pub variances: Vec<f32>,
}

/// Rounds of subspace iteration: directions far apart in variance converge in a few; among
/// near-equal ones any order is as good.
const ROUNDS: usize = 12;

/// The `count` directions along which the rows of `data`, `n × dimensions` with mean zero, vary
/// most, by orthogonal (subspace) iteration. Directions beyond the data's rank are arbitrary and
/// have no variance.
pub(crate) fn principal_components(
    data: &[f32],
    dimensions: usize,
    count: usize,
    rng: &mut Pcg64,
    device: &Device,
) -> Components {
    let n = data.len() / dimensions;
    let rows = Tensor::<2>::from_data(TensorData::new(data.to_vec(), [n, dimensions]), device);
    let mut directions: Vec<f32> = (0..count * dimensions).map(|_| normal(rng)).collect();
    orthonormalise(&mut directions, dimensions);
    let scores = |directions: &[f32]| {
        let basis = TensorData::new(directions.to_vec(), [count, dimensions]);
        Tensor::<2>::from_data(basis, device).matmul(rows.clone().transpose())
    };
    for _ in 0..ROUNDS {
        let next = scores(&directions).matmul(rows.clone()) / n as f32;
        directions = numbers(next.reshape([count * dimensions]));
        orthonormalise(&mut directions, dimensions);
    }
    let variances = scores(&directions).square().mean_dim(1);
    Components {
        directions,
        variances: numbers(variances.reshape([count])),
    }
}

fn numbers(tensor: Tensor<1>) -> Vec<f32> {
    tensor.try_into_vec_as::<f32>().unwrap_or_default()
}

/// Modified Gram–Schmidt over rows, twice, because once loses orthogonality in single precision.
fn orthonormalise(rows: &mut [f32], width: usize) {
    for _ in 0..2 {
        for i in 0..rows.len() / width {
            let (done, rest) = rows.split_at_mut(i * width);
            let row = &mut rest[..width];
            for earlier in done.chunks_exact(width) {
                let along = dot(earlier, row);
                row.iter_mut()
                    .zip(earlier)
                    .for_each(|(r, e)| *r -= along * e);
            }
            let length = dot(row, row).sqrt().max(1e-20);
            row.iter_mut().for_each(|r| *r /= length);
        }
    }
}

/// Sums in lanes, which a compiler can keep in one vector register.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut lanes = [0.0f32; LANES];
    let (a_chunks, a_rest) = a.as_chunks::<LANES>();
    let (b_chunks, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += a * b;
        }
    }
    let rest = a_rest.iter().zip(b_rest).map(|(a, b)| a * b);
    lanes.into_iter().chain(rest).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn finds_the_axes_of_an_ellipsoid() {
        let mut rng = Pcg64::seed_from_u64(3);
        let (s, c) = 0.5f32.sin_cos();
        let data: Vec<f32> = (0..4000)
            .flat_map(|_| {
                let (a, b, d) = (
                    3.0 * normal(&mut rng),
                    normal(&mut rng),
                    0.1 * normal(&mut rng),
                );
                [c * a - s * b, s * a + c * b, d]
            })
            .collect();
        let found = principal_components(&data, 3, 2, &mut rng, &Device::flex());
        assert!((dot(&found.directions[..3], &[c, s, 0.0]).abs() - 1.0).abs() < 1e-3);
        assert!((dot(&found.directions[3..], &[-s, c, 0.0]).abs() - 1.0).abs() < 1e-3);
        assert!((found.variances[0] - 9.0).abs() < 0.5 && (found.variances[1] - 1.0).abs() < 0.1);
    }
}
