//! Passes without gradients: equal to the kernels that they join, poisoned samples.

mod common;

use common::*;
use impasto_kernels::cpu::passes::{GeometryPass, ShadingPass, ShadingSamples, means};
use impasto_kernels::cpu::{hash_grid, mlp};
use impasto_kernels::{Activation, CompositeLayout, Density, HashGridSpec, MlpSpec};

const FEATURES: usize = 6;
const VIEW: usize = 3;

struct Volume {
    grid: HashGridSpec,
    table: Vec<f32>,
    base: MlpSpec,
    base_params: Vec<f32>,
    geo: MlpSpec,
    geo_params: Vec<f32>,
}

impl Volume {
    fn new(features: usize) -> Self {
        let grid = HashGridSpec {
            levels: 4,
            features,
            log2_entries: 9,
            coarsest: 4.0,
            finest: 40.0,
        };
        let base = MlpSpec::relu(&[4 * features, 16, FEATURES], false, Activation::Relu);
        let geo = MlpSpec::relu(&[FEATURES, 1], false, Activation::Linear);
        Self {
            table: numbers(1, grid.params(), -1.0..1.0),
            base_params: numbers(2, base.params(), -0.6..0.6),
            geo_params: numbers(3, geo.params(), -0.6..0.6),
            grid,
            base,
            geo,
        }
    }

    fn pass(&self, density: Density) -> GeometryPass<'_> {
        GeometryPass::new(
            (self.grid, &self.table),
            (&self.base, &self.base_params),
            (&self.geo, &self.geo_params),
            density,
        )
    }
}

#[test]
fn geometry_is_what_its_kernels_say() {
    for features in [1, 2, 4, 8] {
        let volume = Volume::new(features);
        for (rows, density) in [
            (0, Density::Exp),
            (1, Density::Abs),
            (64, Density::Exp),
            (257, Density::Exp),
            (600, Density::Abs),
        ] {
            let points = numbers(5, rows * 3, -0.1..1.1);
            let (found, densities) = volume.pass(density).run(&points);
            let encoded = hash_grid::forward(&volume.grid, &points, &volume.table);
            let wanted = mlp::forward(&volume.base, &encoded, &volume.base_params);
            let raw = mlp::forward(&volume.geo, &wanted, &volume.geo_params);
            let of = |x: &f32| match density {
                Density::Exp => f64::from(*x).exp(),
                Density::Abs => f64::from(*x).abs(),
            };
            let what = format!("{rows} points, {features} features");
            assert_close(&what, &found, &wide(&wanted), 1e-6);
            let wanted: Vec<f64> = raw.iter().map(of).collect();
            assert_close(&what, &densities, &wanted, 1e-6);
        }
    }
}

#[test]
fn poisoned_points_are_encoded_as_nothing_and_alone() {
    let volume = Volume::new(4);
    let good = numbers(5, 300 * 3, 0.0..1.0);
    let mut bad = good.clone();
    for (row, value) in [(3, f32::NAN), (64, f32::INFINITY), (299, f32::NEG_INFINITY)] {
        bad[3 * row + 1] = value;
    }
    let pass = volume.pass(Density::Exp);
    let [(features, densities), (wanted, wanted_densities)] =
        [&bad, &good].map(|points| pass.run(points));
    let nothing = mlp::forward(&volume.base, &[0.0; 16], &volume.base_params);
    for row in 0..300 {
        let found = &features[row * FEATURES..][..FEATURES];
        if [3, 64, 299].contains(&row) {
            assert_close("nothing", found, &wide(&nothing), 1e-6);
        } else {
            assert_same("others", found, &wanted[row * FEATURES..][..FEATURES]);
            assert_same(
                "others",
                &densities[row..=row],
                &wanted_densities[row..=row],
            );
        }
    }
}

fn layout(rays: usize) -> CompositeLayout {
    let rays = spans(rays);
    let total = rays.last().map_or(0, |span| span.outer.end);
    CompositeLayout {
        rays,
        deltas: numbers(1, total, 0.05..0.6),
        depths: vec![0.0; total],
        distances: vec![0.0; total],
    }
}

struct Scene {
    layout: CompositeLayout,
    densities: Vec<f32>,
    features: [Vec<f32>; 2],
    keep: Vec<bool>,
    views: Vec<f32>,
    app: [MlpSpec; 2],
    params: [Vec<f32>; 2],
}

