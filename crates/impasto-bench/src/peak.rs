//! What the machine can do at most.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

/// Independent sums: more than the latency of a multiply-add times the number of units.
const SUMS: usize = 12;
/// Rounds between two looks of the optimiser, which must not see that nothing changes.
const UNSEEN: usize = 64;
const ROUNDS: usize = 60_000;
/// Neighbours on a shared machine slow single runs down.
const RUNS: usize = 5;

struct MultiplyAdd;

impl WithSimd for MultiplyAdd {
    /// Number of multiplications and additions, and a result that keeps them alive.
    type Output = (f64, f32);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (f64, f32) {
        let mut sums = [simd.splat_f32s(1.0); SUMS];
        let add = simd.splat_f32s(1e-3);
        for _ in 0..ROUNDS {
            let factor = black_box(simd.splat_f32s(0.999));
            for _ in 0..UNSEEN {
                for sum in &mut sums {
                    *sum = simd.mul_add_e_f32s(*sum, factor, add);
                }
            }
        }
        let total = sums.iter().fold(add, |a, b| simd.add_f32s(a, *b));
        let count = (2 * ROUNDS * UNSEEN * SUMS * S::F32_LANES) as f64;
        (count, simd.reduce_sum_f32s(total))
    }
}

/// Billions of single-precision multiplications and additions a second, all threads together.
pub(crate) fn gflops() -> f64 {
    let runs = (0..RUNS).map(|_| {
        let start = Instant::now();
        let threads = rayon::current_num_threads();
        let count: f64 = (0..threads)
            .into_par_iter()
            .with_max_len(1)
            .map(|_| black_box(Arch::new().dispatch(MultiplyAdd)).0)
            .sum();
        count / start.elapsed().as_secs_f64() / 1e9
    });
    runs.fold(0.0, f64::max)
}
