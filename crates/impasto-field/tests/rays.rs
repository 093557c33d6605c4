//! Where samples go, and what light does with them.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use burn::tensor::Device;
use impasto_field::sphere::{from_outer_cube, outer_cube, outer_point};
use impasto_field::{
    Appearance, AppearanceConfig, DensityActivation, EncodingConfig, Field, FieldConfig, Grids,
    RayBatch, SamplingConfig, Shading, VolumeConfig, render::host, render_rays, sampling,
};
use impasto_kernels::OccupancyGrid;
use rand::SeedableRng;
use rand_pcg::Pcg64;

fn config(encoding: &EncodingConfig) -> FieldConfig {
    let volume = VolumeConfig {
        encoding: encoding.clone(),
        base: vec![16, 8],
        geo: vec![],
        density: DensityActivation::Exp,
    };
    FieldConfig {
        inner: volume.clone(),
        outer: volume,
        sampling: SamplingConfig {
            inner_step: 0.05,
            outer_steps: 40,
            inner_grid: 16,
            outer_grid: 64,
            near: 0.05,
        },
    }
}

fn hash_grid() -> EncodingConfig {
    EncodingConfig::HashGrid {
        levels: 4,
        features: 2,
        log2_entries: 10,
        coarsest: 4.0,
        finest: 32.0,
    }
}

fn rays() -> RayBatch {
    let mut rays = RayBatch::default();
    rays.push([0.2, 0.1, -0.5], [0.1, -0.2, 1.0]);
    rays.push([0.0, 0.0, -0.5], [0.0, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.3, 0.3, 1.0]);
    rays
}

fn full(field: &Field) -> Grids {
    Grids {
        inner: OccupancyGrid::full(field.config.sampling.inner_grid),
        outer: OccupancyGrid::full(field.config.sampling.outer_grid),
    }
}

fn empty(grid: &OccupancyGrid) -> OccupancyGrid {
    OccupancyGrid::from_flags(vec![false; grid.cells()]).unwrap()
}

#[test]
fn rays_through_the_origin_and_to_infinity_are_finite() {
    for inverse_radius in [0.0, 1e-6, 0.2, 1.0] {
        for (origin, direction) in rays().origins.into_iter().zip(rays().directions) {
            let (point, depth) = outer_point(origin, direction, inverse_radius);
            assert!(point.iter().all(|c| c.is_finite()) && depth > 0.0);
            let length: f32 = point[..3].iter().map(|c| c * c).sum();
            assert!(
                (length - 1.0).abs() < 1e-5,
                "outer points lie on the unit sphere"
            );
        }
    }
}

#[test]
fn outer_cube_can_be_undone() {
    for s in [0.0, 0.3, 0.999] {
        let point = [0.6, 0.0, -0.8, s];
        let back = from_outer_cube(outer_cube(point)).unwrap();
        assert!(
            point.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-4),
            "{point:?} became {back:?}"
        );
    }
    assert_eq!(from_outer_cube([0.5, 0.5, 0.5]), None);
}

#[test]
fn a_shell_receives_its_samples_where_it_is() {
    let field = Field::new(config(&hash_grid()));
    let mut grids = full(&field);
    let flags = (0..grids.outer.cells()).map(|cell| {
        let shell = from_outer_cube(grids.outer.position(cell, [0.5; 3]));
        shell.is_some_and(|p| (p[3] - 0.2).abs() < 0.05)
    });
    grids.outer = OccupancyGrid::from_flags(flags.collect()).unwrap();
    let samples = field.sample(&rays(), &grids, None);
    let (points, _) = samples.outer.raw.as_chunks::<4>();
    for span in &samples.layout.rays {
        let split = samples.inner.len();
        let radii: Vec<f32> = span.outer.clone().map(|i| points[i - split][3]).collect();
        let (farthest, shell) = radii.split_last().unwrap();
        assert!(
            *farthest < 0.03,
            "the last sample stands for everything far"
        );
        assert!(
            shell.len() >= 2 && shell.iter().all(|s| (s - 0.2).abs() < 0.1),
            "{shell:?}"
        );
        assert!(shell.is_sorted_by(|a, b| a > b), "near to far");
    }
}

