//! Adam: the textbook's numbers, sparse steps, poisoned gradients, aliasing.

mod common;

use burn::tensor::{Tensor, TensorData};
use common::*;
use impasto_kernels::cpu::adam;
use impasto_kernels::ops::AdamParam;
use impasto_kernels::{AdamStep, Sparse};

/// More than one chunk of work.
const COUNT: usize = 40_000;

/// A tensor on a device without autodiff, as parameters and gradients are.
fn plain(data: &[f32]) -> Tensor<1> {
    Tensor::from_data(TensorData::new(data.to_vec(), [data.len()]), &device())
}

/// Algorithm 1 of Kingma & Ba.
struct Textbook {
    param: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
    steps: i32,
}

impl Textbook {
    fn new(param: &[f32]) -> Self {
        Self {
            param: wide(param),
            first: vec![0.0; param.len()],
            second: vec![0.0; param.len()],
            steps: 0,
        }
    }

    fn step(
        &mut self,
        grad: &[f32],
        rate: f64,
        (beta2, eps, decay): (f64, f64, f64),
        skip: fn(f32) -> bool,
    ) {
        self.steps += 1;
        for (i, g) in grad.iter().enumerate() {
            if skip(*g) {
                continue;
            }
            let g = f64::from(*g) + decay * self.param[i];
            self.first[i] = 0.9 * self.first[i] + 0.1 * g;
            self.second[i] = beta2 * self.second[i] + (1.0 - beta2) * g * g;
            let first = self.first[i] / (1.0 - 0.9f64.powi(self.steps));
            let second = self.second[i] / (1.0 - beta2.powi(self.steps));
            self.param[i] -= rate * first / (second.sqrt() + eps);
        }
    }
}

#[test]
fn equals_the_textbook() {
    let start = numbers(1, COUNT, -1.0..1.0);
    let mut ours = AdamParam::new(plain(&start));
    let mut textbook = Textbook::new(&start);
    for step in 0..8 {
        let grad = numbers(2 + step, COUNT, -2.0..2.0);
        let rate = 0.01 / (1.0 + step as f32);
        ours.step(plain(&grad), rate, None);
        textbook.step(&grad, f64::from(rate), (0.999, 1e-8, 0.0), |_| false);
    }
    let moved = |param: &[f64]| -> Vec<f64> {
        param.iter().zip(wide(&start)).map(|(p, s)| p - s).collect()
    };
    let ours = values(ours.value());
    assert_close("parameters", &ours, &textbook.param, 1e-6);
    let moved_ours: Vec<f32> = moved(&wide(&ours)).iter().map(|m| *m as f32).collect();
    assert_close("their way", &moved_ours, &moved(&textbook.param), 1e-4);
}

#[test]
fn a_dense_step_without_gradient_follows_its_momentum() {
    let mut ours = AdamParam::new(plain(&[1.0, 2.0]));
    let mut textbook = Textbook::new(&[1.0, 2.0]);
    for grad in [[1.0, 0.0], [0.0, 0.0]] {
        ours.step(plain(&grad), 0.1, None);
        textbook.step(&grad, 0.1, (0.999, 1e-8, 0.0), |_| false);
    }
    let ours = values(ours.value());
    assert_close("parameters", &ours, &textbook.param, 1e-6);
    assert!(ours[0] < 0.85 && ours[1] == 2.0);
}

#[test]
fn sparse_steps_leave_entries_without_gradient_untouched() {
    let start = numbers(3, COUNT, -1.0..1.0);
    let mut ours = AdamParam::new(plain(&start));
    let mut textbook = Textbook::new(&start);
    for step in 0..6 {
        let mut grad = numbers(10 + step, COUNT, -1e-3..1e-3);
        // Every third entry never has a gradient, every other only in even steps.
        for (i, g) in grad.iter_mut().enumerate() {
            // And sometimes there is a long run of them.
            let run = step == 2 && (100..180).contains(&i);
            if run || i % 3 == 0 || (i % 2 == 0 && step % 2 == 1) {
                *g = 0.0;
            }
        }
        ours.step(plain(&grad), 0.01, Some(Sparse { decay: 0.2 }));
        textbook.step(&grad, 0.01, (0.99, 1e-15, 0.2), |g| g == 0.0);
    }
    let ours = values(ours.value());
    assert_close("parameters", &ours, &textbook.param, 1e-6);
    for (i, (now, then)) in ours.iter().zip(&start).enumerate() {
        assert_eq!(now == then, i % 3 == 0, "entry {i}: {then} → {now}");
    }
}

