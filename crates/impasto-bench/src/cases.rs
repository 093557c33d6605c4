//! What is computed on every device: inputs, names, and how much work each is.

use crate::report::Timing;
use burn::tensor::{Device, Tensor, TensorData};
use impasto_kernels::{CompositeLayout, ConvLayer, HashGridSpec, PerceptualStack, RaySpan};

/// Height and width of the perceptual stack's image: the paper's patch.
pub(crate) const PATCH: [usize; 2] = [67, 81];
/// Rays that are composited, and samples of each.
pub(crate) const RAYS: usize = PATCH[0] * PATCH[1];
pub(crate) const PER_RAY: usize = 64;

/// Deterministic numbers in ±`size`.
pub(crate) fn numbers(count: usize, size: f32) -> Vec<f32> {
    let mut state = 1u64;
    let next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 / (1u64 << 23) as f32 - 1.0) * size
    };
    std::iter::repeat_with(next).take(count).collect()
}

pub(crate) fn tensor<const D: usize>(
    data: Vec<f32>,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(data, shape), device)
}

/// Inputs, outputs and whether a pool comes before, of VGG-16's layers up to conv4_1.
pub(crate) const VGG: [(usize, usize, bool); 8] = [
    (3, 64, false),
    (64, 64, false),
    (64, 128, true),
    (128, 128, false),
    (128, 256, true),
    (256, 256, false),
    (256, 256, false),
    (256, 512, true),
];

pub(crate) fn vgg_weights() -> Vec<Vec<f32>> {
    let weights = VGG.iter().map(|(inputs, outputs, _)| {
        numbers(9 * inputs * outputs, (6.0 / (9.0 * *inputs as f32)).sqrt())
    });
    weights.collect()
}

pub(crate) fn stack(weights: &[Vec<f32>]) -> PerceptualStack {
    let layers = VGG.iter().zip(weights);
    let layers = layers.map(|((_, outputs, pool), weight)| {
        ConvLayer::new(weight, vec![0.01; *outputs], *pool, *pool)
    });
    PerceptualStack::new(layers.collect(), 1.0, [0.5; 3])
}

/// What convolutions take on an image.
fn vgg_flops([mut h, mut w]: [usize; 2]) -> f64 {
    let mut flops = 0.0;
    for (inputs, outputs, pool) in VGG {
        if pool {
            (h, w) = (h / 2, w / 2);
        }
        flops += 2.0 * (h * w * 9 * inputs * outputs) as f64;
    }
    flops
}

/// The stack's time there and back, and its time forward alone, in seconds.
pub(crate) fn perceptual_timings(both: f64, forward: f64) -> [Timing; 2] {
    let ([height, width], flops) = (PATCH, vgg_flops(PATCH));
    let timing = |what: &str, seconds: f64, flops: f64| {
        let name = format!("VGG-16 to relu4_1 on {height}×{width}, {what}");
        Timing::new(name, seconds, height * width, Some(flops))
    };
    [
        timing("forward + backward", both, 2.0 * flops),
        timing("forward", forward, flops),
    ]
}

/// The time of an MLP of these widths over so many rows, there and back.
pub(crate) fn mlp_timing(widths: &[usize], rows: usize, seconds: f64) -> Timing {
    let text: Vec<String> = widths.iter().map(ToString::to_string).collect();
    let name = format!("MLP {} forward + backward", text.join("-"));
    let products: usize = widths.windows(2).map(|w| w[0] * w[1]).sum();
    Timing::new(name, seconds, rows, Some(6.0 * (products * rows) as f64))
}

pub(crate) fn grid_spec(features: usize, log2_entries: u32) -> HashGridSpec {
    HashGridSpec {
        levels: 8,
        features,
        log2_entries,
        coarsest: 16.0,
        finest: 1024.0,
    }
}

/// Points of rays of about 100 samples, as a field is sampled.
pub(crate) fn points(rows: usize) -> Vec<f32> {
    let mut points = Vec::with_capacity(3 * rows);
    for start in numbers(rows / 100 * 3 + 3, 0.5).chunks_exact(3) {
        let at = |i: usize| [0, 1, 2].map(|axis| (start[axis] + 0.5 + 0.004 * i as f32).fract());
        points.extend((0..100).flat_map(at));
    }
    points.truncate(3 * rows);
    points
}

/// The time of `what` with a hash grid, over so many points.
pub(crate) fn grid_timing(spec: &HashGridSpec, what: &str, rows: usize, seconds: f64) -> Timing {
    let (features, log2_entries) = (spec.features, spec.log2_entries);
    let name = format!("hash grid 8×{features}, 2^{log2_entries} entries, {what}");
    Timing::new(name, seconds, rows, None)
}

/// Rays of as many samples each, in one volume.
pub(crate) fn layout() -> CompositeLayout {
    let count = RAYS * PER_RAY;
    let span = |ray: usize| RaySpan {
        inner: 0..0,
        outer: ray * PER_RAY..(ray + 1) * PER_RAY,
    };
    CompositeLayout {
        rays: (0..RAYS).map(span).collect(),
        deltas: vec![0.02; count],
        depths: vec![1.0; count],
        distances: (0..count).map(|i| (i % PER_RAY) as f32 / 64.0).collect(),
    }
}

/// Densities and colours of the samples of [`layout`].
pub(crate) fn samples() -> (Vec<f32>, Vec<f32>) {
    let sigma = numbers(RAYS * PER_RAY, 3.0).into_iter().map(f32::abs);
    (sigma.collect(), numbers(RAYS * PER_RAY * 3, 1.0))
}

/// The time of compositing them, there and back.
pub(crate) fn composite_timing(seconds: f64) -> Timing {
    let name = format!("compositing {RAYS}×{PER_RAY} forward + backward");
    Timing::new(name, seconds, RAYS * PER_RAY, None)
}
