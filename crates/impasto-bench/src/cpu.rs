//! Times on the CPU, with the plain tensor library beside them.

use crate::cases::*;
use crate::report::{BenchReport, Timing};
use crate::{peak, plain};
use impasto_kernels::cpu::{composite, hash_grid, mlp};
use impasto_kernels::{Activation, CompositeLayout, MlpSpec};
use std::hint::black_box;
use std::time::Instant;

/// Runs of which the fastest counts.
const RUNS: usize = 7;
/// Rows of MLPs and points of hash grids.
const ROWS: usize = 65_536;

fn fastest<R>(mut f: impl FnMut() -> R) -> f64 {
    black_box(f());
    let times = (0..RUNS).map(|_| {
        let start = Instant::now();
        black_box(f());
        start.elapsed().as_secs_f64()
    });
    times.fold(f64::MAX, f64::min)
}

/// Measures the kernels on the CPU; takes some seconds.
pub fn run() -> BenchReport {
    let peak = peak::gflops();
    let mut kernels = perceptual().to_vec();
    for widths in [
        &[32, 64, 64, 16][..],
        &[32, 64, 32],
        &[47, 64, 64, 3],
        &[128, 128, 128, 128, 128, 3],
    ] {
        kernels.push(small_mlp(widths));
    }
    for (features, log2_entries) in [(2, 15), (4, 15), (4, 16)] {
        kernels.extend(grid(features, log2_entries));
    }
    kernels.push(compositing());
    BenchReport::new(None, peak, kernels)
}

fn perceptual() -> [Timing; 2] {
    let weights = vgg_weights();
    let (stack, [height, width]) = (stack(&weights), PATCH);
    let image = numbers(height * width * 3, 0.5);
    let (features, _) = stack.forward(&image, height, width);
    let grad = numbers(features.len(), 1.0);
    let both = fastest(|| {
        let (_, tape) = stack.forward(&image, height, width);
        stack.backward(&tape, &grad)
    });
    let forward = fastest(|| stack.forward(&image, height, width).0);
    let [both, forward] = perceptual_timings(both, forward);
    let plain = fastest(plain::perceptual(&VGG, &weights, &image, PATCH));
    [both.beside(plain), forward]
}

fn small_mlp(widths: &[usize]) -> Timing {
    let spec = MlpSpec::relu(widths, false, Activation::Relu);
    let x = numbers(ROWS * spec.inputs(), 1.0);
    let params = numbers(spec.params(), 0.2);
    let grad = numbers(ROWS * spec.outputs(), 1.0);
    let seconds = fastest(|| {
        let out = mlp::forward(&spec, &x, &params);
        (out, mlp::backward(&spec, &x, &params, &grad, true))
    });
    mlp_timing(widths, ROWS, seconds).beside(fastest(plain::mlp(widths, &x, &params, &grad)))
}

fn grid(features: usize, log2_entries: u32) -> [Timing; 2] {
    let (spec, points) = (grid_spec(features, log2_entries), points(ROWS));
    let table = numbers(spec.params(), 0.1);
    let grad = numbers(ROWS * spec.outputs(), 1.0);
    let forward = fastest(|| hash_grid::forward(&spec, &points, &table));
    let backward = fastest(|| hash_grid::backward(&spec, &points, &grad));
    [("forward", forward), ("backward", backward)]
        .map(|(what, seconds)| grid_timing(&spec, what, ROWS, seconds))
}

fn compositing() -> Timing {
    let (layout, (sigma, colours)) = (layout(), samples());
    let grad = numbers(RAYS * CompositeLayout::outputs(3), 1.0);
    let seconds = fastest(|| {
        let out = composite::forward(&layout, &sigma, &colours, 3);
        (
            out,
            composite::backward(&layout, &sigma, &colours, 3, &grad),
        )
    });
    let plain = plain::composite(RAYS, PER_RAY, &sigma, &colours);
    composite_timing(seconds).beside(fastest(plain))
}
