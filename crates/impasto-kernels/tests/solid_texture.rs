//! Solid texture: twin, gradients, poisoned places, determinism, and what octaves do.

mod common;

use common::on::solid_texture;
use common::*;
use impasto_kernels::SolidTextureSpec;
use impasto_kernels::cpu::solid_texture::{FEATURES, octave};
use impasto_kernels::device::is_cpu;
use impasto_kernels::ops;

const SPEC: SolidTextureSpec = SolidTextureSpec {
    octaves: 3,
    side: 5,
    finest: 2.0,
    ratio: 1.5,
    stretch: 3.0,
    bend: 1.2,
};

/// Places on both sides of the origin with footprints of many octaves.
fn places(rows: usize) -> Vec<f32> {
    let points = numbers(1, rows * 3, -1.0..1.0);
    let sizes = numbers(2, rows, 0.0..1.0);
    let footprint = |share: &f32| 1e-3 * 100f32.powf(*share);
    let rows = points.chunks(3).zip(&sizes);
    rows.flat_map(|(p, share)| [p[0], p[1], p[2], footprint(share)])
        .collect()
}

/// Calls `visit(output, table entry, weight)` for all that is read, by definition.
fn terms(places: &[f32], mut visit: impl FnMut(usize, usize, f64)) {
    let side = SPEC.side as i64;
    for (row, place) in places.chunks(4).enumerate() {
        let level = (SPEC.finest * place[3]).ln() / SPEC.ratio.ln();
        let (finest, part) = (level.floor(), f64::from(level - level.floor()));
        let length = (part * part + (1.0 - part) * (1.0 - part)).sqrt();
        for slot in 0..SPEC.octaves {
            for (turn, share) in [(0, 1.0 - part), (1, part)] {
                let (matrix, shift) = octave(&SPEC, finest as i32 + (slot + turn) as i32);
                // In single precision as the kernel: where a place lies in a cell is no more exact.
                let straight = [0, 1, 2].map(|axis| {
                    let row = matrix[axis];
                    row[0] * place[0] + row[1] * place[1] + row[2] * place[2] + shift[axis]
                });
                let mut at = [0, 1, 2].map(|axis| {
                    // One arch of the wave up, one down, each a parabola.
                    let turn = (straight[(axis + 1) % 3] / 9.5).rem_euclid(1.0);
                    let arch = (turn * 2.0).fract();
                    let height = 4.0 * arch * (1.0 - arch);
                    straight[axis] + SPEC.bend * if turn < 0.5 { height } else { -height }
                });
                at[0] /= SPEC.stretch;
                for corner in 0..8 {
                    let (mut entry, mut weight) = (0, share / length);
                    for (axis, x) in at.iter().enumerate() {
                        let far = i64::from(corner >> axis & 1);
                        let behind = f64::from(x - x.floor());
                        entry = entry * side + (x.floor() as i64 + far).rem_euclid(side);
                        weight *= if far == 1 { behind } else { 1.0 - behind };
                    }
                    for f in 0..FEATURES {
                        let out = row * SPEC.outputs() + slot * FEATURES + f;
                        visit(out, entry as usize * FEATURES + f, weight);
                    }
                }
            }
        }
    }
}

fn twin(places: &[f32], table: &[f32]) -> Vec<f64> {
    let mut out = vec![0.0; places.len() / 4 * SPEC.outputs()];
    terms(places, |o, t, w| out[o] += w * f64::from(table[t]));
    out
}

fn twin_backward(places: &[f32], grad: &[f32]) -> Vec<f64> {
    let mut table = vec![0.0; SPEC.params()];
    terms(places, |o, t, w| table[t] += w * f64::from(grad[o]));
    table
}

#[test]
fn equals_its_twin() {
    let table = numbers(3, SPEC.params(), -1.0..1.0);
    for rows in [1, 257, 1024, 5000] {
        let places = places(rows);
        let what = format!("{rows} places");
        let out = solid_texture::forward(&SPEC, &places, &table);
        assert_close(&what, &out, &twin(&places, &table), 1e-3);
        let grad = numbers(4, out.len(), -1.0..1.0);
        let found = solid_texture::backward(&SPEC, &places, &grad);
        assert_close(&what, &found, &twin_backward(&places, &grad), 1e-3);
    }
}

