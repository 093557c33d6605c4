//! Where samples go, and what light does with them.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use burn::tensor::Tensor;
use common::{app, config, grids, hash_grid, many_rays, paint, rays};
use impasto_field::sphere::{self, from_outer_cube, outer_cube, outer_point};
use impasto_field::training::LossWeights;
use impasto_field::{
    Appearance, AppearanceConfig, EncodingConfig, Field, GBuffer, GBufferOptions,
    HierarchicalConfig, OccupancyGrids, Palette, Parameters, RadianceField, RayBatch, Renderer,
    SamplingConfig, VisibleCells, contracted_distance, host,
};
use impasto_kernels::device::tested;
use impasto_kernels::{Density, DensityGrid};
use rand::SeedableRng;
use rand_pcg::Pcg64;

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
    let mut grids = grids(&field, 0.0);
    let levels = (0..grids.outer().cells()).map(|cell| {
        let shell = from_outer_cube(grids.outer().position(cell, [0.5; 3]));
        let inside = shell.is_some_and(|p| (p[3] - 0.2).abs() < 0.05);
        DensityGrid::level_of(if inside { 100.0 } else { 0.0 })
    });
    let outer = DensityGrid::from_levels(levels.collect()).unwrap();
    grids = OccupancyGrids::new(grids.inner().clone(), outer);
    for seed in [None, Some(3)] {
        let samples = field.sample(&rays(), Some(&grids), seed);
        let (cubes, _) = samples.outer.cube.as_chunks::<3>();
        let points: Vec<[f32; 4]> = cubes.iter().map(|c| from_outer_cube(*c).unwrap()).collect();
        for span in &samples.layout.rays {
            let all = span.inner.len() + span.outer.len();
            match seed {
                Some(_) => assert_eq!(all, 40),
                // No light is expected inside.
                None => assert!(span.inner.is_empty() && all <= 40),
            }
            let split = samples.inner.len();
            let radii: Vec<f32> = span.outer.clone().map(|i| points[i - split][3]).collect();
            assert!(radii.is_sorted_by(|a, b| a > b), "near to far");
            let within = radii.iter().filter(|s| (**s - 0.2).abs() < 0.1).count();
            assert!(
                within >= 32,
                "{within} of 40 samples are where the light is"
            );
            let farthest = radii.last().unwrap();
            assert!(*farthest < 0.2, "the last sample stands for everything far");
        }
    }
}

#[test]
fn samples_stand_for_the_whole_ray() {
    let field = Field::new(config(&hash_grid()));
    for density in [0.0, 1.0, 50.0] {
        for seed in [None, Some(3), Some(4)] {
            let samples = field.sample(&rays(), Some(&grids(&field, density)), seed);
            let layout = &samples.layout;
            for (ray, span) in layout.rays.iter().enumerate() {
                let sum = |range: std::ops::Range<usize>| layout.deltas[range].iter().sum::<f32>();
                let (origin, direction) = (rays().origins[ray], rays().directions[ray]);
                let length = sphere::dot(direction, direction).sqrt();
                let far = sphere::exit(origin, direction).unwrap();
                let near = field.config.occupancy().unwrap().near;
                let inner = (far - near) * length;
                let left_out = inner - sum(span.inner.clone());
                // Without a seed only where light is expected: nowhere, everywhere, or in front.
                match (seed, density > 0.0, density > 1.0) {
                    (None, false, _) => assert!(span.inner.is_empty()),
                    (None, true, true) => assert!(left_out > -1e-4 && left_out < inner - 0.12),
                    _ if span.inner.is_empty() => {}
                    _ => assert!(left_out.abs() < 1e-4),
                }
                // The last step is endless.
                assert!(sum(span.outer.start..span.outer.end - 1) < 1.0);
                let depths = span.inner.clone().chain(span.outer.clone());
                let depths: Vec<f32> = depths.map(|i| layout.depths[i]).collect();
                assert!(depths.is_sorted(), "near to far: {depths:?}");
            }
        }
    }
}

