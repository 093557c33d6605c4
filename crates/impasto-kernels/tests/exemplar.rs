//! Texture by example: twin, gradients, poisoned places, determinism, and that contrast stays.

mod common;

use common::on::exemplar;
use common::*;
use impasto_kernels::cpu::exemplar::{
    FACING, FEATURES, LEAN, LEAST_SHARE, PARAMS, SHARPNESS, SIDE, SPACING, frames, middle,
};
use impasto_kernels::device::is_cpu;
use impasto_kernels::ops;

/// Places on both sides of the origin with footprints of many octaves, and normals of any length.
fn places(rows: usize) -> (Vec<f32>, Vec<f32>) {
    let points = numbers(1, rows * 3, -1.0..1.0);
    let sizes = numbers(2, rows, 0.0..1.0);
    let footprint = |share: &f32| 1e-3 * 100f32.powf(*share);
    let all = points.chunks(3).zip(&sizes);
    let places = all.flat_map(|(p, share)| [p[0], p[1], p[2], footprint(share)]);
    (places.collect(), numbers(3, rows * 3, -1.0..1.0))
}

/// Smooth where a place lies on the border of two texels, so that rounding of it does not show.
fn picture(seed: u64) -> Vec<f32> {
    let phases = numbers(seed, FEATURES, 0.0..6.0);
    let texel = |y: usize, x: usize, f: usize| {
        let (x, y) = (x as f32 * 0.11, y as f32 * 0.07);
        (x * (1.0 + 0.1 * f as f32) + y + phases[f]).sin()
    };
    let texels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x)));
    texels
        .flat_map(|(y, x)| (0..FEATURES).map(move |f| texel(y, x, f)))
        .collect()
}

/// What is seen of a window that far from its middle, in lattice coordinates: a tent over six triangles.
fn tent(u: f32, v: f32) -> f32 {
    (1.0 - u.abs().max(v.abs()).max((u + v).abs())).max(0.0)
}

fn shares(numbers: &[f32], power: i32) -> Vec<f32> {
    let powers: Vec<f32> = numbers.iter().map(|x| x.abs().powi(power)).collect();
    let sum: f32 = powers.iter().sum();
    powers
        .iter()
        .map(|x| x / sum)
        .map(|x| if x < LEAST_SHARE { 0.0 } else { x })
        .collect()
}

/// Calls `visit(row, texel, weight)` for all that is read, by definition.
fn terms(places: &[f32], normals: &[f32], mut visit: impl FnMut(usize, usize, f64)) {
    for (row, (place, normal)) in places.chunks(4).zip(normals.chunks(3)).enumerate() {
        let along = |v: [f32; 3], w: &[f32]| v[0] * w[0] + v[1] * w[1] + v[2] * w[2];
        let facing = frames().map(|[_, _, axis]| along(axis, normal));
        let level = place[3].log2();
        let next = level - level.floor();
        let mut all: Vec<(usize, f64)> = Vec::new();
        let mut squares = 0.0;
        for (axis, facing) in shares(&facing, FACING).into_iter().enumerate() {
            for (turn, fade) in [(0, 1.0 - next), (1, next)] {
                let octave = level.floor() as i32 + turn;
                let [first, second, _] = frames()[axis];
                let scale = 2f32.powi(-octave);
                let (x, y) = (along(first, place) * scale, along(second, place) * scale);
                let v = y / SPACING / LEAN;
                let u = x / SPACING - 0.5 * v;
                let near = |x: f32| x.floor() as i32 - 1..=x.floor() as i32 + 2;
                let around: Vec<[i32; 2]> =
                    near(u).flat_map(|i| near(v).map(move |j| [i, j])).collect();
                let seen: Vec<f32> = around
                    .iter()
                    .map(|[i, j]| tent(u - *i as f32, v - *j as f32))
                    .collect();
                for ([i, j], share) in around.into_iter().zip(shares(&seen, SHARPNESS)) {
                    let weight = f64::from(facing * fade * share);
                    if weight == 0.0 || fade < LEAST_SHARE {
                        continue;
                    }
                    squares += weight * weight;
                    let [a, b] = middle([i, j], octave, axis);
                    let x = a + (x - SPACING * (i as f32 + 0.5 * j as f32));
                    let y = b + (y - SPACING * LEAN * j as f32);
                    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let part = |x: f32, far: usize| {
                            let behind = f64::from(x - x.floor());
                            if far == 1 { behind } else { 1.0 - behind }
                        };
                        let at = (y.floor() as usize + dy) * SIDE + x.floor() as usize + dx;
                        all.push((at, weight * part(x, dx) * part(y, dy)));
                    }
                }
            }
        }
        for (at, weight) in all {
            visit(row, at, weight / f64::sqrt(squares));
        }
    }
}

fn twin(places: &[f32], normals: &[f32], table: &[f32]) -> Vec<f64> {
    let mut out = vec![0.0; places.len() / 4 * FEATURES];
    terms(places, normals, |row, at, weight| {
        for f in 0..FEATURES {
            out[row * FEATURES + f] += weight * f64::from(table[at * FEATURES + f]);
        }
    });
    out
}

/// What a gradient amounts to for a smooth picture: where texels lie is no more exact than rounding.
fn twin_backward(places: &[f32], normals: &[f32], grad: &[f32], table: &[f32]) -> f64 {
    let out = twin(places, normals, table);
    out.iter().zip(grad).map(|(o, g)| o * f64::from(*g)).sum()
}

