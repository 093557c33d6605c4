//! One renderer, three backends: what one is opened on renders and buffers rays like the reference,
//! in groups and one by one, alone and beside others.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{app, config, grids, hash_grid, many_rays, paint};
use impasto_field::{
    Appearance, AppearanceConfig, EncodingConfig, Field, FieldWeights, GBuffer, GBufferOptions,
    HierarchicalConfig, OccupancyGrids, RayBatch, RenderedRays, Renderer, SamplingConfig, Shading,
    host,
};
use impasto_kernels::DensityGrid;
use impasto_kernels::device::{is_cpu, tested};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// A field with weights, on the device that is tested.
struct Subject {
    field: Field,
    weights: FieldWeights,
    rng: Pcg64,
}

impl Subject {
    fn new(field: Field) -> Self {
        let mut rng = Pcg64::seed_from_u64(9);
        let weights = field.init(&mut rng, &tested());
        Self {
            field,
            weights,
            rng,
        }
    }

    fn appearance(&mut self, config: AppearanceConfig) -> Appearance {
        let features = self.field.features();
        Appearance::init(config, features, &mut self.rng, &tested())
    }

    /// On the backend that the device gets, and on the reference.
    fn opened(&self, grids: Option<&OccupancyGrids>) -> [Renderer; 2] {
        let parts = || (self.field.clone(), self.weights.clone(), grids.cloned());
        let ((field, weights, one), (_, again, other)) = (parts(), parts());
        let apps = [&app(), &paint()];
        [
            Renderer::open(field.clone(), weights, one, apps),
            Renderer::reference(field, again, other),
        ]
    }
}

/// The same without view directions.
fn blind(mut config: AppearanceConfig) -> AppearanceConfig {
    config.app.view_bands = None;
    config
}

fn bare(config: AppearanceConfig) -> AppearanceConfig {
    AppearanceConfig {
        shading: Shading::Surface { canvas: None },
        ..config
    }
}

fn close(a: &[f32], b: &[f32], tolerance: f32) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance)
}

fn same_depth(a: &RenderedRays, b: &RenderedRays) -> bool {
    let mut pairs = a.depth.iter().zip(&b.depth);
    pairs.all(|(a, b)| (a - b).abs() < 1e-4 * b.abs())
}

#[test]
fn groups_of_rays_are_rays_one_by_one() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let photo = subject.appearance(app());
    let all = many_rays();
    for renderer in subject.opened(Some(&grids(&subject.field, 1.0))) {
        let rendered = renderer.render(&all, &[&photo]);
        for ray in [0, 127, 128, 299] {
            let mut one = RayBatch::default();
            one.push(all.origins[ray], all.directions[ray]);
            let alone = renderer.render(&one, &[&photo]);
            assert!((alone.depth[0] - rendered.depth[ray]).abs() < 1e-4);
            let beside = &rendered.colours[0][3 * ray..3 * ray + 3];
            assert!(close(&alone.colours[0], beside, 1e-5), "ray {ray}");
        }
    }
}

#[test]
fn parts_of_a_gbuffer_shade_like_the_whole() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let photo = subject.appearance(app());
    let style = subject.appearance(paint());
    let all = many_rays();
    let [_, reference] = subject.opened(Some(&grids(&subject.field, 1.0)));
    let options = |config, turn| GBufferOptions {
        config,
        photo: Some(&photo),
        seed: Some(7),
        least_weight: 1e-3,
        rays_at_once: Some(turn),
    };
    for (turn, turns) in [(usize::MAX, 1), (128, 3), (1, 3)] {
        for look in [&photo, &style] {
            let buffers = reference.gbuffer(&all, &options(&look.config, turn));
            let level = buffers.fine();
            if is_cpu(&tested()) {
                assert_eq!((buffers.levels.len(), level.len()), (1, turns));
            }
            assert_eq!(level.iter().map(GBuffer::rays).sum::<usize>(), 300);
            let parts: Vec<f32> = level.iter().flat_map(|p| host(p.shade(look))).collect();
            let whole = reference.gbuffer(&all, &options(&look.config, usize::MAX));
            let whole: Vec<f32> = whole
                .fine()
                .iter()
                .flat_map(|p| host(p.shade(look)))
                .collect();
            let same = parts.iter().zip(&whole);
            let same = same
                .into_iter()
                .all(|(a, b)| (a - b).abs() < 1e-5 * a.abs().max(1.0));
            assert!(
                same && parts.len() == 300 * 6,
                "joined groups shade like themselves"
            );
        }
        let buffers = reference.gbuffer(&all, &options(&photo.config, turn));
        let shaded: Vec<f32> = buffers
            .fine()
            .iter()
            .flat_map(|p| host(p.shade(&photo)))
            .collect();
        let apart = host(buffers.photo.unwrap());
        let same = shaded.iter().zip(&apart);
        assert!(
            same.into_iter()
                .all(|(a, b)| (a - b).abs() < 1e-5 * a.abs().max(1.0))
        );
    }
}

