//! Compositing: twin, gradients, empty and saturated rays, determinism, golden numbers.

mod common;

use common::on::composite;
use common::*;
use impasto_kernels::cpu::composite::weights as weights_of;
use impasto_kernels::{CompositeLayout, RaySpan, ops};
use std::sync::Arc;

const CHANNELS: usize = 3;
const OUTPUTS: usize = CompositeLayout::outputs(CHANNELS);

/// How samples lie in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Packing {
    /// All inner samples, then all outer ones.
    Halves,
    /// Ray after ray.
    Interleaved,
}

/// Rays with zero to six inner and zero to four outer samples.
fn layout(rays: usize, packing: Packing) -> CompositeLayout {
    let count = |ray: usize| (ray % 7, ray / 7 % 5);
    let inner_total: usize = (0..rays).map(|ray| count(ray).0).sum();
    let mut layout = CompositeLayout::default();
    let (mut inner, mut outer) = (0, inner_total);
    for (n, m) in (0..rays).map(count) {
        let span = match packing {
            Packing::Halves => RaySpan {
                inner: inner..inner + n,
                outer: outer..outer + m,
            },
            Packing::Interleaved => RaySpan {
                inner: inner..inner + n,
                outer: inner + n..inner + n + m,
            },
        };
        inner += if packing == Packing::Halves { n } else { n + m };
        outer += m;
        layout.rays.push(span);
    }
    let total: usize = layout
        .rays
        .iter()
        .map(|r| r.inner.len() + r.outer.len())
        .sum();
    layout.deltas = numbers(20, total, 0.05..0.6);
    layout.depths = numbers(21, total, 0.0..3.0);
    layout.distances = vec![0.0; total];
    for span in &layout.rays {
        let samples: Vec<usize> = samples(span);
        for (rank, i) in samples.iter().enumerate() {
            let jitter = f32::from((*i % 10) as u8) / 10.0;
            layout.distances[*i] = (rank as f32 + jitter) / samples.len() as f32;
        }
    }
    layout
}

fn samples(span: &RaySpan) -> Vec<usize> {
    span.inner.clone().chain(span.outer.clone()).collect()
}

fn inputs(layout: &CompositeLayout) -> (Vec<f32>, Vec<f32>) {
    let n = layout.deltas.len();
    (
        numbers(22, n, 0.1..4.0),
        numbers(23, n * CHANNELS, 0.0..1.0),
    )
}

fn twin_weights(layout: &CompositeLayout, sigma: &[f64]) -> Vec<f64> {
    let mut weights = vec![0.0; sigma.len()];
    for span in &layout.rays {
        let alpha = |i: usize| 1.0 - (-sigma[i] * f64::from(layout.deltas[i])).exp();
        let samples = samples(span);
        for (k, i) in samples.iter().enumerate() {
            let transmittance: f64 = samples[..k]
                .iter()
                .map(|j| 1.0 - alpha(*j) + 1e-6)
                .product();
            weights[*i] = alpha(*i) * transmittance;
        }
    }
    weights
}

/// By definition: the distortion as its double sum.
fn twin(layout: &CompositeLayout, sigma: &[f64], colours: &[f64]) -> Vec<f64> {
    let weights = twin_weights(layout, sigma);
    let mut out = Vec::new();
    for span in &layout.rays {
        let mut ray = [0.0; OUTPUTS];
        let samples = samples(span);
        for i in &samples {
            for c in 0..CHANNELS {
                ray[c] += weights[*i] * colours[i * CHANNELS + c];
            }
            ray[CHANNELS] += weights[*i];
            ray[CHANNELS + 1] += weights[*i] * f64::from(layout.depths[*i]);
            for j in &samples {
                let gap = f64::from(layout.distances[*i]) - f64::from(layout.distances[*j]);
                ray[CHANNELS + 2] += weights[*i] * weights[*j] * gap.abs();
            }
        }
        out.extend(ray);
    }
    out
}

#[test]
fn equals_its_twin() {
    for rays in [0, 1, 2, 257, 1000] {
        for packing in [Packing::Halves, Packing::Interleaved] {
            let layout = layout(rays, packing);
            let (sigma, colours) = inputs(&layout);
            let out = composite::forward(&layout, &sigma, &colours, CHANNELS);
            let expected = twin(&layout, &wide(&sigma), &wide(&colours));
            assert_close(&format!("{rays} rays, {packing:?}"), &out, &expected, 1e-6);
            let weights = weights_of(&layout, &sigma);
            let expected = twin_weights(&layout, &wide(&sigma));
            assert_close(
                &format!("weights of {rays} rays"),
                &weights,
                &expected,
                1e-6,
            );
        }
    }
}