#[test]
fn gradients_that_are_not_finite_leave_their_entry_untouched() {
    for sparse in [None, Some(Sparse { decay: 0.1 })] {
        let constants = sparse.map_or((0.999, 1e-8, 0.0), |sparse| {
            (0.99, 1e-15, sparse.decay.into())
        });
        let start = numbers(4, 5, -1.0..1.0);
        let mut ours = AdamParam::new(plain(&start));
        let mut textbook = Textbook::new(&start);
        let poisoned = [0.5, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.5];
        ours.step(plain(&poisoned), 0.01, sparse);
        textbook.step(&poisoned, 0.01, constants, |g| !g.is_finite());
        let after = values(ours.value());
        assert_same("poisoned entries", &after[1..4], &start[1..4]);
        assert!(after[0] != start[0] && after[4] != start[4]);
        // Their moments are clean: they go on as if nothing had happened.
        ours.step(plain(&[0.5; 5]), 0.01, sparse);
        textbook.step(&[0.5; 5], 0.01, constants, |_| false);
        assert_close(
            "the next step",
            &values(ours.value()),
            &textbook.param,
            1e-6,
        );
    }
}

#[test]
fn values_handed_out_earlier_do_not_change() {
    let start = numbers(5, 100, -1.0..1.0);
    let mut param = AdamParam::new(plain(&start));
    let (value, tracked, copy) = (param.value(), param.tracked(), param.clone());
    param.step(plain(&[1.0; 100]), 0.1, None);
    for (what, earlier) in [("value", value), ("copy", copy.value())] {
        assert_same(what, &values(earlier), &start);
    }
    assert_same("tracked", &values(tracked), &start);
    assert!(
        values(param.value())
            .iter()
            .zip(&start)
            .all(|(now, then)| now < then)
    );
}

#[test]
fn starts_from_a_view_of_a_larger_tensor() {
    let all = numbers(6, 10, -1.0..1.0);
    for part in [0..4, 3..7, 6..10] {
        let whole = plain(&all);
        let mut view = AdamParam::new(whole.clone().slice(part.clone()));
        let mut own = AdamParam::new(plain(&all[part]));
        for param in [&mut view, &mut own] {
            param.step(plain(&[0.3, -0.2, 0.1, 0.7]), 0.1, None);
        }
        assert_same("a view", &values(view.value()), &values(own.value()));
        assert_same("the tensor behind it", &values(whole), &all);
    }
}

#[test]
fn finds_a_minimum() {
    let target = numbers(7, 50, -1.0..1.0);
    let mut param = AdamParam::new(plain(&[0.0; 50]));
    for _ in 0..300 {
        let x = param.tracked();
        let miss = x.clone() - tensor(&target, [50]);
        let grads = (miss.clone() * miss).sum().backward();
        param.step(x.grad(&grads).expect("a gradient"), 0.03, None);
    }
    assert_close("the minimum", &values(param.value()), &wide(&target), 1e-3);
}

#[test]
fn does_not_depend_on_threads() {
    let (start, grad) = (numbers(8, COUNT, -1.0..1.0), numbers(9, COUNT, -1.0..1.0));
    let settings = AdamStep {
        rate: 0.01,
        beta1: 0.9,
        beta2: 0.99,
        eps: 1e-8,
        step: 1,
        sparse: None,
    };
    assert_deterministic("a step", || {
        let (mut first, mut second) = (vec![0.0; COUNT], vec![0.0; COUNT]);
        let mut param = start.clone();
        adam::update(&mut param, &mut first, &mut second, &grad, &settings);
        [param, first, second].concat()
    });
}
