//! Fused MLPs: twin, gradients, poisoned rows, block borders, determinism.

mod common;

use common::on::mlp;
use common::*;
use impasto_kernels::{Activation, LayerSpec, MlpSpec, ops};

/// A twin's result and how near its relus came to their kink.
struct Evaluated {
    out: Vec<f64>,
    margin: f64,
}

fn twin(spec: &MlpSpec, x: &[f64], params: &[f64]) -> Evaluated {
    let mut margin = f64::MAX;
    let mut out = Vec::new();
    for row in x.chunks(spec.inputs()) {
        let mut current = row.to_vec();
        let mut offset = 0;
        let mut shift = spec.layers().iter().map(LayerSpec::params).sum::<usize>();
        let mut entry = Vec::new();
        for (i, layer) in spec.layers().iter().enumerate() {
            if spec.blocks().iter().any(|block| block.start == i) {
                for x in &mut current {
                    *x += params[shift];
                    shift += 1;
                }
                entry.clone_from(&current);
            }
            let bias = offset + layer.inputs * layer.outputs;
            let mut next = vec![0.0; layer.outputs];
            for (o, next) in next.iter_mut().enumerate() {
                *next = params[bias + o];
                for (i, x) in current.iter().enumerate() {
                    *next += params[offset + o * layer.inputs + i] * x;
                }
            }
            offset = bias + layer.outputs;
            if layer.layer_norm {
                let n = next.len() as f64;
                let mean = next.iter().sum::<f64>() / n;
                let variance = next.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
                next.iter_mut()
                    .for_each(|v| *v = (*v - mean) / (variance + 1e-5).sqrt());
            }
            for v in &mut next {
                *v = match layer.activation {
                    Activation::Linear => *v,
                    Activation::Relu => {
                        margin = margin.min(v.abs());
                        v.max(0.0)
                    }
                    Activation::Sigmoid => 1.0 / (1.0 + (-*v).exp()),
                };
            }
            if spec.blocks().iter().any(|block| block.end == i + 1) {
                next.iter_mut().zip(&entry).for_each(|(v, e)| *v += e);
            }
            current = next;
        }
        out.extend(current);
    }
    Evaluated { out, margin }
}

/// Small MLPs with every activation, with and without LayerNorm, and the one-layer ones.
fn specs() -> Vec<(String, MlpSpec)> {
    let mut specs = Vec::new();
    for layer_norm in [false, true] {
        for output in [Activation::Linear, Activation::Relu, Activation::Sigmoid] {
            let name = |widths: &[usize]| format!("{widths:?} {output:?} layer_norm={layer_norm}");
            for widths in [&[5, 16, 16, 3][..], &[3, 7]] {
                specs.push((name(widths), MlpSpec::relu(widths, layer_norm, output)));
            }
            let layers = [(4, 9), (9, 6)].map(|(inputs, outputs)| LayerSpec {
                inputs,
                outputs,
                layer_norm,
                activation: output,
            });
            specs.push((
                name(&[4, 9, 6]) + " everywhere",
                MlpSpec::new(layers.to_vec()),
            ));
            for blocks in [vec![1..3, 3..5], vec![2..3, 4..5]] {
                let spec = MlpSpec::relu(&[5, 8, 8, 8, 8, 8], layer_norm, output);
                specs.push((
                    format!("blocks {blocks:?} {output:?} layer_norm={layer_norm}"),
                    spec.with_blocks(blocks),
                ));
            }
        }
    }
    specs
}

fn inputs(spec: &MlpSpec, rows: usize, seed: u64) -> (Vec<f32>, Vec<f32>) {
    let x = numbers(seed, rows * spec.inputs(), -1.0..1.0);
    (x, numbers(seed + 1000, spec.params(), -0.8..0.8))
}

/// Inputs for which no relu is within `margin` of its kink.
fn inputs_off_kinks(spec: &MlpSpec, rows: usize, margin: f64) -> (Vec<f32>, Vec<f32>) {
    (0..1000)
        .map(|seed| inputs(spec, rows, seed))
        .find(|(x, params)| twin(spec, &wide(x), &wide(params)).margin > margin)
        .expect("one of a thousand seeds stays off the kinks")
}

#[test]
fn equals_its_twin_whatever_the_number_of_rows() {
    for (name, spec) in specs() {
        for rows in [1, 4, 5, 63, 64, 65, 600, 1025] {
            let (x, params) = inputs(&spec, rows, 7);
            let expected = twin(&spec, &wide(&x), &wide(&params)).out;
            let out = mlp::forward(&spec, &x, &params);
            assert_close(&format!("{name}, {rows} rows"), &out, &expected, 1e-5);
        }
    }
}