#[test]
fn grids_learn_where_the_field_is_dense() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(2);
    let weights = field.init(&mut rng, &device);
    // Half of space is never seen.
    let visible = VisibleCells::new(field.config.occupancy().unwrap(), |point| point[0] > 0.0);
    let everywhere = grids(&field, 1.0);
    let mut grids = everywhere.clone().only(&visible);
    for _ in 0..60 {
        grids.update(&field, &weights, &visible, [0.5, 0.5], &mut rng);
    }
    let samples = field.sample(&rays(), Some(&everywhere), Some(1));
    let densities = host(field.evaluate(&weights, samples.clone()).density);
    let (points, _) = samples.inner.cube.as_chunks::<3>();
    for (point, density) in points.iter().zip(densities) {
        let found = DensityGrid::density_of(grids.inner().level(*point));
        if point[0] > 0.6 {
            assert!((found / density).ln().abs() < 0.5, "{found} for {density}");
        } else if point[0] < 0.4 {
            assert_eq!(found, 0.0, "never seen, never sampled");
        }
    }
}

#[test]
fn empty_space_still_renders() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let grids = grids(&field, 0.0);
    let mut rng = Pcg64::seed_from_u64(1);
    let weights = field.init(&mut rng, &device);
    let [photo, paint] = [app(), paint()]
        .map(|config| Appearance::init(config, field.features(), &mut rng, &device));
    let renderer = Renderer::open(field, weights, Some(grids), photo.clone(), &paint.config);
    for look in [&photo, &paint] {
        let out = renderer.render(&rays(), &[look, look]);
        assert_eq!(out.colours[0], out.colours[1]);
        assert!(out.colours[0].iter().any(|c| *c > 0.0), "the sky is opaque");
        assert!(out.colours[0].iter().all(|c| (0.0..=1.0).contains(c)));
    }
}

#[test]
fn few_samples_carry_the_light() {
    let device = tested();
    for encoding in [hash_grid(), EncodingConfig::Frequency { bands: 4 }] {
        let field = Field::new(config(&encoding));
        let mut rng = Pcg64::seed_from_u64(5);
        let weights = field.init(&mut rng, &device);
        let photo = Appearance::init(app(), field.features(), &mut rng, &device);
        let samples = field.sample(&rays(), Some(&grids(&field, 1.0)), Some(1));
        let said = field.evaluate(&weights, samples).gbuffer(&photo.config);
        let renderer = Renderer::reference(
            field.clone(),
            weights,
            Some(grids(&field, 1.0)),
            photo.clone(),
        );
        let buffer = |least_weight| {
            let options = GBufferOptions {
                config: &photo.config,
                photo: None,
                seed: Some(1),
                least_weight,
                rays_at_once: None,
            };
            let mut buffers = renderer.gbuffer(&rays(), &options);
            buffers.levels.pop().unwrap().remove(0)
        };
        let (all, kept) = (buffer(0.0), buffer(0.05));
        assert!(kept.samples() < all.samples() && kept.samples() >= 3);
        assert_eq!(kept.rays(), 3);
        let opacity = |buffer: &GBuffer| {
            let pixels = host(buffer.shade(&photo));
            pixels.chunks_exact(6).map(|pixel| pixel[3]).sum::<f32>()
        };
        let lost = opacity(&all) - opacity(&kept);
        assert!(lost.abs() < 0.1, "{lost} of three rays' light is lost");
        // Of every ray the farthest sample is kept, and all light behind belongs to it.
        assert!(opacity(&kept) > 2.99, "a ray without its farthest sample");
        assert_eq!(all.samples(), said.samples());
        let (all, said) = (host(all.shade(&photo)), host(said.shade(&photo)));
        let mut pairs = all.iter().zip(&said);
        assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-5 * b.abs().max(1.0)));
    }
}

