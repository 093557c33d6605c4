//! Times of the hot kernels, as shares of what the machine can do at all; on the CPU with the plain
//! tensor library beside them in the same run.

mod device;
mod machine;
mod peak;
mod plain;

use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::cpu::{composite, hash_grid, mlp};
use impasto_kernels::{
    Activation, CompositeLayout, ConvLayer, HashGridSpec, MlpSpec, PerceptualStack, RaySpan,
};
pub use machine::Machine;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// One kernel's time.
#[derive(Debug, Clone, Serialize)]
pub struct Timing {
    /// What was computed.
    pub name: String,
    /// Milliseconds, the fastest of several runs.
    pub milliseconds: f64,
    /// Nanoseconds per row, point, pixel or sample.
    pub nanoseconds_each: f64,
    /// Billions of multiplications and additions a second that the result needs (recomputation
    /// does not count), where those dominate.
    pub gflops: Option<f64>,
    /// The same as a share of the machine's peak.
    pub share_of_peak: Option<f64>,
    /// Milliseconds of the tensor library, where it can do the same.
    pub plain_milliseconds: Option<f64>,
}

/// All timings of a machine.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// What they were taken on.
    #[serde(flatten)]
    pub machine: Machine,
    /// The GPU, where they are not the processor's.
    pub device: Option<String>,
    /// Billions of multiplications and additions a second that all threads reach together in
    /// registers; on a GPU, that a product of large matrices reaches.
    pub peak_gflops: f64,
    /// Kernels.
    pub kernels: Vec<Timing>,
}

/// Runs of which the fastest counts.
const RUNS: usize = 7;
/// Rows of MLPs and points of hash grids.
const ROWS: usize = 65_536;
/// Height and width of the perceptual stack's image: the paper's patch.
const PATCH: [usize; 2] = [67, 81];

fn fastest<R>(mut f: impl FnMut() -> R) -> f64 {
    black_box(f());
    let times = (0..RUNS).map(|_| {
        let start = Instant::now();
        black_box(f());
        start.elapsed().as_secs_f64()
    });
    times.fold(f64::MAX, f64::min)
}

/// Deterministic numbers in ±`size`.
fn numbers(count: usize, size: f32) -> Vec<f32> {
    let mut state = 1u64;
    let next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 / (1u64 << 23) as f32 - 1.0) * size
    };
    std::iter::repeat_with(next).take(count).collect()
}

fn tensor<const D: usize>(data: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(data, shape), device)
}

/// Measures the kernels on a GPU of this name; takes some seconds.
pub fn run_on(device: &Device, name: &str) -> Report {
    device::run(device, name)
}

/// Measures the kernels on the CPU; takes some seconds.
pub fn run() -> Report {
    let peak = peak::gflops();
    let mut report = Report {
        machine: Machine::this(),
        device: None,
        peak_gflops: peak,
        kernels: Vec::new(),
    };
    let (both, forward) = perceptual_stack();
    report.kernels.push(both);
    report.kernels.push(forward);
    for widths in [&[32, 64, 64, 16][..], &[32, 64, 32], &[47, 64, 64, 3]] {
        report.kernels.push(small_mlp(widths));
    }
    report
        .kernels
        .push(small_mlp(&[128, 128, 128, 128, 128, 3]));
    for (features, log2_entries) in [(2, 15), (4, 15), (4, 16)] {
        report.kernels.extend(grid(features, log2_entries));
    }
    report.kernels.push(compositing());
    for kernel in &mut report.kernels {
        kernel.share_of_peak = kernel.gflops.map(|g| g / peak);
    }
    report
}

fn timing(name: String, seconds: f64, each: usize, flops: Option<f64>) -> Timing {
    Timing {
        name,
        milliseconds: seconds * 1e3,
        nanoseconds_each: seconds * 1e9 / each as f64,
        gflops: flops.map(|f| f / seconds / 1e9),
        share_of_peak: None,
        plain_milliseconds: None,
    }
}

/// Inputs, outputs and whether a pool comes before, of VGG-16's layers up to conv4_1.
const VGG: [(usize, usize, bool); 8] = [
    (3, 64, false),
    (64, 64, false),
    (64, 128, true),
    (128, 128, false),
    (128, 256, true),
    (256, 256, false),
    (256, 256, false),
    (256, 512, true),
];

fn vgg_weights() -> Vec<Vec<f32>> {
    VGG.iter()
        .map(|(inputs, outputs, _)| {
            numbers(9 * inputs * outputs, (6.0 / (9.0 * *inputs as f32)).sqrt())
        })
        .collect()
}

fn stack() -> PerceptualStack {
    let weights = vgg_weights();
    let layers = VGG
        .iter()
        .zip(&weights)
        .map(|((_, outputs, pool), weight)| {
            ConvLayer::new(weight, vec![0.01; *outputs], *pool, *pool)
        });
    PerceptualStack::new(layers.collect(), 1.0, [0.5; 3])
}