#[test]
fn gradients_equal_the_twins_differences() {
    for (name, spec) in specs() {
        for rows in [1, 5, 257] {
            let (x, params) = inputs_off_kinks(&spec, rows, 1e-5);
            let weights = numbers(3, rows * spec.outputs(), -1.0..1.0);
            let (x_grad, params_grad) = mlp::backward(&spec, &x, &params, &weights, true);
            let (wide_x, wide_params) = (wide(&x), wide(&params));
            let what = format!("{name}, {rows} rows");
            // Rows do not mix: the input's differences need one row each.
            let mut by_x = Vec::new();
            for (x, w) in x.chunks(spec.inputs()).zip(weights.chunks(spec.outputs())) {
                by_x.extend(differences(x, |x| {
                    dot64(&twin(&spec, x, &wide_params).out, w)
                }));
            }
            let by_params = differences(&params, |p| dot64(&twin(&spec, &wide_x, p).out, &weights));
            assert_close(&format!("{what}: input"), &x_grad, &by_x, 2e-5);
            assert_close(
                &format!("{what}: parameters"),
                &params_grad,
                &by_params,
                2e-5,
            );
        }
    }
}

#[test]
fn operation_has_the_gradients_of_central_differences() {
    for (name, spec) in specs() {
        let rows = 3;
        let (x, params) = inputs_off_kinks(&spec, rows, 0.02);
        let weights = numbers(3, rows * spec.outputs(), -1.0..1.0);
        let (x_shape, params_shape) = ([rows, spec.inputs()], [spec.params()]);
        let run = |x: &[f32], params: &[f32]| {
            let out = ops::mlp(tensor(x, x_shape), tensor(params, params_shape), &spec);
            dot(&values(out), &weights)
        };
        let (x_leaf, params_leaf) = (leaf(&x, x_shape), leaf(&params, params_shape));
        let grads = backward(
            ops::mlp(x_leaf.clone(), params_leaf.clone(), &spec),
            &weights,
        );
        let step = 1.5e-3;
        let x_grad = gradient(&x_leaf, &grads);
        check_gradient(&format!("{name}: input"), &x, &x_grad, step, |x| {
            run(x, &params)
        });
        let params_grad = gradient(&params_leaf, &grads);
        check_gradient(
            &format!("{name}: parameters"),
            &params,
            &params_grad,
            step,
            |p| run(&x, p),
        );
    }
}

#[test]
fn a_known_result_comes_back_with_the_gradients_of_computing_it() {
    let spec = MlpSpec::relu(&[5, 16, 3], true, Activation::Sigmoid);
    let rows = 70;
    let (x, params) = inputs(&spec, rows, 1);
    let weights = numbers(3, rows * 3, -1.0..1.0);
    let grads_of = |known: bool| {
        let (x, params) = (leaf(&x, [rows, 5]), leaf(&params, [spec.params()]));
        let mut out = ops::mlp(x.clone(), params.clone(), &spec);
        if known {
            out = ops::mlp_again(x.clone(), params.clone(), &spec, out.detach());
        }
        let grads = backward(out.clone(), &weights);
        (values(out), gradient(&x, &grads), gradient(&params, &grads))
    };
    assert_eq!(grads_of(true), grads_of(false));
}

#[test]
fn each_gradient_is_the_same_when_asked_for_alone() {
    let spec = MlpSpec::relu(&[5, 16, 3], true, Activation::Sigmoid);
    let rows = 300;
    let (x, params) = inputs(&spec, rows, 1);
    let weights = numbers(3, rows * 3, -1.0..1.0);
    let (x_shape, params_shape) = ([rows, 5], [spec.params()]);
    let (x_grad, params_grad) = mlp::backward(&spec, &x, &params, &weights, true);

    let x_leaf = leaf(&x, x_shape);
    let out = ops::mlp(x_leaf.clone(), tensor(&params, params_shape), &spec);
    assert_same(
        "input",
        &gradient(&x_leaf, &backward(out, &weights)),
        &x_grad,
    );

    let params_leaf = leaf(&params, params_shape);
    let out = ops::mlp(tensor(&x, x_shape), params_leaf.clone(), &spec);
    assert_same(
        "parameters",
        &gradient(&params_leaf, &backward(out, &weights)),
        &params_grad,
    );
}

#[test]
fn parameter_gradients_of_parts_add_up() {
    let spec = MlpSpec::relu(&[6, 24, 24, 4], true, Activation::Linear);
    // More than the eight pieces times one block, and no multiple of it.
    let (rows, cut) = (2611, 1000);
    let (x, params) = inputs(&spec, rows, 5);
    let grad = numbers(6, rows * 4, -1.0..1.0);
    let part = |x: &[f32], grad: &[f32]| mlp::backward(&spec, x, &params, grad, true);
    let (x_whole, whole) = part(&x, &grad);
    let (x_first, first) = part(&x[..cut * 6], &grad[..cut * 4]);
    let (x_second, second) = part(&x[cut * 6..], &grad[cut * 4..]);
    let sum: Vec<f64> = wide(&first)
        .iter()
        .zip(wide(&second))
        .map(|(a, b)| a + b)
        .collect();
    assert_close("parameters", &whole, &sum, 1e-5);
    assert_close(
        "input",
        &x_whole,
        &wide(&[x_first, x_second].concat()),
        1e-5,
    );
}

