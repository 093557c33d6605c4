//! Looks at rays: in groups, prepared, seen and rendered, one beside the other.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{app, config, hash_grid, many_rays};
use impasto_field::{
    Appearance, AppearanceConfig, EncodingConfig, Field, Grids, RayBatch, Shading, prepare_rays,
    render::host, render_rays, see_rays,
};
use impasto_kernels::DensityGrid;
use impasto_kernels::device::{is_cpu, tested};
use rand::SeedableRng;
use rand_pcg::Pcg64;

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