#[test]
fn gradients_equal_the_twins_differences() {
    for packing in [Packing::Halves, Packing::Interleaved] {
        let layout = layout(40, packing);
        let (sigma, colours) = inputs(&layout);
        let (wide_sigma, wide_colours) = (wide(&sigma), wide(&colours));
        let grad = numbers(24, 40 * OUTPUTS, -1.0..1.0);
        let (sigma_grad, colour_grad) =
            composite::backward(&layout, &sigma, &colours, CHANNELS, &grad);
        let by_sigma = differences(&sigma, |s| dot64(&twin(&layout, s, &wide_colours), &grad));
        let by_colour = differences(&colours, |c| dot64(&twin(&layout, &wide_sigma, c), &grad));
        assert_close(&format!("sigma, {packing:?}"), &sigma_grad, &by_sigma, 1e-5);
        assert_close(
            &format!("colours, {packing:?}"),
            &colour_grad,
            &by_colour,
            1e-5,
        );
    }
}

#[test]
fn operation_has_the_gradients_of_central_differences() {
    let layout = Arc::new(layout(60, Packing::Halves));
    let (sigma, colours) = inputs(&layout);
    let n = sigma.len();
    let weights = numbers(25, 60 * OUTPUTS, -1.0..1.0);
    let run = |sigma: &[f32], colours: &[f32]| {
        let (sigma, colours) = (tensor(sigma, [n]), tensor(colours, [n, CHANNELS]));
        dot(
            &values(ops::composite(sigma, colours, Arc::clone(&layout))),
            &weights,
        )
    };
    let (sigma_leaf, colour_leaf) = (leaf(&sigma, [n]), leaf(&colours, [n, CHANNELS]));
    let out = ops::composite(sigma_leaf.clone(), colour_leaf.clone(), Arc::clone(&layout));
    assert_eq!(out.dims(), [60, OUTPUTS]);
    let grads = backward(out, &weights);
    let sigma_grad = gradient(&sigma_leaf, &grads);
    check_gradient("sigma", &sigma, &sigma_grad, 1e-2, |s| run(s, &colours));
    let colour_grad = gradient(&colour_leaf, &grads);
    check_gradient("colours", &colours, &colour_grad, 0.1, |c| run(&sigma, c));
}

#[test]
fn rays_without_samples_are_black_and_empty() {
    let layout = CompositeLayout {
        rays: vec![RaySpan::default(); 3],
        ..CompositeLayout::default()
    };
    assert_eq!(
        composite::forward(&layout, &[], &[], CHANNELS),
        [0.0; 3 * OUTPUTS]
    );
    let (sigma, colours) = composite::backward(&layout, &[], &[], CHANNELS, &[1.0; 3 * OUTPUTS]);
    assert!(sigma.is_empty() && colours.is_empty());
    let out = ops::composite(
        tensor(&[], [0]),
        tensor(&[], [0, CHANNELS]),
        Arc::new(layout),
    );
    assert_eq!(values(out), [0.0; 3 * OUTPUTS]);
}

/// One ray: two inner samples, then outer ones of which the last never ends.
fn endless() -> CompositeLayout {
    CompositeLayout {
        rays: vec![RaySpan {
            inner: 0..2,
            outer: 2..4,
        }],
        deltas: vec![0.5, 0.5, 0.3, 1e10],
        depths: vec![0.2, 0.7, 1.5, 8.0],
        distances: vec![0.1, 0.3, 0.6, 0.9],
    }
}

#[test]
fn an_endless_last_step_takes_all_light_and_has_finite_gradients() {
    let layout = endless();
    let colours = numbers(26, 4 * CHANNELS, 0.0..1.0);
    for last in [0.0, 1e-12, 1.0, 1e30, f32::MAX] {
        let sigma = [0.4, 0.8, 0.2, last];
        let out = composite::forward(&layout, &sigma, &colours, CHANNELS);
        assert!(out.iter().all(|v| v.is_finite()), "sigma {last}: {out:?}");
        let opaque = last >= 1.0;
        assert_eq!(
            (out[CHANNELS] - 1.0).abs() < 1e-5,
            opaque,
            "sigma {last}: {out:?}"
        );
        let grad = numbers(27, OUTPUTS, -1.0..1.0);
        let (sigma_grad, colour_grad) =
            composite::backward(&layout, &sigma, &colours, CHANNELS, &grad);
        assert!(
            sigma_grad.iter().chain(&colour_grad).all(|g| g.is_finite()),
            "sigma {last}"
        );
        assert_eq!(sigma_grad[3] == 0.0, opaque, "sigma {last}: {sigma_grad:?}");
        assert!(sigma_grad[0] != 0.0);
    }
}