impl Scene {
    fn new(rays: usize, view: usize) -> Self {
        let layout = layout(rays);
        let total = layout.deltas.len();
        let split: usize = layout.rays.iter().map(|span| span.inner.len()).sum();
        let app = |hidden: usize| {
            let widths = [FEATURES + view, hidden, 3];
            MlpSpec::relu(&widths, false, Activation::Sigmoid)
        };
        let app = [app(8), app(5)];
        Self {
            densities: numbers(2, total, 0.0..6.0),
            features: [
                numbers(3, split * FEATURES, -1.0..1.0),
                numbers(4, (total - split) * FEATURES, -1.0..1.0),
            ],
            keep: (0..total).map(|i| i % 3 != 1).collect(),
            views: numbers(5, rays * view, -1.0..1.0),
            params: app
                .each_ref()
                .map(|app| numbers(6, app.params(), -0.8..0.8)),
            app,
            layout,
        }
    }

    fn colours(&self) -> Vec<f32> {
        let app = [0, 1].map(|v| (&self.app[v], &*self.params[v]));
        ShadingPass::new(app, [FEATURES; 2]).run(&ShadingSamples {
            layout: &self.layout,
            densities: &self.densities,
            features: self.features.each_ref().map(Vec::as_slice),
            keep: &self.keep,
            views: &self.views,
        })
    }

    /// One sample after the other, in double precision but for the network.
    fn twin(&self, view: usize) -> Vec<f64> {
        let split = self.features[0].len() / FEATURES;
        let rays = self.layout.rays.iter().enumerate();
        let colours = rays.map(|(ray, span)| {
            let (mut left, mut sum) = (1.0, [0.0; 3]);
            for i in span.inner.clone().chain(span.outer.clone()) {
                if !self.keep[i] {
                    continue;
                }
                let (v, row) = if i < split { (0, i) } else { (1, i - split) };
                let features = &self.features[v][row * FEATURES..][..FEATURES];
                let input = [features, &self.views[ray * view..][..view]].concat();
                let colour = mlp::forward(&self.app[v], &input, &self.params[v]);
                let passed = (-f64::from(self.densities[i] * self.layout.deltas[i])).exp();
                for (sum, colour) in sum.iter_mut().zip(colour) {
                    *sum += left * (1.0 - passed) * f64::from(colour);
                }
                left *= passed + 1e-6;
            }
            sum
        });
        colours.flatten().collect()
    }
}

#[test]
fn shading_equals_its_twin() {
    for rays in [1, 2, 50, 200] {
        for view in [0, VIEW] {
            let scene = Scene::new(rays, view);
            let what = format!("{rays} rays, views of {view}");
            assert_close(&what, &scene.colours(), &scene.twin(view), 1e-5);
        }
    }
}

#[test]
fn poisoned_samples_spoil_their_ray_alone_and_not_when_left_out() {
    let good = Scene::new(60, VIEW);
    let wanted = good.colours();
    let mut bad = Scene::new(60, VIEW);
    // A sample of ray 9, the second of its two inner ones.
    let poisoned = bad.layout.rays[9].inner.start + 1;
    for value in [f32::NAN, f32::INFINITY] {
        bad.features[0][poisoned * FEATURES] = value;
        bad.keep.clone_from(&good.keep);
        bad.keep[poisoned] = false;
        let mut left_out = Scene::new(60, VIEW);
        left_out.keep.clone_from(&bad.keep);
        assert_same("left out", &bad.colours(), &left_out.colours());
        bad.keep[poisoned] = true;
        left_out.keep[poisoned] = true;
        let (found, others) = (bad.colours(), left_out.colours());
        let own = 9 * 3..10 * 3;
        assert_same("rays before", &found[..own.start], &others[..own.start]);
        assert_same("rays after", &found[own.end..], &others[own.end..]);
        if value.is_nan() {
            assert!(found[own].iter().any(|c| c.is_nan()), "NaN shows");
        }
    }
    assert!(wanted.iter().all(|c| c.is_finite()));
}

#[test]
fn means_are_weighted_sums_of_rows() {
    let weights = numbers(1, 40, 0.0..1.0);
    let groups = || [0..3, 3..3, 3..20, 19..40].into_iter();
    for width in [1, 2, 3, 4, 32, 33] {
        let data = numbers(2, 40 * width, -1.0..1.0);
        let found = means((&data, width), groups(), &weights);
        let wanted: Vec<f64> = groups()
            .flat_map(|span| {
                let column = |c: usize| {
                    let rows = span.clone();
                    rows.map(|r| f64::from(weights[r]) * f64::from(data[r * width + c]))
                        .sum::<f64>()
                };
                (0..width).map(column).collect::<Vec<_>>()
            })
            .collect();
        assert_close(&format!("width {width}"), &found, &wanted, 1e-6);
    }
}