#[test]
fn merged_samples_let_the_same_light_through_from_the_same_depth() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(5);
    let weights = field.init(&mut rng, &device);
    let surface = Appearance::init(paint(), field.features(), &mut rng, &device);
    let photo = Appearance::init(app(), field.features(), &mut rng, &device);
    // So near to the sphere that nothing is sampled inside.
    let mut outside = RayBatch::default();
    outside.push([0.0, 0.0, 0.99], [0.1, 0.0, 1.0]);
    let renderer = Renderer::reference(
        field.clone(),
        weights.clone(),
        Some(grids(&field, 1.0)),
        photo.clone(),
    );
    for rays in [rays(), outside] {
        let samples = field.sample(&rays, renderer.grids(), Some(1));
        assert_eq!(samples.inner.is_empty(), rays.len() == 1);
        let all = field.evaluate(&weights, samples).gbuffer(&photo.config);
        let options = GBufferOptions {
            config: &surface.config,
            photo: None,
            seed: Some(1),
            least_weight: 0.0,
            rays_at_once: None,
        };
        let merged = renderer.gbuffer(&rays, &options).levels.remove(0).remove(0);
        assert!(merged.samples() <= 2 * rays.len() && merged.samples() < all.samples());
        let (all, few) = (host(all.shade(&photo)), host(merged.shade(&surface)));
        for (all, few) in all.chunks_exact(6).zip(few.chunks_exact(6)) {
            // Opacity and expected depth are linear in the samples, colour is not.
            for i in [3, 4] {
                let error = (all[i] - few[i]).abs() / all[i].abs().max(1.0);
                assert!(error < 1e-3, "{few:?} instead of {all:?}");
            }
            assert!(few[..3].iter().all(|c| c.is_finite()));
        }
    }
}

#[test]
fn merging_one_sample_a_volume_changes_nothing() {
    let device = tested();
    let mut sizes = config(&hash_grid());
    sizes.occupancy_mut().unwrap().samples = 2;
    let field = Field::new(sizes);
    let mut rng = Pcg64::seed_from_u64(5);
    let weights = field.init(&mut rng, &device);
    let photo = Appearance::init(app(), field.features(), &mut rng, &device);
    // Nothing is painted, and whitened colours are so small that none is drawn in.
    let scaled = |factor: f32| {
        [0, 1, 2].map(|row| [0, 1, 2, 3].map(|i| if i == row { factor } else { 0.0 }))
    };
    let mut surface = Appearance::zeros(paint(), field.features(), &device);
    if let Some(paint) = &mut surface.paint {
        paint.palette = Palette {
            whitened: scaled(0.01),
            coloured: scaled(100.0),
        };
    }
    let renderer = Renderer::reference(
        field.clone(),
        weights,
        Some(grids(&field, 1.0)),
        photo.clone(),
    );
    let [apart, merged] = [&photo, &surface].map(|look| {
        let options = GBufferOptions {
            config: &look.config,
            photo: None,
            seed: Some(1),
            least_weight: 0.0,
            rays_at_once: None,
        };
        let buffer = renderer
            .gbuffer(&rays(), &options)
            .levels
            .remove(0)
            .remove(0);
        assert!(buffer.samples() <= 2 * rays().len());
        host(buffer.shade(look))
    });
    for (apart, merged) in apart.chunks_exact(6).zip(merged.chunks_exact(6)) {
        for (a, b) in apart.iter().zip(merged) {
            let same = (a - b).abs() < 1e-3 * a.abs().max(1.0);
            assert!(same, "{merged:?} instead of {apart:?}");
        }
    }
}