#[test]
fn empty_space_has_no_inner_samples_and_still_renders() {
    let device = Device::flex();
    let field = Field::new(config(&hash_grid()));
    let mut grids = full(&field);
    grids.inner = empty(&grids.inner);
    grids.outer = empty(&grids.outer);
    let samples = field.sample(&rays(), &grids, Some(3));
    assert_eq!((samples.inner.len(), samples.outer.len()), (0, 3));
    let mut rng = Pcg64::seed_from_u64(1);
    let weights = field.init(&mut rng, &device);
    let app = Appearance::init(app(), field.features(), &mut rng, &device);
    let out = render_rays(&field, &weights, &grids, &[&app, &app], &rays());
    assert_eq!(out.colours[0], out.colours[1]);
    assert!(
        out.colours[0].iter().all(|c| *c > 0.0 && *c < 1.0),
        "the sky is opaque"
    );
}

fn app() -> AppearanceConfig {
    AppearanceConfig {
        hidden: vec![16],
        layer_norm: true,
        shading: Shading::Samples,
        view_bands: Some(2),
        canvas: Some(hash_grid()),
    }
}

#[test]
fn light_followed_front_to_back_agrees_with_the_composite() {
    let device = Device::flex();
    for encoding in [hash_grid(), EncodingConfig::Frequency { bands: 4 }] {
        let field = Field::new(config(&encoding));
        let weights = field.init(&mut Pcg64::seed_from_u64(5), &device);
        let samples = field.sample(&rays(), &full(&field), Some(1));
        let light = field.light(&weights, &samples, 0.0);
        let truth = field.geometry(&weights, samples.clone()).weights();
        assert!(light.lit.iter().all(|lit| *lit));
        for (ours, truth) in light.weights.iter().zip(&truth) {
            assert!((ours - truth).abs() < 1e-4, "{ours} instead of {truth}");
        }
        let kept = field.contributing(&weights, &samples, 0.3);
        assert!(kept.len() < samples.len() && kept.len() >= 3);
        assert_eq!(kept.layout.rays.len(), 3);
        let last = kept.layout.rays[2].outer.end;
        assert_eq!(last, kept.len());
    }
}

#[test]
fn merged_samples_let_the_same_light_through_from_the_same_depth() {
    let device = Device::flex();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(5);
    let weights = field.init(&mut rng, &device);
    let app = Appearance::init(app(), field.features(), &mut rng, &device);
    for inner_is_empty in [false, true] {
        let mut grids = full(&field);
        if inner_is_empty {
            grids.inner = empty(&grids.inner);
        }
        let geometry = field.geometry(&weights, field.sample(&rays(), &grids, Some(1)));
        let surface = AppearanceConfig {
            shading: Shading::Surface,
            ..app.config.clone()
        };
        let merged = geometry.clone().prepared(&surface);
        assert!(merged.samples() <= 2 * rays().len() && merged.samples() < geometry.samples());
        let [all, few] = [&geometry, &merged].map(|g| host(g.composite(&app)));
        for (all, few) in all.chunks_exact(6).zip(few.chunks_exact(6)) {
            // Opacity and expected depth are linear in the samples, colour is not.
            for i in [3, 4] {
                let error = (all[i] - few[i]).abs() / all[i].abs().max(1.0);
                assert!(error < 1e-3, "{few:?} instead of {all:?}");
            }
            assert!(few[..3].iter().all(|c| *c > 0.0 && *c < 1.0));
        }
        let again = host(merged.clone().prepared(&surface).composite(&app));
        let once = host(merged.composite(&app));
        let same = again.iter().zip(&once).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(same, "merging twice changes nothing");
    }
}

#[test]
fn poisoned_rays_take_no_inner_samples() {
    let field = Field::new(config(&hash_grid()));
    let mut rays = RayBatch::default();
    rays.push([f32::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]);
    rays.push([0.0, 0.0, 0.0], [f32::INFINITY, 0.0, 1.0]);
    let samples = field.sample(&rays, &full(&field), None);
    assert!(samples.inner.is_empty());
    assert_eq!(samples.layout.rays.len(), 3);
    assert!((0.0..=1.0).contains(&sampling::contracted_distance(1e9)));
}