#[test]
fn operation_has_the_gradient_of_central_differences() {
    let (rows, count) = (65, SPEC.params());
    let places = places(rows);
    let table = numbers(5, count, -1.0..1.0);
    let weights = numbers(6, rows * SPEC.outputs(), -1.0..1.0);
    let read = |table| ops::solid_texture(tensor(&places, [rows, 4]), table, SPEC);
    let tracked = leaf(&table, [count]);
    let grad = gradient(&tracked, &backward(read(tracked.clone()), &weights));
    // Linear in the table: the step may be large.
    check_gradient("solid texture", &table, &grad, 0.25, |table| {
        dot(&values(read(tensor(table, [count]))), &weights)
    });
}

#[test]
fn places_that_are_not_finite_see_zeros_and_give_no_gradient() {
    let table = numbers(7, SPEC.params(), 0.5..1.0);
    let good = places(1);
    let ones = |rows: usize| vec![1.0; rows * SPEC.outputs()];
    let good_out = solid_texture::forward(&SPEC, &good, &table);
    let good_grad = solid_texture::backward(&SPEC, &good, &ones(1));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for number in 0..4 {
            let mut poisoned = vec![0.5; 4];
            poisoned[number] = bad;
            let all = [&poisoned[..], &good, &poisoned].concat();
            let out = solid_texture::forward(&SPEC, &all, &table);
            let (before, rest) = out.split_at(SPEC.outputs());
            let (between, after) = rest.split_at(SPEC.outputs());
            let mut others = before.iter().chain(after);
            assert!(others.all(|v| *v == 0.0), "{bad} as number {number}");
            assert_same("the good place between", between, &good_out);
            let grad = solid_texture::backward(&SPEC, &all, &ones(3));
            assert_same("the table's gradient", &grad, &good_grad);
        }
    }
}

#[test]
fn footprints_beyond_all_octaves_are_those_at_the_end() {
    let table = numbers(8, SPEC.params(), -1.0..1.0);
    let at = |footprint: f32| solid_texture::forward(&SPEC, &[0.3, -0.2, 0.1, footprint], &table);
    assert_same("none", &at(0.0), &at(1e-5));
    assert_same("below none", &at(-1.0), &at(1e-5));
    assert_same("all space", &at(50.0), &at(1.0));
}

/// What a place sees changes little as it comes nearer, also where one octave takes the place of another.
#[test]
fn octaves_fade_into_each_other() {
    let table = numbers(9, SPEC.params(), -1.0..1.0);
    let seen = |step: usize| {
        let footprint = 0.01 * SPEC.ratio.powf(step as f32 / 100.0);
        solid_texture::forward(&SPEC, &[0.3, -0.2, 0.1, footprint], &table)
    };
    for step in 0..300 {
        let far = seen(step).into_iter().zip(seen(step + 1));
        let most = far.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(most < 0.05, "{most} at step {step}");
    }
}

#[test]
fn does_not_depend_on_threads() {
    let places = places(9000);
    let table = numbers(10, SPEC.params(), -1.0..1.0);
    let grad = numbers(11, 9000 * SPEC.outputs(), -1.0..1.0);
    assert_deterministic("forward", || solid_texture::forward(&SPEC, &places, &table));
    // On a GPU, whoever comes first adds first.
    if is_cpu(&device()) {
        assert_deterministic("backward", || {
            solid_texture::backward(&SPEC, &places, &grad)
        });
    }
}

#[test]
fn no_places_see_nothing() {
    let table = numbers(12, SPEC.params(), -1.0..1.0);
    assert!(solid_texture::forward(&SPEC, &[], &table).is_empty());
    let grad = solid_texture::backward(&SPEC, &[], &[]);
    assert!(grad.len() == SPEC.params() && grad.iter().all(|g| *g == 0.0));
}
