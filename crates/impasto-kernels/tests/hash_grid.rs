//! Hash-grid encoding: twin, gradients, poisoned points, determinism.

mod common;

use common::on::hash_grid;
use common::*;
use impasto_kernels::HashGridSpec;
use impasto_kernels::device::is_cpu;
use impasto_kernels::ops;

/// Coarse levels fit the table and are stored densely, fine ones are hashed.
fn spec(features: usize) -> HashGridSpec {
    HashGridSpec {
        levels: 5,
        features,
        log2_entries: 9,
        coarsest: 4.0,
        finest: 64.0,
    }
}

/// The eight entries of a point's cell with their weights, by definition.
fn cell(spec: &HashGridSpec, level: usize, point: &[f32]) -> Vec<(usize, f64)> {
    let resolution = spec.resolution(level);
    let side = resolution as usize + 1;
    let entries = 1 << spec.log2_entries;
    let mut low = [0usize; 3];
    let mut fraction = [0f64; 3];
    for axis in 0..3 {
        // In single precision as the kernel: where a point lies in a fine cell is no more exact.
        let at = point[axis].clamp(0.0, 1.0) * resolution;
        low[axis] = (at.floor() as usize).min(side - 2);
        fraction[axis] = f64::from(at) - low[axis] as f64;
    }
    let mut corners = Vec::new();
    for (dx, dy, dz) in (0..8).map(|corner| (corner & 1, corner >> 1 & 1, corner >> 2)) {
        let [x, y, z] = [low[0] + dx, low[1] + dy, low[2] + dz];
        let entry = if side.pow(3) <= entries {
            x + side * y + side * side * z
        } else {
            let [x, y, z] = [x as u64, y as u64 * 2_654_435_761, z as u64 * 805_459_861];
            ((x ^ y ^ z) % entries as u64) as usize
        };
        let share = |d: usize, f: f64| if d == 1 { f } else { 1.0 - f };
        let weight = share(dx, fraction[0]) * share(dy, fraction[1]) * share(dz, fraction[2]);
        corners.push((entry, weight));
    }
    corners
}

/// Calls `visit(output, table entry, weight)` for all that the encoding is made of.
fn terms(spec: &HashGridSpec, points: &[f32], mut visit: impl FnMut(usize, usize, f64)) {
    for (row, point) in points.chunks(3).enumerate() {
        for level in 0..spec.levels {
            for (entry, weight) in cell(spec, level, point) {
                for f in 0..spec.features {
                    let out = row * spec.outputs() + level * spec.features + f;
                    let table = level * spec.level_params() + entry * spec.features + f;
                    visit(out, table, weight);
                }
            }
        }
    }
}

fn twin(spec: &HashGridSpec, points: &[f32], table: &[f32]) -> Vec<f64> {
    let mut out = vec![0.0; points.len() / 3 * spec.outputs()];
    terms(spec, points, |o, t, w| out[o] += w * f64::from(table[t]));
    out
}

fn twin_backward(spec: &HashGridSpec, points: &[f32], grad: &[f32]) -> Vec<f64> {
    let mut table = vec![0.0; spec.params()];
    terms(spec, points, |o, t, w| table[t] += w * f64::from(grad[o]));
    table
}

/// Points inside, outside, and on the faces and corners of the cube.
fn points(rows: usize) -> Vec<f32> {
    let mut points = numbers(1, rows * 3, -0.1..1.1);
    let special = [
        [0.0, 0.0, 0.0],
        [1.0, 1.0, 1.0],
        [0.5, 1.0, 0.25],
        [-3.0, 0.5, 7.0],
    ];
    for (point, special) in points.chunks_exact_mut(3).zip(special) {
        point.copy_from_slice(&special);
    }
    points
}

#[test]
fn levels_of_the_tests_are_dense_and_hashed() {
    let spec = spec(2);
    let dense = |level| (spec.resolution(level) + 1.0).powi(3) <= 512.0;
    assert!(dense(0) && !dense(2) && !dense(4));
    assert_eq!(spec.resolution(0), 4.0);
    assert!((63.0..=64.0).contains(&spec.resolution(4)));
}

#[test]
fn equals_its_twin() {
    for features in [1, 2, 4, 8] {
        let spec = spec(features);
        let table = numbers(2, spec.params(), -1.0..1.0);
        for rows in [1, 257, 1024, 1100] {
            let points = points(rows);
            let what = format!("{features} features, {rows} points");
            let out = hash_grid::forward(&spec, &points, &table);
            assert_close(&what, &out, &twin(&spec, &points, &table), 1e-6);
            let grad = numbers(3, out.len(), -1.0..1.0);
            let table_grad = hash_grid::backward(&spec, &points, &grad);
            assert_close(
                &what,
                &table_grad,
                &twin_backward(&spec, &points, &grad),
                1e-5,
            );
        }
    }
}

#[test]
fn on_borders_of_cells_both_cells_say_the_same() {
    let spec = spec(4);
    let table = numbers(2, spec.params(), -1.0..1.0);
    for level in 0..spec.levels {
        let resolution = spec.resolution(level);
        let at = |cells: f32| (cells / resolution).clamp(0.0, 1.0);
        let points: Vec<f32> = (0..=resolution as usize)
            .flat_map(|i| [at(i as f32), at(resolution - i as f32), at(1.0)])
            .collect();
        let out = hash_grid::forward(&spec, &points, &table);
        assert_close("borders", &out, &twin(&spec, &points, &table), 1e-6);
    }
}