#[test]
fn no_rows_give_no_rows_and_no_gradient() {
    let spec = MlpSpec::relu(&[5, 16, 3], false, Activation::Relu);
    let (_, params) = inputs(&spec, 0, 1);
    assert!(mlp::forward(&spec, &[], &params).is_empty());
    let (x_grad, params_grad) = mlp::backward(&spec, &[], &params, &[], true);
    assert!(x_grad.is_empty() && params_grad.iter().all(|g| *g == 0.0));
    let out = ops::mlp(tensor(&[], [0, 5]), tensor(&params, [params.len()]), &spec);
    assert_eq!(out.dims(), [0, 3]);
}

#[test]
fn poisoned_rows_spoil_only_themselves() {
    for (name, spec) in specs() {
        let rows = 300;
        let (mut x, params) = inputs(&spec, rows, 9);
        let clean = mlp::forward(&spec, &x, &params);
        let grad = numbers(3, rows * spec.outputs(), -1.0..1.0);
        let (clean_grad, _) = mlp::backward(&spec, &x, &params, &grad, true);
        let poisoned = [0, 17, 255, 256, 299];
        for row in poisoned {
            x[row * spec.inputs() + 1] = f32::NAN;
        }
        let out = mlp::forward(&spec, &x, &params);
        let (x_grad, _) = mlp::backward(&spec, &x, &params, &grad, true);
        for row in 0..rows {
            let own = row * spec.outputs()..(row + 1) * spec.outputs();
            let what = format!("{name}, row {row}");
            if poisoned.contains(&row) {
                assert!(out[own].iter().all(|v| v.is_nan()), "{what} hides its NaN");
            } else {
                assert_same(&what, &out[own.clone()], &clean[own]);
                let own = row * spec.inputs()..(row + 1) * spec.inputs();
                assert_same(&what, &x_grad[own.clone()], &clean_grad[own]);
            }
        }
    }
}

#[test]
fn a_constant_row_has_a_finite_layer_norm() {
    let spec = MlpSpec::relu(&[2, 8, 1], true, Activation::Linear);
    // Equal weights and biases: the hidden channels have no variance.
    let params = vec![0.5; spec.params()];
    let (x, grad) = (vec![0.3, -0.2], vec![1.0]);
    assert_eq!(mlp::forward(&spec, &x, &params), [0.5]);
    let (x_grad, params_grad) = mlp::backward(&spec, &x, &params, &grad, true);
    assert!(x_grad.iter().chain(&params_grad).all(|g| g.is_finite()));
}

#[test]
fn saturated_sigmoids_stay_finite() {
    let spec = MlpSpec::relu(&[1, 2], false, Activation::Sigmoid);
    let params = [1e4, -1e4, 0.0, 0.0];
    assert_eq!(mlp::forward(&spec, &[1.0], &params), [1.0, 0.0]);
    let (x_grad, params_grad) = mlp::backward(&spec, &[1.0], &params, &[1.0, 1.0], true);
    assert!(x_grad.iter().chain(&params_grad).all(|g| *g == 0.0));
}

#[test]
fn does_not_depend_on_threads() {
    let spec = MlpSpec::relu(&[6, 24, 24, 4], true, Activation::Sigmoid);
    let rows = 2611;
    let (x, params) = inputs(&spec, rows, 11);
    let grad = numbers(12, rows * 4, -1.0..1.0);
    assert_deterministic("forward", || mlp::forward(&spec, &x, &params));
    assert_deterministic("backward", || {
        let (x_grad, params_grad) = mlp::backward(&spec, &x, &params, &grad, true);
        [x_grad, params_grad].concat()
    });
}

#[test]
fn takes_views_of_larger_tensors() {
    let spec = MlpSpec::relu(&[4, 8, 2], false, Activation::Linear);
    let (x, params) = inputs(&spec, 10, 13);
    let transposed: Vec<f32> = (0..40).map(|i| x[i % 10 * 4 + i / 10]).collect();
    let expected = mlp::forward(&spec, &x, &params);
    let longer = [vec![9.0; 3], params].concat();
    let params = tensor(&longer, [longer.len()]).slice(3..longer.len());
    let out = ops::mlp(tensor(&transposed, [4, 10]).transpose(), params, &spec);
    assert_same(
        "transposed input, shifted parameters",
        &values(out),
        &expected,
    );
}

#[test]
#[should_panic(expected = "widths of neighbouring layers")]
fn refuses_layers_that_do_not_fit() {
    let layer = |inputs, outputs| LayerSpec {
        inputs,
        outputs,
        layer_norm: false,
        activation: Activation::Relu,
    };
    let _ = MlpSpec::new(vec![layer(3, 4), layer(5, 1)]);
}