#[test]
fn every_backend_renders_and_buffers_like_the_reference() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let configs = [app(), blind(app()), paint(), bare(paint()), blind(paint())];
    let looks = configs.map(|config| subject.appearance(config));
    let all = many_rays();
    let [opened, reference] = subject.opened(Some(&grids(&subject.field, 1.0)));
    // A GPU shades all samples; what the others leave out is a thousandth of the light.
    let tolerance = if is_cpu(&tested()) { 1e-4 } else { 4e-3 };
    for (i, look) in looks.iter().enumerate() {
        let wanted = reference.render(&all, &[look]);
        let alone = opened.render(&all, &[look]);
        assert!(
            close(&alone.colours[0], &wanted.colours[0], tolerance),
            "look {i}"
        );
        assert!(same_depth(&alone, &wanted), "depth of look {i}");
        let beside = opened.render(&all, &[&looks[2], look]);
        assert!(
            close(&beside.colours[1], &alone.colours[0], 1e-5),
            "look {i} beside another"
        );
        assert!(
            same_depth(&beside, &alone),
            "depth of look {i} beside another"
        );
        if i > 0 && look.config.shading == Shading::Samples {
            continue;
        }
        let options = GBufferOptions {
            config: &look.config,
            photo: Some(&looks[0]),
            seed: None,
            least_weight: 1e-3,
            rays_at_once: None,
        };
        // On a GPU only surfaces are buffered.
        if look.config.shading == Shading::Samples && !is_cpu(&tested()) {
            continue;
        }
        let buffers = opened.gbuffer(&all, &options);
        let shaded = buffers.shade(look);
        assert!(
            close(&shaded, &alone.colours[0], 1e-4),
            "look {i}, from its buffer"
        );
        let photo = host(buffers.photo.unwrap().slice_dim(1, 0..3));
        let rendered = opened.render(&all, &[&looks[0]]);
        assert!(
            close(&photo, &rendered.colours[0], 1e-4),
            "photo beside look {i}"
        );
        assert!(
            close(&host(buffers.depth), &alone.depth, 1e-4),
            "depth of look {i}'s buffer"
        );
    }
}

#[test]
fn frequencies_and_cascades_render_on_the_reference() {
    let mut cascade = config(&EncodingConfig::Frequency { bands: 3 });
    cascade.sampling = SamplingConfig::Hierarchical(HierarchicalConfig {
        first: 8,
        more: 8,
        near: 0.05,
    });
    for sizes in [cascade, config(&EncodingConfig::Frequency { bands: 3 })] {
        let mut subject = Subject::new(Field::new(sizes));
        let photo = subject.appearance(app());
        let with_grids = subject.field.config.occupancy().is_some();
        let grids = with_grids.then(|| grids(&subject.field, 1.0));
        let all = many_rays().part(0..40);
        let [one, other] = subject
            .opened(grids.as_ref())
            .map(|renderer| renderer.render(&all, &[&photo]));
        assert_eq!(one.colours, other.colours);
        assert!(one.colours[0].iter().all(|c| (0.0..=1.0).contains(c)));
    }
}

#[test]
fn every_backend_leaves_out_the_same_samples() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let looks = [app(), paint()].map(|config| subject.appearance(config));
    let looks = [&looks[0], &looks[1]];
    let whole = grids(&subject.field, 1.0);
    // Grids that know of half of the ball only.
    let known = whole.inner();
    let levels = (0..known.cells()).map(|cell| {
        let [x, ..] = known.position(cell, [0.5; 3]);
        DensityGrid::level_of(if x < 0.5 { 1.0 } else { 0.0 })
    });
    let half = DensityGrid::from_levels(levels.collect()).unwrap();
    let half = OccupancyGrids::new(half, grids(&subject.field, 0.0).outer().clone());
    let all = many_rays();
    let [opened, reference] = subject.opened(Some(&half)).map(|r| r.render(&all, &looks));
    let [complete, _] = subject.opened(Some(&whole)).map(|r| r.render(&all, &looks));
    let far = |a: &[f32], b: &[f32], least: f32| {
        let pairs = a.iter().zip(b);
        pairs.filter(|(a, b)| (*a - *b).abs() > least).count()
    };
    let tolerance = if is_cpu(&tested()) { 1e-3 } else { 4e-3 };
    for look in [0, 1] {
        let (found, wanted) = (&opened.colours[look], &reference.colours[look]);
        assert_eq!(far(found, wanted, tolerance), 0);
        assert!(far(found, &complete.colours[look], 1e-3) > all.len());
    }
}

#[test]
fn a_patch_is_painted_as_it_is_rendered() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let style = subject.appearance(paint());
    // One group of rays on every device, so that samples lie in the same places.
    let all = many_rays().part(0..128);
    let options = GBufferOptions {
        config: &style.config,
        photo: None,
        seed: Some(7),
        least_weight: 5e-3,
        rays_at_once: Some(usize::MAX),
    };
    let [patch, alone] = subject
        .opened(Some(&grids(&subject.field, 1.0)))
        .map(|renderer| host(renderer.gbuffer(&all, &options).fine()[0].shade(&style)));
    for (patch, alone) in patch.chunks_exact(6).zip(alone.chunks_exact(6)) {
        assert!(close(&patch[..3], &alone[..3], 1e-3), "{patch:?} {alone:?}");
    }
}