#[test]
fn a_dense_level_that_fills_its_table_ends_with_it() {
    let spec = HashGridSpec {
        levels: 1,
        features: 1,
        log2_entries: 9,
        coarsest: 7.0,
        finest: 7.0,
    };
    let table = numbers(2, 512, -1.0..1.0);
    let out = hash_grid::forward(&spec, &[1.0; 3], &table);
    assert_same("the last corner", &out, &table[511..]);
    let grad = hash_grid::backward(&spec, &[1.0; 3], &[1.0]);
    assert_eq!(grad[511], 1.0);
}

#[test]
fn no_points_encode_to_no_rows() {
    let spec = spec(2);
    let table = numbers(2, spec.params(), -1.0..1.0);
    assert!(hash_grid::forward(&spec, &[], &table).is_empty());
    assert!(
        hash_grid::backward(&spec, &[], &[])
            .iter()
            .all(|g| *g == 0.0)
    );
    let out = ops::hash_encode(tensor(&[], [0, 3]), tensor(&table, [table.len()]), spec);
    assert_eq!(out.dims(), [0, spec.outputs()]);
}

#[test]
fn operation_has_the_gradient_of_central_differences() {
    let spec = spec(2);
    let (rows, count) = (257, spec.params());
    let points = points(rows);
    let table = numbers(4, count, -1.0..1.0);
    let weights = numbers(5, rows * spec.outputs(), -1.0..1.0);
    let encode = |table| ops::hash_encode(tensor(&points, [rows, 3]), table, spec);

    let tracked = leaf(&table, [count]);
    let grad = gradient(&tracked, &backward(encode(tracked.clone()), &weights));
    // Linear in the table: the step may be large.
    check_gradient("hash grid", &table, &grad, 0.25, |table| {
        dot(&values(encode(tensor(table, [count]))), &weights)
    });
}

#[test]
fn points_that_are_not_finite_encode_to_zeros_and_give_no_gradient() {
    let spec = spec(4);
    let table = numbers(6, spec.params(), 0.5..1.0);
    let good = numbers(7, 3, 0.0..1.0);
    let ones = |rows: usize| vec![1.0; rows * spec.outputs()];
    let good_out = hash_grid::forward(&spec, &good, &table);
    let good_grad = hash_grid::backward(&spec, &good, &ones(1));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut poisoned = vec![0.5; 3];
            poisoned[axis] = bad;
            let points = [&poisoned[..], &good, &poisoned].concat();
            let out = hash_grid::forward(&spec, &points, &table);
            let (before, rest) = out.split_at(spec.outputs());
            let (between, after) = rest.split_at(spec.outputs());
            assert!(
                before.iter().chain(after).all(|v| *v == 0.0),
                "{bad} on axis {axis}"
            );
            assert_same("the good point between", between, &good_out);
            let grad = hash_grid::backward(&spec, &points, &ones(3));
            assert_same("the table's gradient", &grad, &good_grad);
        }
    }
}

#[test]
fn does_not_depend_on_threads() {
    let spec = spec(2);
    let points = points(5000);
    let table = numbers(8, spec.params(), -1.0..1.0);
    let grad = numbers(9, 5000 * spec.outputs(), -1.0..1.0);
    assert_deterministic("forward", || hash_grid::forward(&spec, &points, &table));
    // On a GPU, whoever comes first adds first.
    if is_cpu(&device()) {
        assert_deterministic("backward", || hash_grid::backward(&spec, &points, &grad));
    }
}

/// More rows than one axis of a GPU's grid of cubes holds.
#[test]
fn takes_many_points() {
    let spec = HashGridSpec {
        levels: 1,
        features: 1,
        log2_entries: 6,
        coarsest: 4.0,
        finest: 4.0,
    };
    let table = numbers(3, spec.params(), -1.0..1.0);
    let some = points(1000);
    let (few, all) = (&some[..300], some.repeat(8500));
    let wanted = hash_grid::forward(&spec, few, &table);
    let found = hash_grid::forward(&spec, &all, &table);
    assert_eq!(found.len(), 8_500_000);
    assert_eq!(found[found.len() - 1000..][..100], wanted);
}

#[test]
fn takes_views_of_larger_tensors() {
    let spec = spec(2);
    let table = numbers(10, spec.params() + 5, -1.0..1.0);
    let columns = numbers(11, 3 * 10, 0.0..1.0);
    let points: Vec<f32> = (0..30).map(|i| columns[i % 3 * 10 + i / 3]).collect();
    let table_view = tensor(&table, [table.len()]).slice(5..table.len());
    let out = ops::hash_encode(tensor(&columns, [3, 10]).transpose(), table_view, spec);
    let expected = hash_grid::forward(&spec, &points, &table[5..]);
    assert_same("transposed points, shifted table", &values(out), &expected);
}

#[test]
#[should_panic(expected = "1, 2, 4 or 8 features an entry, not 3")]
fn refuses_other_widths() {
    let spec = spec(3);
    let _ = hash_grid::forward(&spec, &[0.5; 3], &vec![0.0; spec.params()]);
}
