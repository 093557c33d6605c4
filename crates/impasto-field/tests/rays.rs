//! Where samples go, and what light does with them.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use burn::tensor::Tensor;
use impasto_field::loss::Wanted;
use impasto_field::sphere::{self, from_outer_cube, outer_cube, outer_point};
use impasto_field::{
    Appearance, AppearanceConfig, BranchWeights, CascadeConfig, DensityActivation, EncodingConfig,
    Field, FieldConfig, FieldWeights, Grids, RayBatch, SamplingConfig, Shading, VolumeConfig,
    prepare_rays, render::host, render_rays, sampling, see_rays,
};
use impasto_kernels::DensityGrid;
use impasto_kernels::device::{is_cpu, tested};
use rand::SeedableRng;
use rand_pcg::Pcg64;

fn config(encoding: &EncodingConfig) -> FieldConfig {
    let volume = VolumeConfig {
        encoding: encoding.clone(),
        base: vec![16, 8],
        geo: vec![],
        latent: None,
        density: DensityActivation::Exp,
    };
    FieldConfig {
        inner: volume.clone(),
        outer: volume,
        sampling: SamplingConfig {
            samples: 40,
            explore: 0.1,
            inner_step: 0.05,
            outer_steps: 64,
            inner_grid: 16,
            outer_grid: 64,
            near: 0.05,
        },
        cascade: None,
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
    let mut grids = field.grids(0.0, None);
    let levels = (0..grids.outer().cells()).map(|cell| {
        let shell = from_outer_cube(grids.outer().position(cell, [0.5; 3]));
        let inside = shell.is_some_and(|p| (p[3] - 0.2).abs() < 0.05);
        DensityGrid::level_of(if inside { 100.0 } else { 0.0 })
    });
    let outer = DensityGrid::from_levels(levels.collect()).unwrap();
    grids = Grids::new(grids.inner().clone(), outer);
    let samples = field.sample(&rays(), &grids, None);
    let (points, _) = samples.outer.raw.as_chunks::<4>();
    for span in &samples.layout.rays {
        assert_eq!(span.inner.len() + span.outer.len(), 40);
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

#[test]
fn samples_stand_for_the_whole_ray() {
    let field = Field::new(config(&hash_grid()));
    for density in [0.0, 1.0, 50.0] {
        for seed in [None, Some(4)] {
            let samples = field.sample(&rays(), &field.grids(density, None), seed);
            let layout = &samples.layout;
            for (ray, span) in layout.rays.iter().enumerate() {
                let sum = |range: std::ops::Range<usize>| layout.deltas[range].iter().sum::<f32>();
                let (origin, direction) = (rays().origins[ray], rays().directions[ray]);
                let length = sphere::dot(direction, direction).sqrt();
                let far = sphere::exit(origin, direction).unwrap();
                let inner = (far - field.config.sampling.near) * length;
                if !span.inner.is_empty() {
                    assert!((sum(span.inner.clone()) - inner).abs() < 1e-4);
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
    let visible = field.visible(|point| point[0] > 0.0);
    let mut grids = field.grids(1.0, Some(&visible));
    for _ in 0..60 {
        field.update_grids(&mut grids, &weights, &visible, [0.5, 0.5], &mut rng);
    }
    let samples = field.sample(&rays(), &field.grids(1.0, None), Some(1));
    let geometry = field.geometry(&weights, samples.clone());
    let densities = host(geometry.densities());
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
    let grids = field.grids(0.0, None);
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
        remap: false,
        latent: None,
        view_bands: Some(2),
        canvas: Some(hash_grid()),
    }
}

#[test]
fn few_samples_carry_the_light() {
    let device = tested();
    for encoding in [hash_grid(), EncodingConfig::Frequency { bands: 4 }] {
        let field = Field::new(config(&encoding));
        let weights = field.init(&mut Pcg64::seed_from_u64(5), &device);
        let samples = field.sample(&rays(), &field.grids(1.0, None), Some(1));
        let geometry = field.geometry(&weights, samples);
        let all = geometry.weights();
        let kept = geometry.contributing(0.05);
        assert!(kept.samples() < geometry.samples() && kept.samples() >= 3);
        assert_eq!(kept.layout().rays.len(), 3);
        assert_eq!(kept.layout().rays[2].outer.end, kept.samples());
        let sum = |weights: &[f32]| weights.iter().sum::<f32>();
        let lost = sum(&all) - sum(&kept.weights());
        assert!(lost.abs() < 0.1, "{lost} of three rays' light is lost");
        let same = geometry.contributing(0.0);
        assert_eq!(same.weights(), all);
    }
}

#[test]
fn merged_samples_let_the_same_light_through_from_the_same_depth() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(5);
    let weights = field.init(&mut rng, &device);
    let app = Appearance::init(app(), field.features(), &mut rng, &device);
    for inner_is_empty in [false, true] {
        let mut samples = field.sample(&rays(), &field.grids(1.0, None), Some(1));
        if inner_is_empty {
            let split = samples.inner.len();
            let keep: Vec<bool> = (0..samples.len()).map(|i| i >= split).collect();
            samples = samples.pruned(&keep);
        }
        let geometry = field.geometry(&weights, samples);
        let surface = AppearanceConfig {
            shading: Shading::Surface,
            ..app.config.clone()
        };
        let merged = geometry.clone().prepared(&surface);
        assert!(merged.samples() <= 2 * rays().len() && merged.samples() < geometry.samples());
        let again = merged.clone().prepared(&surface);
        let [all, few, again] =
            [geometry, merged, again].map(|g| host(g.paintable(&surface).composite(&app)));
        for (all, few) in all.chunks_exact(6).zip(few.chunks_exact(6)) {
            // Opacity and expected depth are linear in the samples, colour is not.
            for i in [3, 4] {
                let error = (all[i] - few[i]).abs() / all[i].abs().max(1.0);
                assert!(error < 1e-3, "{few:?} instead of {all:?}");
            }
            assert!(few[..3].iter().all(|c| *c > 0.0 && *c < 1.0));
        }
        let same = again.iter().zip(&few).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(same, "merging twice changes nothing");
    }
}

/// Rays of several groups.
fn many_rays() -> RayBatch {
    let mut rays = RayBatch::default();
    for i in 0..300 {
        let at = |k: f32| (i as f32 * k).sin();
        rays.push(
            [0.3 * at(0.7), 0.3 * at(1.3), -0.4],
            [0.4 * at(2.1), 0.4 * at(0.9), 1.0],
        );
    }
    rays
}

#[test]
fn groups_of_rays_are_rays_one_by_one() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(9);
    let weights = field.init(&mut rng, &device);
    let grids = field.grids(1.0, None);
    let photo = Appearance::init(
        AppearanceConfig {
            canvas: None,
            ..app()
        },
        field.features(),
        &mut rng,
        &device,
    );
    let all = many_rays();
    let rendered = render_rays(&field, &weights, &grids, &[&photo], &all);
    for ray in [0, 127, 128, 299] {
        let mut one = RayBatch::default();
        one.push(all.origins[ray], all.directions[ray]);
        let alone = render_rays(&field, &weights, &grids, &[&photo], &one);
        assert!((alone.depth[0] - rendered.depth[ray]).abs() < 1e-4);
        for (a, b) in alone.colours[0].iter().zip(&rendered.colours[0][3 * ray..]) {
            assert!((a - b).abs() < 1e-5, "ray {ray}");
        }
    }
    let parts = (&field, &weights, &grids);
    for (turn, turns) in [(usize::MAX, 1), (128, 3), (1, 3)] {
        let prepared = prepare_rays(parts, Some(&photo), (&photo.config, 1e-3, turn), &all, 7);
        let level = prepared.levels.last().unwrap();
        assert_eq!((prepared.levels.len(), level.len()), (1, turns));
        let joined: Vec<f32> = level
            .iter()
            .flat_map(|p| host(p.composite(&photo)))
            .collect();
        let apart = host(prepared.colours.unwrap());
        assert_eq!(joined.len(), 300 * 6);
        let same = joined
            .iter()
            .zip(&apart)
            .all(|(a, b)| (a - b).abs() < 1e-5 * a.abs().max(1.0));
        assert!(same, "joined groups composite like themselves");
    }
}

#[test]
fn rays_are_rendered_as_their_geometry_composites() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(9);
    let weights = field.init(&mut rng, &device);
    let grids = field.grids(1.0, None);
    let parts = (&field, &weights, &grids);
    let settings = |canvas, view_bands, shading| AppearanceConfig {
        canvas,
        view_bands,
        shading,
        ..app()
    };
    let bare = settings(None, app().view_bands, Shading::Samples);
    let blind = settings(None, None, Shading::Samples);
    let painted = settings(Some(hash_grid()), app().view_bands, Shading::Surface);
    let frequency = EncodingConfig::Frequency { bands: 3 };
    let by_position = settings(Some(frequency), app().view_bands, Shading::Surface);
    let at_samples = settings(Some(hash_grid()), None, Shading::Samples);
    let looks = [bare, blind, painted, by_position, at_samples]
        .map(|config| Appearance::init(config, field.features(), &mut rng, &device));
    let all = many_rays();
    let geometry = field.look(&weights, &all, &grids, None);
    // A GPU shades all samples, where there is no canvas.
    let all_of = |config: &AppearanceConfig| !is_cpu(&device) && config.canvas.is_none();
    let wanted = |look: &Appearance| {
        let geometry = match look.config.shading {
            Shading::Samples if all_of(&look.config) => geometry.clone(),
            Shading::Samples => geometry.contributing(1e-3),
            Shading::Surface => geometry.clone().prepared(&look.config),
        };
        host(geometry.paintable(&look.config).composite(look))
    };
    let check = |what: &str, found: &[f32], look: &Appearance| {
        assert_eq!(found.len(), 3 * all.len(), "{what}");
        for (found, wanted) in found.chunks_exact(3).zip(wanted(look).chunks_exact(6)) {
            let same = found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-4);
            assert!(same, "{what}: {found:?} instead of {wanted:?}");
        }
    };
    for (i, look) in looks.iter().enumerate() {
        let alone = render_rays(&field, &weights, &grids, &[look], &all);
        check(&format!("look {i}"), &alone.colours[0], look);
        let with_another = render_rays(&field, &weights, &grids, &[&looks[2], look], &all);
        check(
            &format!("beside look {i}"),
            &with_another.colours[0],
            &looks[2],
        );
        check(&format!("look {i} beside"), &with_another.colours[1], look);
        let same_depth = |depth: &[f32]| {
            let pairs = depth.iter().zip(&alone.depth);
            pairs
                .into_iter()
                .all(|(a, b)| (a - b).abs() < 1e-4 * b.abs())
        };
        assert!(same_depth(&with_another.depth), "depth beside look {i}");
        let seen = see_rays(parts, &looks[0], &look.config, &all);
        check(&format!("photo, seen for look {i}"), &seen.photo, &looks[0]);
        check(&format!("look {i}, seen"), &seen.colours(parts, look), look);
        assert!(same_depth(&seen.depth), "depth seen for look {i}");
    }
    if !is_cpu(&device) {
        return;
    }
    // Grids that know of half of the ball only: what is left out for one set of looks is left out
    // for another, which goes another way.
    let known = grids.inner();
    let levels = (0..known.cells()).map(|cell| {
        let [x, ..] = known.position(cell, [0.5; 3]);
        DensityGrid::level_of(if x < 0.5 { 1.0 } else { 0.0 })
    });
    let half = DensityGrid::from_levels(levels.collect()).unwrap();
    let half = Grids::new(half, field.grids(0.0, None).outer().clone());
    let [bare, _, painted, by_position, _] = &looks;
    let alone = render_rays(&field, &weights, &half, &[bare, painted], &all);
    let beside = [bare, painted, by_position];
    let beside = render_rays(&field, &weights, &half, &beside, &all);
    let far = |[a, b]: [&Vec<f32>; 2]| {
        let pairs = a.iter().zip(b);
        pairs.filter(|(a, b)| (*a - *b).abs() > 1e-3).count()
    };
    for look in [0, 1] {
        assert_eq!(far([&alone.colours[look], &beside.colours[look]]), 0);
        let whole = render_rays(&field, &weights, &grids, &[bare, painted], &all);
        assert!(far([&alone.colours[look], &whole.colours[look]]) > all.len());
    }
}

#[test]
fn a_patch_is_painted_as_it_is_rendered() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(9);
    let weights = field.init(&mut rng, &device);
    let grids = field.grids(1.0, None);
    let settings = AppearanceConfig {
        shading: Shading::Surface,
        ..app()
    };
    let style = Appearance::init(settings.clone(), field.features(), &mut rng, &device);
    let parts = (&field, &weights, &grids);
    let all = many_rays();
    // One group of rays on every device, so that samples lie in the same places.
    let all = all.part(0..128);
    let prepared = prepare_rays(parts, None, (&settings, 5e-3, usize::MAX), &all, 7);
    let patch = host(prepared.levels[0][0].composite(&style));
    let geometry = field.look(&weights, &all, &grids, Some(7));
    let alone = host(
        geometry
            .prepared(&settings)
            .paintable(&settings)
            .composite(&style),
    );
    for (patch, alone) in patch.chunks_exact(6).zip(alone.chunks_exact(6)) {
        for (a, b) in patch[..3].iter().zip(&alone[..3]) {
            assert!((a - b).abs() < 1e-3, "{patch:?} {alone:?}");
        }
    }
}

#[test]
fn the_loss_is_that_of_the_composite() {
    let device = tested();
    for (bands, density, latent) in [
        (Some(2), DensityActivation::Exp, None),
        (None, DensityActivation::Abs, None),
        // Residual blocks and layers to fold.
        (Some(2), DensityActivation::Abs, Some(5)),
    ] {
        let mut sizes = config(&hash_grid());
        for volume in [&mut sizes.inner, &mut sizes.outer] {
            (volume.density, volume.latent) = (density, latent);
            if latent.is_some() {
                volume.base = vec![8; 3];
            }
        }
        let field = Field::new(sizes);
        let mut rng = Pcg64::seed_from_u64(4);
        let weights = field.init(&mut rng, &device);
        let settings = AppearanceConfig {
            canvas: None,
            view_bands: bands,
            remap: latent.is_some(),
            latent,
            ..app()
        };
        let photo = Appearance {
            latent: weights.inner.latent.clone(),
            ..Appearance::init(settings, field.features(), &mut rng, &device)
        };
        let samples = field.sample(&many_rays(), &field.grids(1.0, None), Some(1));
        let wanted = Wanted {
            colours: vec![0.3; 900],
            depth: 0.2,
            distortion: 0.1,
        };
        let found = host(field.loss(&weights, &photo, &samples, wanted));
        let geometry = field.geometry(&weights, samples);
        let out = host(geometry.clone().paintable(&photo.config).composite(&photo));
        let mean = |of: fn(&[f32]) -> f32| out.chunks_exact(6).map(of).sum::<f32>() / 300.0;
        let error = mean(|o| o[..3].iter().map(|c| (c - 0.3).powi(2)).sum::<f32>() / 3.0);
        let loss = error + 0.2 * mean(|o| o[4]) + 0.1 * mean(|o| o[5]);
        assert!(
            (found[1] / error - 1.0).abs() < 1e-4,
            "{} {error}",
            found[1]
        );
        assert!((found[0] / loss - 1.0).abs() < 1e-4, "{} {loss}", found[0]);
        let densities = host(geometry.densities());
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
    let visible = field.visible(|_| true);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let mut grids = field.grids(1.0, None);
            let mut rng = Pcg64::seed_from_u64(1);
            field.update_grids(&mut grids, &weights, &visible, [0.5, 0.5], &mut rng);
            let levels = [grids.inner().levels(), grids.outer().levels()].concat();
            (
                field.sample(&many_rays(), &grids, Some(3)).inner.raw,
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
    let samples = field.sample(&rays, &field.grids(1.0, None), None);
    assert!(samples.inner.is_empty());
    assert_eq!(samples.layout.rays.len(), 3);
    assert!((0.0..=1.0).contains(&sampling::contracted_distance(1e9)));
}

fn cascade() -> Field {
    let mut sizes = config(&EncodingConfig::Frequency { bands: 2 });
    sizes.cascade = Some(CascadeConfig {
        first: 32,
        more: 64,
    });
    Field::new(sizes)
}

#[test]
fn a_cascade_spreads_its_first_samples_from_near_to_infinity() {
    let field = cascade();
    let grids = field.grids(0.0, None);
    for seed in [None, Some(3)] {
        let samples = field.sample(&rays(), &grids, seed);
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
    let grids = field.grids(0.0, None);
    for seed in [None, Some(5)] {
        let first = field.sample(&rays(), &grids, seed);
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
        let refined = field.refine(&rays(), first, &densities, seed);
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
    let first = field.sample(&rays(), &field.grids(0.0, None), None);
    let densities = vec![f32::NAN; first.len()];
    let refined = field.refine(&rays(), first, &densities, None);
    assert!(refined.outer.raw.iter().all(|x| x.is_finite()));
    assert!(refined.inner.raw.iter().all(|x| x.is_finite()));
}

#[test]
fn the_gradients_of_parts_of_the_rays_add_up() {
    let device = tested();
    let field = Field::new(config(&hash_grid()));
    let mut rng = Pcg64::seed_from_u64(6);
    let weights = field.init(&mut rng, &device);
    let settings = AppearanceConfig {
        canvas: None,
        ..app()
    };
    let photo = Appearance::init(settings, field.features(), &mut rng, &device);
    let rays = many_rays();
    let samples = field.sample(&rays, &field.grids(1.0, None), Some(1));
    let all = rays.len();
    let gradient = |turn: usize| {
        let mut sum = vec![0.0; host(weights.outer.base.clone()).len()];
        let base = Tensor::from_inner(weights.outer.base.clone()).require_grad();
        let lift = |t: &Tensor<1>| Tensor::from_inner(t.clone());
        let branch = |w: &BranchWeights, base: Tensor<1>| BranchWeights {
            encoding: lift(&w.encoding),
            base,
            geo: lift(&w.geo),
            latent: None,
        };
        let tracked = FieldWeights {
            inner: branch(&weights.inner, lift(&weights.inner.base)),
            outer: branch(&weights.outer, base.clone()),
            coarse: None,
        };
        let photo = Appearance {
            inner: lift(&photo.inner),
            outer: lift(&photo.outer),
            ..photo.clone()
        };
        for start in (0..all).step_by(turn) {
            let part = start..(start + turn).min(all);
            let wanted = Wanted {
                colours: vec![0.3; 3 * part.len()],
                depth: 0.2,
                distortion: 0.1,
            };
            let share = part.len() as f32 / all as f32;
            let loss = field.loss(&tracked, &photo, &samples.of_rays(part), wanted);
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