#[test]
fn the_loss_is_that_of_the_composite() {
    let device = tested();
    for (bands, density, latent) in [
        (Some(2), Density::Exp, None),
        (None, Density::Abs, None),
        // Residual blocks and layers to fold.
        (Some(2), Density::Abs, Some(5)),
    ] {
        let mut sizes = config(&hash_grid());
        sizes.latent = latent;
        for volume in [&mut sizes.inner, &mut sizes.outer] {
            volume.density = density;
            if latent.is_some() {
                volume.base = vec![8; 3];
            }
        }
        let field = Field::new(sizes);
        let mut rng = Pcg64::seed_from_u64(4);
        let weights = field.init(&mut rng, &device);
        let mut settings = AppearanceConfig { latent, ..app() };
        settings.app.view_bands = bands;
        settings.app.remap = latent.is_some();
        let photo = Appearance::init(settings, field.features(), &mut rng, &device);
        let level = RadianceField::new(weights, photo);
        let samples = field.sample(&many_rays(), Some(&grids(&field, 1.0)), Some(1));
        let wanted = LossWeights {
            surface: 0.2,
            learned_from: 0.0,
            distortion: 0.1,
        };
        let found = host(field.loss(&level, &samples, vec![0.3; 900], wanted));
        let values = field.evaluate(&level.weights, samples);
        let out = host(values.gbuffer(&level.app.config).shade(&level.app));
        let mean = |of: fn(&[f32]) -> f32| out.chunks_exact(6).map(of).sum::<f32>() / 300.0;
        let error = mean(|o| o[..3].iter().map(|c| (c - 0.3).powi(2)).sum::<f32>() / 3.0);
        let loss = error + 0.2 * mean(|o| o[4]) + 0.1 * mean(|o| o[5]);
        assert!(
            (found[1] / error - 1.0).abs() < 1e-4,
            "{} {error}",
            found[1]
        );
        assert!((found[0] / loss - 1.0).abs() < 1e-4, "{} {loss}", found[0]);
        let densities = host(values.density);
        let same = densities
            .iter()
            .zip(&found[2..])
            .all(|(a, b)| (a - b).abs() < 1e-5 * a.max(1.0));
        assert!(same && densities.len() + 2 == found.len());
    }
}

#[test]
fn samples_do_not_depend_on_threads() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let weights = field.init(&mut Pcg64::seed_from_u64(4), &device);
    let visible = VisibleCells::new(field.config.occupancy().unwrap(), |_| true);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let mut grids = grids(&field, 1.0);
            let mut rng = Pcg64::seed_from_u64(1);
            grids.update(&field, &weights, &visible, [0.5, 0.5], &mut rng);
            let levels = [grids.inner().levels(), grids.outer().levels()].concat();
            (
                field.sample(&many_rays(), Some(&grids), Some(3)).inner.cube,
                levels,
            )
        })
    };
    assert!(on(1) == on(2) && on(1) == on(3));
}

#[test]
fn poisoned_rays_take_no_inner_samples() {
    let field = Field::new(config(&hash_grid()));
    let mut rays = RayBatch::default();
    rays.push([f32::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]);
    rays.push([0.0, 0.0, 0.0], [f32::INFINITY, 0.0, 1.0]);
    for seed in [None, Some(1)] {
        let samples = field.sample(&rays, Some(&grids(&field, 1.0)), seed);
        assert!(samples.inner.is_empty());
        assert_eq!(samples.layout.rays.len(), 3);
    }
    assert!((0.0..=1.0).contains(&contracted_distance(1e9)));
}

fn cascade() -> Field {
    let mut sizes = config(&EncodingConfig::Frequency { bands: 2 });
    sizes.sampling = SamplingConfig::Hierarchical(HierarchicalConfig {
        first: 32,
        more: 64,
        near: 0.05,
    });
    Field::new(sizes)
}

#[test]
fn a_cascade_spreads_its_first_samples_from_near_to_infinity() {
    let field = cascade();
    for seed in [None, Some(3)] {
        let samples = field.sample(&rays(), None, seed);
        for (i, span) in samples.layout.rays.iter().enumerate() {
            assert_eq!((span.inner.len(), span.outer.len()), (32, 32));
            let (o, d) = (rays().origins[i], rays().directions[i]);
            let far = sphere::exit(o, d).unwrap();
            let depths = &samples.layout.depths[span.inner.clone()];
            assert!(depths.windows(2).all(|d| d[0] < d[1]));
            assert!(depths[0] >= 0.05 && depths[31] <= far * (1.0 + 1e-6));
            if seed.is_none() {
                assert!((depths[0] - 0.05).abs() < 1e-6 && (depths[31] - far).abs() < 1e-5);
            }
            let steps = &samples.layout.deltas[span.inner.clone()];
            let length = sphere::dot(d, d).sqrt();
            let whole = (far - depths[0]) * length;
            assert!((steps.iter().sum::<f32>() - whole).abs() < 1e-4);
        }
    }
}