#[test]
fn huge_densities_hide_what_is_behind() {
    let layout = endless();
    let colours = numbers(28, 4 * CHANNELS, 0.0..1.0);
    for huge in [1e6, 1e30, f32::MAX] {
        let sigma = [huge; 4];
        let out = composite::forward(&layout, &sigma, &colours, CHANNELS);
        assert_close(
            "the first colour",
            &out[..CHANNELS],
            &wide(&colours[..CHANNELS]),
            1e-5,
        );
        let (sigma_grad, colour_grad) =
            composite::backward(&layout, &sigma, &colours, CHANNELS, &[1.0; OUTPUTS]);
        assert!(sigma_grad.iter().all(|g| *g == 0.0), "{sigma_grad:?}");
        assert_eq!(colour_grad[..CHANNELS], [1.0; CHANNELS]);
        assert!(colour_grad[CHANNELS..].iter().all(|g| g.abs() <= 1e-6));
    }
}

#[test]
fn a_poisoned_ray_spoils_only_itself() {
    let layout = layout(300, Packing::Halves);
    let (mut sigma, mut colours) = inputs(&layout);
    let grad = numbers(29, 300 * OUTPUTS, -1.0..1.0);
    let run = |sigma: &[f32], colours: &[f32]| {
        let out = composite::forward(&layout, sigma, colours, CHANNELS);
        (
            out,
            composite::backward(&layout, sigma, colours, CHANNELS, &grad),
        )
    };
    let (clean, (clean_sigma, clean_colours)) = run(&sigma, &colours);
    let bad = 40;
    sigma[layout.rays[bad].inner.start] = f32::NAN;
    colours[layout.rays[bad].inner.start * CHANNELS] = f32::INFINITY;
    let (out, (sigma_grad, colour_grad)) = run(&sigma, &colours);
    for (ray, span) in layout.rays.iter().enumerate() {
        let own = ray * OUTPUTS..(ray + 1) * OUTPUTS;
        if ray == bad {
            assert!(out[own].iter().all(|v| v.is_nan()));
            continue;
        }
        assert_same("outputs", &out[own.clone()], &clean[own]);
        for i in samples(span) {
            let c = i * CHANNELS..(i + 1) * CHANNELS;
            assert_same("sigma", &sigma_grad[i..=i], &clean_sigma[i..=i]);
            assert_same("colours", &colour_grad[c.clone()], &clean_colours[c]);
        }
    }
}

#[test]
fn samples_of_no_ray_get_no_gradient() {
    let mut layout = endless();
    layout.rays[0].inner = 1..2;
    layout.rays[0].outer = 3..4;
    let (sigma, colours) = ([0.5; 4], [0.5; 4 * CHANNELS]);
    let (sigma_grad, colour_grad) =
        composite::backward(&layout, &sigma, &colours, CHANNELS, &[1.0; OUTPUTS]);
    assert!(sigma_grad[1] != 0.0 && sigma_grad[0] == 0.0 && sigma_grad[2] == 0.0);
    for sample in 0..4 {
        let any = colour_grad[sample * CHANNELS..][..CHANNELS]
            .iter()
            .any(|g| *g != 0.0);
        assert_eq!(any, sample % 2 == 1, "sample {sample}");
    }
}

#[test]
#[should_panic(expected = "a sample of a composite belongs to one ray")]
fn refuses_rays_that_share_samples() {
    let mut layout = endless();
    layout.rays[0].outer = 1..4;
    let _ = composite::backward(&layout, &[1.0; 4], &[1.0; 12], CHANNELS, &[1.0; OUTPUTS]);
}

#[test]
fn does_not_depend_on_threads() {
    let layout = layout(1000, Packing::Interleaved);
    let (sigma, colours) = inputs(&layout);
    let grad = numbers(30, 1000 * OUTPUTS, -1.0..1.0);
    assert_deterministic("forward", || {
        composite::forward(&layout, &sigma, &colours, CHANNELS)
    });
    assert_deterministic("backward", || {
        let (s, c) = composite::backward(&layout, &sigma, &colours, CHANNELS, &grad);
        [s, c].concat()
    });
}

