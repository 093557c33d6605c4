//! Prints each kernel's time on this machine: `cargo run --release --example kernel_times`.
#![allow(clippy::print_stdout)]
use impasto_kernels::cpu::{hash_grid, mlp};
use impasto_kernels::{Activation, HashGridSpec, MlpSpec};
use std::time::Instant;

fn time<R>(name: &str, unit: f64, mut f: impl FnMut() -> R) {
    f();
    let mut best = f64::MAX;
    for _ in 0..5 {
        let t = Instant::now();
        std::hint::black_box(f());
        best = best.min(t.elapsed().as_secs_f64());
    }
    println!(
        "{name:40} {:9.2} ms {:9.1} ns each",
        best * 1e3,
        best * 1e9 / unit
    );
}

fn main() {
    let n = 65536;
    for log2 in [15, 16, 17, 19] {
        let spec = HashGridSpec {
            levels: 8,
            features: 4,
            log2_entries: log2,
            coarsest: 16.0,
            finest: 1024.0,
        };
        let mut seed = 1u64;
        let mut p = [0.5f32; 3];
        let points: Vec<f32> = (0..n)
            .flat_map(|i| {
                let mut next = || {
                    seed = seed
                        .wrapping_mul(6364136223846793005)
                        .wrapping_add(1442695040888963407);
                    (seed >> 40) as f32 / (1u64 << 24) as f32
                };
                if i % 100 == 0 {
                    p = [next(), next(), next()];
                }
                p = p.map(|c| (c + 0.004).fract());
                p
            })
            .collect();
        let table = vec![0.1; spec.params()];
        time(&format!("hash 8x4 2^{log2} forward"), n as f64, || {
            hash_grid::forward(&spec, &points, &table)
        });
        let grad = vec![0.1; n * 32];
        time(&format!("hash 8x4 2^{log2} backward"), n as f64, || {
            hash_grid::backward(&spec, &points, &grad)
        });
    }
    for widths in [
        vec![32, 64, 32],
        vec![47, 64, 64, 3],
        vec![32, 64, 64, 16],
        vec![32, 1],
    ] {
        let spec = MlpSpec::relu(&widths, false, Activation::Linear);
        let x = vec![0.1; n * spec.inputs()];
        let w = vec![0.01; spec.params()];
        let g = vec![0.1; n * spec.outputs()];
        time(&format!("mlp {widths:?} forward"), n as f64, || {
            mlp::forward(&spec, &x, &w)
        });
        time(&format!("mlp {widths:?} backward"), n as f64, || {
            mlp::backward(&spec, &x, &w, &g, true)
        });
    }
}
