//! What the kernels' tests share: seeded numbers, tensors, comparisons, central differences.
#![allow(dead_code, reason = "every test file takes what it needs")]

pub mod convnet;
pub mod on;

use burn::tensor::{Gradients, Tensor, TensorData};
use impasto_kernels::RaySpan;
pub use impasto_kernels::device::tested as device;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::ThreadPoolBuilder;
use safetensors::SafeTensors;
use std::ops::Range;
use std::path::Path;

/// `count` uniform numbers; the same for the same seed on every machine.
pub fn numbers(seed: u64, count: usize, range: Range<f32>) -> Vec<f32> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..count)
        .map(|_| rng.random_range(range.clone()))
        .collect()
}

/// An untracked tensor on a device that can differentiate.
pub fn tensor<const D: usize>(data: &[f32], shape: [usize; D]) -> Tensor<D> {
    Tensor::from_data(TensorData::new(data.to_vec(), shape), &device().autodiff())
}

/// A leaf of a graph.
pub fn leaf<const D: usize>(data: &[f32], shape: [usize; D]) -> Tensor<D> {
    tensor(data, shape).require_grad()
}

/// Rays with no to six inner and one to four outer samples, packed ray by ray.
pub fn spans(rays: usize) -> Vec<RaySpan> {
    let counts: Vec<[usize; 2]> = (0..rays).map(|ray| [ray % 7, 1 + ray / 7 % 4]).collect();
    let mut at = [0, counts.iter().map(|c| c[0]).sum()];
    let spans = counts.iter().map(|count| {
        let [inner, outer] = [0, 1].map(|v| at[v]..at[v] + count[v]);
        at = [inner.end, outer.end];
        RaySpan { inner, outer }
    });
    spans.collect()
}

/// A tensor's numbers in row-major order.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_to_vec().expect("a float tensor")
}

/// Gradients of `Σ output · weights`.
pub fn backward<const D: usize>(output: Tensor<D>, weights: &[f32]) -> Gradients {
    let shape = output.dims();
    (output * tensor(weights, shape)).sum().backward()
}

/// A leaf's gradient.
pub fn gradient<const D: usize>(leaf: &Tensor<D>, gradients: &Gradients) -> Vec<f32> {
    values(
        leaf.grad(gradients)
            .expect("the leaf takes part in the loss"),
    )
}

/// `Σ values · weights` in double precision.
pub fn dot(values: &[f32], weights: &[f32]) -> f64 {
    assert_eq!(values.len(), weights.len());
    values
        .iter()
        .zip(weights)
        .map(|(v, w)| f64::from(*v) * f64::from(*w))
        .sum()
}

/// `Σ values · weights` of a twin's result.
pub fn dot64(values: &[f64], weights: &[f32]) -> f64 {
    assert_eq!(values.len(), weights.len());
    values
        .iter()
        .zip(weights)
        .map(|(v, w)| v * f64::from(*w))
        .sum()
}

/// Numbers in double precision, for the twins.
pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|v| f64::from(*v)).collect()
}

pub fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|v| v * v).sum::<f64>().sqrt()
}

/// Asserts `‖a − b‖ ≤ tolerance · ‖b‖`.
pub fn assert_close(what: &str, a: &[f32], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len(), "{what}: lengths");
    let error = norm(a.iter().zip(b).map(|(a, b)| f64::from(*a) - b));
    let size = norm(b.iter().copied());
    // Written so that NaN fails.
    assert!(
        error <= tolerance * size,
        "{what}: relative error {:.2e} exceeds {tolerance:.0e}",
        error / size
    );
}

/// Asserts equality bit by bit.
pub fn assert_same(what: &str, a: &[f32], b: &[f32]) {
    let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert!(bits(a) == bits(b), "{what}: not bitwise equal");
}

/// Runs `f` twice on one thread and once on each of two and three, and asserts equal bits.
pub fn assert_deterministic(what: &str, f: impl Fn() -> Vec<f32> + Send + Sync) {
    let on = |threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads can be started").install(&f)
    };
    let first = on(1);
    for threads in [1, 2, 3] {
        assert_same(
            &format!("{what} on {threads} threads"),
            &on(threads),
            &first,
        );
    }
}