/// 20 rays of 16 + 16 samples. The file holds weights instead of densities and each volume's
/// colour instead of the samples', so densities are taken back from the weights and every sample
/// of a volume gets one colour. The outer transmittance (λ) is not used on the way in.
#[test]
#[allow(clippy::too_many_lines, reason = "one table")]
fn reproduces_the_golden_composite() {
    const RAYS: usize = 20;
    const SAMPLES: usize = 16;
    let golden = golden("render_geometry_stage");
    let near = golden.f32("foreground_depths");
    let far = golden.f32("foreground_far");
    let inverse = golden.f32("background_inverse_radii");
    let directions = golden.f32("direction");
    let weights = ["out.fg_weights", "out.bg_weights"].map(|name| golden.f32(name));
    let rgb = ["out.fg_rgb", "out.bg_rgb"].map(|name| golden.f32(name));
    let lambda = golden.f32("out.bg_lambda");

    let mut layout = CompositeLayout::default();
    let (mut sigma, mut colours) = (Vec::new(), Vec::new());
    for ray in 0..RAYS {
        let length = directions[ray * 3..][..3]
            .iter()
            .map(|d| d * d)
            .sum::<f32>()
            .sqrt();
        let mut edges = near[ray * SAMPLES..][..SAMPLES].to_vec();
        edges.push(far[ray]);
        // Near to far is descending in inverse radius.
        let mut radii = inverse[ray * SAMPLES..][..SAMPLES].to_vec();
        radii.reverse();
        let inner = layout.deltas.len();
        layout.rays.push(RaySpan {
            inner: inner..inner + SAMPLES,
            outer: inner + SAMPLES..inner + 2 * SAMPLES,
        });
        layout
            .deltas
            .extend(edges.windows(2).map(|e| (e[1] - e[0]) * length));
        layout.deltas.extend(radii.windows(2).map(|r| r[0] - r[1]));
        layout.deltas.push(1e10);
        layout.depths.extend(edges[..SAMPLES].iter().chain(&radii));
        layout.distances.extend([0.0; 2 * SAMPLES]);
        for volume in 0..2 {
            let own = &weights[volume][ray * SAMPLES..][..SAMPLES];
            let mut transmittance = 1.0;
            for (k, weight) in own.iter().enumerate() {
                let alpha = f64::from(*weight) / transmittance;
                transmittance *= 1.0 - alpha + 1e-6;
                let delta = layout.deltas[inner + volume * SAMPLES + k];
                let endless = delta == 1e10;
                sigma.push(if endless {
                    1.0
                } else {
                    -(1.0 - alpha).ln() / f64::from(delta)
                });
            }
            // The file's outer colour is already multiplied by λ.
            let mass = own.iter().sum::<f32>() * if volume == 1 { lambda[ray] } else { 1.0 };
            let colour = rgb[volume][ray * 3..][..3].iter().map(|c| c / mass);
            (0..SAMPLES).for_each(|_| colours.extend(colour.clone()));
        }
    }
    let sigma: Vec<f32> = sigma.iter().map(|s| *s as f32).collect();
    let out = composite::forward(&layout, &sigma, &colours, CHANNELS);
    let column = |from: usize, to: usize| -> Vec<f32> {
        out.chunks(OUTPUTS)
            .flat_map(|ray| ray[from..to].to_vec())
            .collect()
    };
    assert_close(
        "colours",
        &column(0, 3),
        &wide(&golden.f32("out.rgb")),
        1e-5,
    );
    let depths = [golden.f32("out.fg_depth"), golden.f32("out.bg_depth")].map(|d| wide(&d));
    let depth: Vec<f64> = depths[0]
        .iter()
        .zip(&depths[1])
        .map(|(a, b)| a + b)
        .collect();
    assert_close("depth", &column(4, 5), &depth, 1e-5);

    let packed = weights_of(&layout, &sigma);
    let (inner, outer): (Vec<f32>, Vec<f32>) =
        layout
            .rays
            .iter()
            .fold((Vec::new(), Vec::new()), |(mut inner, mut outer), span| {
                inner.extend(&packed[span.inner.clone()]);
                outer.extend(&packed[span.outer.clone()]);
                (inner, outer)
            });
    assert_close("inner weights", &inner, &wide(&weights[0]), 1e-5);
    let behind: Vec<f64> = (0..RAYS * SAMPLES)
        .map(|i| f64::from(weights[1][i]) * f64::from(lambda[i / SAMPLES]))
        .collect();
    assert_close(
        "outer weights behind the inner volume",
        &outer,
        &behind,
        1e-5,
    );
}