#[test]
fn equals_its_twin() {
    let table = picture(4);
    for rows in [1, 257, 1024, 5000] {
        let (places, normals) = places(rows);
        let what = format!("{rows} places");
        let out = exemplar::forward(&places, &normals, &table);
        assert_close(&what, &out, &twin(&places, &normals, &table), 1e-3);
        let grad = numbers(5, out.len(), -1.0..1.0);
        let found = exemplar::backward(&places, &normals, &grad);
        let found = dot(&found, &table);
        let wanted = twin_backward(&places, &normals, &grad, &table);
        let size = f64::sqrt(rows as f64);
        assert!((found - wanted).abs() < 1e-2 * size, "{found} {wanted}");
    }
}

#[test]
fn operation_has_the_gradient_of_central_differences() {
    let rows = 65;
    let (places, normals) = places(rows);
    let table = picture(6);
    let weights = numbers(7, rows * FEATURES, -1.0..1.0);
    let read = |table| {
        let normals = tensor(&normals, [rows, 3]);
        ops::exemplar(tensor(&places, [rows, 4]), normals, table)
    };
    let tracked = leaf(&table, [PARAMS]);
    let grad = gradient(&tracked, &backward(read(tracked.clone()), &weights));
    // Linear in the table: along a whole picture at once.
    let towards = picture(8);
    let moved = |step: f32| {
        let table: Vec<f32> = table
            .iter()
            .zip(&towards)
            .map(|(x, t)| x + step * t)
            .collect();
        dot(&values(read(tensor(&table, [PARAMS]))), &weights)
    };
    let slope = (moved(0.5) - moved(-0.5)) as f32;
    let found = dot(&grad, &towards) as f32;
    assert!(
        (found - slope).abs() < 1e-3 * slope.abs().max(1.0),
        "{found} {slope}"
    );
}

#[test]
fn places_that_are_not_finite_see_zeros_and_give_no_gradient() {
    let table = picture(9);
    let (good, facing) = places(1);
    let ones = |rows: usize| vec![1.0; rows * FEATURES];
    let good_out = exemplar::forward(&good, &facing, &table);
    let good_grad = exemplar::backward(&good, &facing, &ones(1));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for number in 0..7 {
            let mut poisoned = [0.5; 7];
            poisoned[number] = bad;
            let (place, normal) = poisoned.split_at(4);
            let all = [place, &good, place].concat();
            let normals = [normal, &facing, normal].concat();
            let out = exemplar::forward(&all, &normals, &table);
            let (before, rest) = out.split_at(FEATURES);
            let (between, after) = rest.split_at(FEATURES);
            let mut others = before.iter().chain(after);
            assert!(others.all(|v| *v == 0.0), "{bad} as number {number}");
            assert_same("the good place between", between, &good_out);
            let grad = exemplar::backward(&all, &normals, &ones(3));
            assert_same("the table's gradient", &grad, &good_grad);
        }
    }
}

#[test]
fn without_a_normal_nothing_is_seen() {
    let out = exemplar::forward(&[0.1, 0.2, 0.3, 0.01], &[0.0; 3], &picture(10));
    assert!(out.iter().all(|x| *x == 0.0), "{out:?}");
}

#[test]
fn which_side_a_surface_faces_and_how_long_its_normal_is_make_no_difference() {
    let table = picture(11);
    let (places, normals) = places(200);
    let of = |factor: f32| {
        let normals: Vec<f32> = normals.iter().map(|x| x * factor).collect();
        exemplar::forward(&places, &normals, &table)
    };
    assert_same("the other side", &of(-1.0), &of(1.0));
    assert_same("half as long", &of(0.5), &of(1.0));
}

#[test]
fn footprints_beyond_all_octaves_are_those_at_the_end() {
    let table = picture(12);
    let at =
        |footprint: f32| exemplar::forward(&[0.3, -0.2, 0.1, footprint], &[0.1, 0.9, 0.2], &table);
    assert_same("none", &at(0.0), &at(1e-5));
    assert_same("below none", &at(-1.0), &at(1e-5));
    assert_same("all space", &at(50.0), &at(1.0));
}

/// Of a picture of noise of variance one, blended windows still have about that.
#[test]
fn contrast_stays_where_windows_meet() {
    let table = numbers(13, PARAMS, -1.732..1.732);
    let (places, normals) = places(4000);
    let out = exemplar::forward(&places, &normals, &table);
    let variance = out.iter().map(|x| x * x).sum::<f32>() / out.len() as f32;
    // Between four texels a mean of noise is left: 4/9 of its variance.
    assert!((0.38..0.51).contains(&variance), "{variance}");
}

#[test]
fn does_not_depend_on_threads() {
    let (places, normals) = places(9000);
    let table = numbers(14, PARAMS, -1.0..1.0);
    let grad = numbers(15, 9000 * FEATURES, -1.0..1.0);
    assert_deterministic("forward", || exemplar::forward(&places, &normals, &table));
    // On a GPU, whoever comes first adds first.
    if is_cpu(&device()) {
        assert_deterministic("backward", || exemplar::backward(&places, &normals, &grad));
    }
}

#[test]
fn no_places_see_nothing() {
    let table = numbers(16, PARAMS, -1.0..1.0);
    assert!(exemplar::forward(&[], &[], &table).is_empty());
    let grad = exemplar::backward(&[], &[], &[]);
    assert!(grad.len() == PARAMS && grad.iter().all(|g| *g == 0.0));
}