/// Compares `grad` with central differences of `loss` around `x`: along random directions to 1e-3
/// of the gradient's norm, and along the largest and some other entries to 1e-2.
pub fn check_gradient(
    what: &str,
    x: &[f32],
    grad: &[f32],
    step: f32,
    loss: impl Fn(&[f32]) -> f64,
) {
    assert_eq!(x.len(), grad.len(), "{what}: lengths");
    let compare = |direction: &[f32], tolerance: f64, along: &str| {
        let moved = |sign: f32| -> Vec<f32> {
            x.iter()
                .zip(direction)
                .map(|(x, d)| x + sign * step * d)
                .collect()
        };
        let (plus, minus) = (moved(1.0), moved(-1.0));
        let measured = loss(&plus) - loss(&minus);
        // With the step as it was rounded.
        let predicted: f64 = (0..x.len())
            .map(|i| f64::from(grad[i]) * (f64::from(plus[i]) - f64::from(minus[i])))
            .sum();
        let scale = 1.0 / (2.0 * f64::from(step));
        let (measured, predicted) = (measured * scale, predicted * scale);
        assert!(
            (measured - predicted).abs() <= tolerance,
            "{what} along {along}: gradient {predicted:.6}, difference {measured:.6}"
        );
    };
    let size = norm(grad.iter().map(|g| f64::from(*g)));
    assert!(
        size > 0.0 && size.is_finite(),
        "{what}: gradient of norm {size}"
    );
    for seed in 0..6 {
        let direction: Vec<f32> = numbers(900 + seed, x.len(), -1.0..1.0)
            .iter()
            .map(|v| v.signum())
            .collect();
        compare(&direction, 1e-3 * size, &format!("direction {seed}"));
    }
    let mut order: Vec<usize> = (0..x.len()).collect();
    order.sort_by(|a, b| grad[*b].abs().total_cmp(&grad[*a].abs()));
    let largest = f64::from(grad[order[0]].abs());
    let spread = order.iter().step_by(order.len().div_ceil(6));
    for i in order.iter().take(6).chain(spread) {
        let mut direction = vec![0.0; x.len()];
        direction[*i] = 1.0;
        let tolerance = 1e-2 * f64::from(grad[*i].abs()).max(0.05 * largest);
        compare(&direction, tolerance, &format!("entry {i}"));
    }
}

/// Every entry's central difference of a twin in double precision.
pub fn differences(x: &[f32], loss: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    const STEP: f64 = 1e-6;
    let mut x = wide(x);
    (0..x.len())
        .map(|i| {
            let here = x[i];
            x[i] = here + STEP;
            let plus = loss(&x);
            x[i] = here - STEP;
            let minus = loss(&x);
            x[i] = here;
            (plus - minus) / (2.0 * STEP)
        })
        .collect()
}

/// A golden file of this crate, by name.
pub fn golden(name: &str) -> Golden {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    Golden::open(&folder.join(format!("{name}.safetensors")))
}

/// Tensors of a safetensors file.
pub struct Golden(Vec<u8>);

impl Golden {
    pub fn open(path: &Path) -> Self {
        let read = std::fs::read(path);
        Self(read.unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        let file = SafeTensors::deserialize(&self.0).expect("a safetensors file");
        let tensor = file.tensor(name);
        tensor
            .unwrap_or_else(|error| panic!("{name}: {error}"))
            .data()
            .to_vec()
    }

    pub fn shape(&self, name: &str) -> Vec<usize> {
        let file = SafeTensors::deserialize(&self.0).expect("a safetensors file");
        let tensor = file.tensor(name);
        tensor
            .unwrap_or_else(|error| panic!("{name}: {error}"))
            .shape()
            .to_vec()
    }

    /// A float32 tensor's numbers.
    pub fn f32(&self, name: &str) -> Vec<f32> {
        let bytes = self.bytes(name);
        let (quads, rest) = bytes.as_chunks::<4>();
        assert!(rest.is_empty(), "{name} is not float32");
        quads.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    /// A float16 tensor's numbers.
    pub fn f16(&self, name: &str) -> Vec<f32> {
        let bytes = self.bytes(name);
        let (pairs, _) = bytes.as_chunks::<2>();
        pairs
            .iter()
            .map(|b| half::f16::from_le_bytes(*b).to_f32())
            .collect()
    }
}
