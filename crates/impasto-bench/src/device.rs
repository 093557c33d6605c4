//! Times of the same kernels on a device other than the CPU: launched many times in a row, since a
//! single launch measures the way there and back.

use crate::cases::*;
use crate::report::{BenchReport, Timing};
use burn::tensor::{Device, Tensor};
use impasto_kernels::{Activation, MlpSpec, ops};
use std::sync::Arc;
use std::time::Instant;

/// Rows of MLPs and points of hash grids: what keeps a large GPU busy.
const ROWS: usize = 1 << 18;
/// Launches of one run, and runs of which the fastest counts.
const LAUNCHES: usize = 10;
const RUNS: usize = 5;
/// Rows and columns of the matrices whose product stands for the device's peak.
const PEAK: usize = 4096;

/// Seconds of one call; infinite if the device is lost.
fn fastest<R>(device: &Device, mut f: impl FnMut() -> R) -> f64 {
    // Kernels are compiled at their first launch.
    drop(f());
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        if device.sync().is_err() {
            return f64::INFINITY;
        }
        let start = Instant::now();
        for _ in 0..LAUNCHES {
            drop(f());
        }
        if device.sync().is_err() {
            return f64::INFINITY;
        }
        best = best.min(start.elapsed().as_secs_f64() / LAUNCHES as f64);
    }
    best
}

/// Measures the kernels on a GPU of this name; takes some seconds.
pub fn run_on(device: &Device, name: &str) -> BenchReport {
    let peak = peak(device);
    let mut kernels = perceptual(device).to_vec();
    for widths in [
        &[32, 64, 32][..],
        &[47, 32, 32, 3],
        &[128, 128, 128, 128, 128, 3],
    ] {
        kernels.push(small_mlp(widths, device));
    }
    kernels.extend(grid(device));
    kernels.push(compositing(device));
    BenchReport::new(Some(name), peak, kernels)
}

/// What the tensor library's product of large matrices reaches.
fn peak(device: &Device) -> f64 {
    let side = |seed: f32| -> Tensor<2> { tensor(numbers(PEAK * PEAK, seed), [PEAK; 2], device) };
    let (a, b) = (side(0.1), side(0.2));
    let seconds = fastest(device, || a.clone().matmul(b.clone()));
    2.0 * (PEAK as f64).powi(3) / seconds / 1e9
}

fn perceptual(device: &Device) -> [Timing; 2] {
    let ([height, width], stack) = (PATCH, Arc::new(stack(&vgg_weights())));
    let numbers = numbers(height * width * 3, 0.5);
    let image: Tensor<3> = tensor(numbers.clone(), [height, width, 3], device);
    let forward = fastest(device, || {
        ops::perceptual(image.clone(), Arc::clone(&stack))
    });
    let image: Tensor<3> = tensor(numbers, [height, width, 3], &device.clone().autodiff());
    let both = fastest(device, || {
        let image = image.clone().require_grad();
        ops::perceptual(image, Arc::clone(&stack)).sum().backward()
    });
    perceptual_timings(both, forward)
}

fn small_mlp(widths: &[usize], device: &Device) -> Timing {
    let spec = MlpSpec::relu(widths, false, Activation::Relu);
    let tracked = device.clone().autodiff();
    let x: Tensor<2> = tensor(
        numbers(ROWS * spec.inputs(), 1.0),
        [ROWS, spec.inputs()],
        &tracked,
    );
    let params: Tensor<1> = tensor(numbers(spec.params(), 0.2), [spec.params()], &tracked);
    let seconds = fastest(device, || {
        let (x, params) = (x.clone().require_grad(), params.clone().require_grad());
        ops::mlp(x, params, &spec).sum().backward()
    });
    mlp_timing(widths, ROWS, seconds)
}

fn grid(device: &Device) -> [Timing; 2] {
    let spec = grid_spec(4, 16);
    let points: Tensor<2> = tensor(points(ROWS), [ROWS, 3], device);
    let table = numbers(spec.params(), 0.1);
    let plain: Tensor<1> = tensor(table.clone(), [spec.params()], device);
    let forward = fastest(device, || {
        ops::hash_encode(points.clone(), plain.clone(), spec)
    });
    let tracked: Tensor<1> = tensor(table, [spec.params()], &device.clone().autodiff());
    let fixed = Tensor::from_inner(points.clone());
    let both = fastest(device, || {
        let table = tracked.clone().require_grad();
        ops::hash_encode(fixed.clone(), table, spec)
            .sum()
            .backward()
    });
    [("forward", forward), ("forward + backward", both)]
        .map(|(what, seconds)| grid_timing(&spec, what, ROWS, seconds))
}

fn compositing(device: &Device) -> Timing {
    let (count, layout) = (RAYS * PER_RAY, Arc::new(layout()));
    let tracked = device.clone().autodiff();
    let (sigma, colours) = samples();
    let sigma: Tensor<1> = tensor(sigma, [count], &tracked);
    let colours: Tensor<2> = tensor(colours, [count, 3], &tracked);
    let seconds = fastest(device, || {
        let (sigma, colours) = (sigma.clone().require_grad(), colours.clone().require_grad());
        let out = ops::composite(sigma, colours, Arc::clone(&layout));
        out.sum().backward()
    });
    composite_timing(seconds)
}