/// What convolutions take on an image.
fn vgg_flops(layers: &[(usize, usize, bool)], [mut h, mut w]: [usize; 2]) -> f64 {
    let mut flops = 0.0;
    for (inputs, outputs, pool) in layers {
        if *pool {
            (h, w) = (h / 2, w / 2);
        }
        flops += 2.0 * (h * w * 9 * inputs * outputs) as f64;
    }
    flops
}

fn perceptual_stack() -> (Timing, Timing) {
    let (weights, stack) = (vgg_weights(), stack());
    let [height, width] = PATCH;
    let image: Vec<f32> = numbers(height * width * 3, 0.5);
    let (features, _) = stack.forward(&image, height, width);
    let grad = numbers(features.len(), 1.0);
    let both = fastest(|| {
        let (_, tape) = stack.forward(&image, height, width);
        stack.backward(&tape, &grad)
    });
    let forward = fastest(|| stack.forward(&image, height, width).0);
    let flops = vgg_flops(&VGG, PATCH);
    let name = |what: &str| format!("VGG-16 to relu4_1 on {height}×{width}, {what}");
    let pixels = height * width;
    let mut timed = timing(name("forward + backward"), both, pixels, Some(2.0 * flops));
    timed.plain_milliseconds =
        Some(1e3 * fastest(plain::perceptual(&VGG, &weights, &image, PATCH)));
    (timed, timing(name("forward"), forward, pixels, Some(flops)))
}

/// Multiplications of a row.
fn macs(widths: &[usize]) -> usize {
    widths.windows(2).map(|w| w[0] * w[1]).sum()
}

fn mlp_name(widths: &[usize]) -> String {
    let text: Vec<String> = widths.iter().map(ToString::to_string).collect();
    format!("MLP {} forward + backward", text.join("-"))
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
    let flops = 6.0 * (macs(widths) * ROWS) as f64;
    let mut timed = timing(mlp_name(widths), seconds, ROWS, Some(flops));
    timed.plain_milliseconds = Some(1e3 * fastest(plain::mlp(widths, &x, &params, &grad)));
    timed
}

fn spec_of(features: usize, log2_entries: u32) -> HashGridSpec {
    HashGridSpec {
        levels: 8,
        features,
        log2_entries,
        coarsest: 16.0,
        finest: 1024.0,
    }
}

/// Points of rays of about 100 samples, as a field is sampled.
fn points(rows: usize) -> Vec<f32> {
    let mut points = Vec::with_capacity(3 * rows);
    for start in numbers(rows / 100 * 3 + 3, 0.5).chunks_exact(3) {
        points
            .extend((0..100).flat_map(|i| {
                [0, 1, 2].map(|axis| (start[axis] + 0.5 + 0.004 * i as f32).fract())
            }));
    }
    points.truncate(3 * rows);
    points
}

fn grid(features: usize, log2_entries: u32) -> [Timing; 2] {
    let (spec, points) = (spec_of(features, log2_entries), points(ROWS));
    let table = numbers(spec.params(), 0.1);
    let grad = numbers(ROWS * spec.outputs(), 1.0);
    let name = |what| format!("hash grid 8×{features}, 2^{log2_entries} entries, {what}");
    let forward = fastest(|| hash_grid::forward(&spec, &points, &table));
    let backward = fastest(|| hash_grid::backward(&spec, &points, &grad));
    [
        timing(name("forward"), forward, ROWS, None),
        timing(name("backward"), backward, ROWS, None),
    ]
}

/// Rays of as many samples each, in one volume.
fn layout(rays: usize, per_ray: usize) -> CompositeLayout {
    let count = rays * per_ray;
    CompositeLayout {
        rays: (0..rays)
            .map(|i| RaySpan {
                inner: 0..0,
                outer: i * per_ray..(i + 1) * per_ray,
            })
            .collect(),
        deltas: vec![0.02; count],
        depths: vec![1.0; count],
        distances: (0..count).map(|i| (i % per_ray) as f32 / 64.0).collect(),
    }
}

fn compositing() -> Timing {
    let (rays, per_ray) = (PATCH[0] * PATCH[1], 64);
    let (count, layout) = (rays * per_ray, layout(rays, per_ray));
    let sigma: Vec<f32> = numbers(count, 3.0).into_iter().map(f32::abs).collect();
    let colours = numbers(count * 3, 1.0);
    let grad = numbers(rays * CompositeLayout::outputs(3), 1.0);
    let seconds = fastest(|| {
        let out = composite::forward(&layout, &sigma, &colours, 3);
        (
            out,
            composite::backward(&layout, &sigma, &colours, 3, &grad),
        )
    });
    let name = format!("compositing {rays}×{per_ray} forward + backward");
    let mut timed = timing(name, seconds, count, None);
    timed.plain_milliseconds =
        Some(1e3 * fastest(plain::composite(rays, per_ray, &sigma, &colours)));
    timed
}