#[test]
fn a_cascade_puts_more_samples_where_the_light_is() {
    let field = cascade();
    for seed in [None, Some(5)] {
        let first = field.sample(&rays(), None, seed);
        let split = first.inner.len();
        let (points, _) = first.outer.raw.as_chunks::<4>();
        // A wall 0.6 away inside, seen by the first ray alone; a shell at 1/r = 0.2 outside, which
        // mirrored weights would send to 0.8.
        let wall = |t: f32, ray: usize| ray == 0 && (0.55..0.65).contains(&t);
        let mut densities = vec![0.0; first.len()];
        for (ray, span) in first.layout.rays.iter().enumerate() {
            for i in span.inner.clone() {
                let there = wall(first.layout.depths[i], ray);
                densities[i] = if there { 1e3 } else { 0.0 };
            }
            for i in span.outer.clone() {
                let there = (points[i - split][3] - 0.2).abs() < 0.03;
                densities[i] = if there { 1e3 } else { 0.0 };
            }
        }
        let refined = field.resample(&rays(), first, &densities, seed);
        let split = refined.inner.len();
        let (points, _) = refined.outer.raw.as_chunks::<4>();
        for (ray, span) in refined.layout.rays.iter().enumerate() {
            assert_eq!((span.inner.len(), span.outer.len()), (96, 96));
            let near = |s: f32, to: f32| (s - to).abs() < 0.08;
            let outer = || span.outer.clone().map(|i| points[i - split][3]);
            let shell = outer().filter(|s| near(*s, 0.2)).count();
            assert!(
                shell > 60,
                "{shell} of 96 samples of ray {ray} are at the shell"
            );
            assert!(outer().collect::<Vec<_>>().windows(2).all(|s| s[0] >= s[1]));
            let depths = &refined.layout.depths[span.inner.clone()];
            assert!(depths.windows(2).all(|d| d[0] <= d[1]));
            let inside = depths.iter().filter(|t| near(**t, 0.6)).count();
            assert_eq!(inside > 60, ray == 0, "{inside} of ray {ray} at the wall");
        }
    }
}

#[test]
fn poisoned_densities_leave_a_cascade_finite_places() {
    let field = cascade();
    let first = field.sample(&rays(), None, None);
    let densities = vec![f32::NAN; first.len()];
    let refined = field.resample(&rays(), first, &densities, None);
    assert!(refined.outer.raw.iter().all(|x| x.is_finite()));
    assert!(refined.inner.raw.iter().all(|x| x.is_finite()));
}

#[test]
fn the_gradients_of_parts_of_the_rays_add_up() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(6);
    let weights = field.init(&mut rng, &device);
    let photo = Appearance::init(app(), field.features(), &mut rng, &device);
    let level = RadianceField::new(weights, photo);
    let rays = many_rays();
    let samples = field.sample(&rays, Some(&grids(&field, 1.0)), Some(1));
    let all = rays.len();
    let gradient = |turn: usize| {
        let tracked = level.map(|name, t| {
            let lifted = Tensor::from_inner(t.clone());
            if name == "outer.base" {
                lifted.require_grad()
            } else {
                lifted
            }
        });
        let base = &tracked.weights.outer.base;
        let mut sum = vec![0.0; base.dims()[0]];
        for start in (0..all).step_by(turn) {
            let part = start..(start + turn).min(all);
            let colours = vec![0.3; 3 * part.len()];
            let wanted = LossWeights {
                surface: 0.2,
                learned_from: 0.0,
                distortion: 0.1,
            };
            let share = part.len() as f32 / all as f32;
            let loss = field.loss(&tracked, &samples.of_rays(part), colours, wanted);
            let gradients = loss.slice_dim(0, 0..1).backward();
            let own = host(base.grad(&gradients).unwrap());
            sum.iter_mut().zip(own).for_each(|(s, g)| *s += share * g);
        }
        sum
    };
    let (whole, parts) = (gradient(all), gradient(77));
    let norm = |of: &mut dyn Iterator<Item = f32>| of.map(|x| x * x).sum::<f32>().sqrt();
    let size = norm(&mut whole.iter().copied());
    let error = norm(&mut whole.iter().zip(&parts).map(|(a, b)| a - b));
    assert!(size > 0.0 && error < 1e-5 * size, "{error:e} of {size:e}");
}
