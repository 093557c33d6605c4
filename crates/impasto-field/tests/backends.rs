//! One renderer, three backends: what one is opened on renders and buffers rays like the reference,
//! in groups and one by one, alone and beside others.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{app, config, grids, ground, hash_grid, many_rays, paint};
use impasto_field::renderer::{SHADE_LEAST, pixels};
use impasto_field::{
    Appearance, AppearanceConfig, EncodingConfig, Field, FieldWeights, GBuffer, GBufferOptions,
    Ground, HierarchicalConfig, OccupancyGrids, RayBatch, RayBuffers, Renderer, SamplingConfig,
    Shading, host,
};
use impasto_kernels::DensityGrid;
use impasto_kernels::device::{is_cpu, tested};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// A field with weights, on the device that is tested.
struct Subject {
    field: Field,
    weights: FieldWeights,
    ground: Ground,
    rng: Pcg64,
}

impl Subject {
    fn new(field: Field) -> Self {
        let mut rng = Pcg64::seed_from_u64(9);
        let weights = field.init(&mut rng, &tested());
        let photo = Appearance::init(app(), field.features(), &mut rng, &tested());
        Self {
            ground: ground(photo, &mut rng),
            field,
            weights,
            rng,
        }
    }

    /// Random weights; with the field's learned vector, where the configuration asks for it.
    fn appearance(&mut self, config: AppearanceConfig) -> Appearance {
        let latent = config.latent.and(self.weights.latent.clone());
        let features = self.field.features();
        let appearance = Appearance::init(config, features, &mut self.rng, &tested());
        Appearance {
            latent,
            ..appearance
        }
    }

    /// On the backend that the device gets for styles of a configuration, and on the reference.
    fn opened(&self, grids: Option<&OccupancyGrids>, style: &AppearanceConfig) -> [Renderer; 2] {
        let parts = || (self.field.clone(), self.weights.clone(), grids.cloned());
        let ((field, weights, one), (_, again, other)) = (parts(), parts());
        [
            Renderer::open(field.clone(), weights, one, self.ground.clone(), style),
            Renderer::reference(field, again, other, self.ground.clone()),
        ]
    }

    /// The weight that samples need to be shaded by what is opened for styles of a configuration:
    /// none on a GPU that keeps everything to itself.
    fn shaded_from(&self, style: &AppearanceConfig) -> f32 {
        let stays = style.shading != Shading::Samples && self.field.config.latent.is_none();
        let on_gpu = stays && !is_cpu(&tested());
        if on_gpu { 0.0 } else { SHADE_LEAST }
    }
}

/// The same without view directions.
fn blind(mut config: AppearanceConfig) -> AppearanceConfig {
    config.app.view_bands = None;
    config
}

/// Unless numbers differ by no more than a tolerance, of what is greater than one in units of it.
fn assert_close(what: &str, found: &[f32], wanted: &[f32], tolerance: f32) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (i, (a, b)) in found.iter().zip(wanted).enumerate() {
        let same = (a - b).abs() < tolerance * b.abs().max(1.0);
        assert!(same, "{what}: {a} instead of {b} at {i}");
    }
}

/// Of one renderer: no more than rounding, whatever else is rendered.
fn assert_same_depth(what: &str, found: &[f32], wanted: &[f32]) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (ray, (a, b)) in found.iter().zip(wanted).enumerate() {
        let same = (a - b).abs() < 1e-4 * b.abs();
        assert!(same, "{what}: {a} instead of {b}, ray {ray}");
    }
}

/// Of two backends. On a GPU rounding decides where a few samples are, and at which of two half of
/// a ray's light is reached.
fn assert_depths_agree(what: &str, found: &[f32], wanted: &[f32]) {
    if is_cpu(&tested()) {
        return assert_same_depth(what, found, wanted);
    }
    assert_eq!(found.len(), wanted.len(), "{what}");
    let pairs = found.iter().zip(wanted);
    let far = pairs.filter(|(a, b)| (**a - **b).abs() > 0.01 * b.abs().max(0.1));
    let far = far.count();
    assert!(far * 50 <= found.len(), "{what}: {far} depths differ");
}

fn unseeded<'a>(
    config: &'a AppearanceConfig,
    photo: Option<&'a Appearance>,
    least_weight: f32,
) -> GBufferOptions<'a> {
    GBufferOptions {
        config,
        photo,
        seed: None,
        least_weight,
        rays_at_once: None,
    }
}

/// What rays should look like: the reference's G-buffer, shaded.
fn wanted(reference: &Renderer, rays: &RayBatch, look: &Appearance, least: f32) -> Vec<f32> {
    let buffers = reference.gbuffer(rays, &unseeded(&look.config, None, least));
    buffers.shade(look)
}

/// A renderer that is held against the reference.
struct Checked<'a> {
    name: String,
    renderer: &'a Renderer,
    reference: &'a Renderer,
    rays: &'a RayBatch,
    /// Samples of less weight are not shaded.
    least: f32,
}

impl Checked<'_> {
    fn colours(&self, what: &str, found: &[f32], look: &Appearance) {
        let wanted = wanted(self.reference, self.rays, look, self.least);
        assert_close(&format!("{}: {what}", self.name), found, &wanted, 1e-4);
    }

    /// Alone, beside another, and from G-buffers that were made with and without a photo.
    fn check(&self, look: &Appearance, photo: &Appearance, other: &Appearance) {
        let (renderer, rays) = (self.renderer, self.rays);
        let alone = renderer.render(rays, &[look]);
        self.colours("alone", &alone.colours[0], look);
        let depth = self.reference.render(rays, &[look]).depth;
        assert_depths_agree(&format!("{}: depth", self.name), &alone.depth, &depth);
        let beside = renderer.render(rays, &[other, look]);
        self.colours("the other beside it", &beside.colours[0], other);
        self.colours("beside another", &beside.colours[1], look);
        let what = format!("{}: depth beside another", self.name);
        assert_same_depth(&what, &beside.depth, &alone.depth);
        for photo in [None, Some(photo)] {
            // What a renderer leaves out of a photo on the way is what it leaves out of a render.
            let options = unseeded(&look.config, photo, SHADE_LEAST);
            let buffers = renderer.gbuffer(rays, &options);
            self.colours("from its buffer", &buffers.shade(look), look);
            assert_eq!(buffers.photo.is_some(), photo.is_some());
            if let (Some(shaded), Some(photo)) = (buffers.photo, photo) {
                self.colours("the photo before its buffer", &pixels(shaded), photo);
            }
            let what = format!("{}: depth of its buffer", self.name);
            assert_same_depth(&what, &host(buffers.depth), &alone.depth);
        }
    }
}

/// The same checks of what is opened and of the reference. The first look is the photo's, `other` is
/// rendered beside each.
fn check_all(subject: &Subject, looks: &[Appearance], other: &Appearance) {
    let (rays, grids) = (many_rays(), grids(&subject.field, 1.0));
    for (i, look) in looks.iter().enumerate() {
        let [opened, reference] = subject.opened(Some(&grids), &look.config);
        let backends = [
            ("opened", &opened, subject.shaded_from(&look.config)),
            ("reference", &reference, SHADE_LEAST),
        ];
        for (name, renderer, least) in backends {
            let checked = Checked {
                name: format!("look {i}, {name}"),
                renderer,
                reference: &reference,
                rays: &rays,
                least,
            };
            checked.check(look, &looks[0], other);
        }
    }
}

/// All that shading says of rays, `[rays, 6]`, from buffer after buffer.
fn composites(buffers: &RayBuffers, look: &Appearance) -> Vec<f32> {
    let parts = buffers.fine().iter();
    parts.flat_map(|part| host(part.shade(look))).collect()
}

#[test]
fn groups_of_rays_are_rays_one_by_one() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let photo = subject.appearance(app());
    let all = many_rays();
    for renderer in subject.opened(Some(&grids(&subject.field, 1.0)), &paint()) {
        let rendered = renderer.render(&all, &[&photo]);
        for ray in [0, 127, 128, 299] {
            let mut one = RayBatch::default();
            one.push_painted(all.origins[ray], all.directions[ray], all.touches[ray]);
            let alone = renderer.render(&one, &[&photo]);
            assert!((alone.depth[0] - rendered.depth[ray]).abs() < 1e-4);
            let beside = &rendered.colours[0][3 * ray..3 * ray + 3];
            assert_close(&format!("ray {ray}"), &alone.colours[0], beside, 1e-5);
        }
    }
}

#[test]
fn parts_of_a_gbuffer_shade_like_the_whole() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let looks = [app(), paint()].map(|config| subject.appearance(config));
    let (all, grids) = (many_rays(), grids(&subject.field, 1.0));
    let rounding = if is_cpu(&tested()) { 1e-5 } else { 1e-4 };
    for look in &looks {
        for renderer in subject.opened(Some(&grids), &look.config) {
            let buffers = |seed, turn| {
                let options = GBufferOptions {
                    seed,
                    rays_at_once: Some(turn),
                    ..unseeded(&look.config, Some(&looks[0]), SHADE_LEAST)
                };
                renderer.gbuffer(&all, &options)
            };
            // Without a seed samples lie in the same places, whatever the groups.
            let whole = composites(&buffers(None, usize::MAX), look);
            assert_eq!(whole.len(), 300 * 6);
            for (turn, turns) in [(usize::MAX, 1), (128, 3), (1, 3)] {
                let found = buffers(None, turn);
                let groups = found.fine().len();
                // Only a GPU has groups of one ray.
                let single = turn == 1 && groups == 300 && !is_cpu(&tested());
                assert!(groups == turns || single, "{groups} groups of {turn}");
                assert_eq!(found.levels.len(), 1);
                assert_eq!(found.fine().iter().map(GBuffer::rays).sum::<usize>(), 300);
                assert_close("parts", &composites(&found, look), &whole, rounding);
            }
        }
    }
}

#[test]
fn joined_groups_composite_like_the_photo_that_was_shaded_on_the_way() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let photo = subject.appearance(app());
    let (all, grids) = (many_rays(), grids(&subject.field, 1.0));
    let [opened, reference] = subject.opened(Some(&grids), &photo.config);
    // Not the same operations on what is opened.
    for (renderer, tolerance) in [(opened, 1e-4), (reference, 1e-5)] {
        for turn in [usize::MAX, 128, 1] {
            let options = GBufferOptions {
                seed: Some(7),
                rays_at_once: Some(turn),
                ..unseeded(&photo.config, Some(&photo), 1e-3)
            };
            let mut buffers = renderer.gbuffer(&all, &options);
            let apart = buffers.photo.take().unwrap();
            let [rays, width] = apart.dims();
            assert_eq!(rays, 300);
            let joined = composites(&buffers, &photo);
            let joined = joined.chunks_exact(6).flat_map(|ray| &ray[..width]);
            let joined: Vec<f32> = joined.copied().collect();
            assert_close("joined groups", &host(apart), &joined, tolerance);
        }
    }
}

#[test]
fn every_backend_renders_and_buffers_like_the_reference() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let configs = [
        app(),
        blind(app()),
        paint(),
        // Other weights of the same configuration.
        paint(),
    ];
    let looks = configs.map(|config| subject.appearance(config));
    check_all(&subject, &looks, &looks[2]);
}

#[test]
fn every_backend_folds_learned_vectors_like_the_reference() {
    let mut sizes = config(&hash_grid());
    sizes.latent = Some(5);
    for volume in [&mut sizes.inner, &mut sizes.outer] {
        volume.base = vec![8; 3];
    }
    let mut subject = Subject::new(Field::new(sizes));
    let mut photo = AppearanceConfig {
        latent: Some(5),
        ..app()
    };
    photo.app.remap = true;
    let mut remapped = paint();
    remapped.app.remap = true;
    let looks = [photo, remapped, paint()].map(|config| subject.appearance(config));
    check_all(&subject, &looks, &looks[2]);
}

#[test]
fn a_buffer_of_all_samples_is_what_the_field_says() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let photo = subject.appearance(app());
    let (all, grids) = (many_rays(), grids(&subject.field, 1.0));
    let samples = subject.field.sample(&all, Some(&grids), None);
    let values = subject.field.evaluate(&subject.weights, samples);
    let said = host(values.gbuffer(&photo.config).shade(&photo));
    for renderer in subject.opened(Some(&grids), &photo.config) {
        let buffers = renderer.gbuffer(&all, &unseeded(&photo.config, None, 0.0));
        let count = buffers.fine().iter().map(GBuffer::samples).sum::<usize>();
        assert_eq!(count, values.samples.len());
        assert_close("all samples", &composites(&buffers, &photo), &said, 1e-4);
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
            .opened(grids.as_ref(), &paint())
            .map(|renderer| renderer.render(&all, &[&photo]));
        assert_eq!(one.colours, other.colours);
        assert!(one.colours[0].iter().all(|c| (0.0..=1.0).contains(c)));
    }
}

#[test]
fn every_backend_leaves_out_the_same_samples() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let looks = [app(), paint(), paint()].map(|config| subject.appearance(config));
    let [photo, painted, unpainted] = &looks;
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
    let [opened, reference] = subject.opened(Some(&half), &paint());
    let [complete, _] = subject.opened(Some(&whole), &paint());
    let alone = opened.render(&all, &[photo, painted]).colours;
    let beside = opened.render(&all, &[photo, painted, unpainted]).colours;
    let complete = complete.render(&all, &[photo, painted]).colours;
    let far = |a: &[f32], b: &[f32], least: f32| {
        assert_eq!(a.len(), b.len());
        let pairs = a.iter().zip(b);
        pairs.filter(|(a, b)| (*a - *b).abs() > least).count()
    };
    let tolerance = if is_cpu(&tested()) { 1e-3 } else { 4e-3 };
    for (i, look) in [photo, painted].into_iter().enumerate() {
        let wanted = wanted(&reference, &all, look, subject.shaded_from(&paint()));
        assert_eq!(far(&alone[i], &wanted, tolerance), 0, "look {i}");
        assert_eq!(far(&alone[i], &beside[i], 1e-3), 0, "look {i} beside");
        assert!(far(&alone[i], &complete[i], 1e-3) > all.len(), "look {i}");
    }
}

#[test]
fn a_patch_is_painted_as_it_is_rendered() {
    let mut subject = Subject::new(Field::new(config(&hash_grid())));
    let style = subject.appearance(paint());
    // One group of rays on every device, so that samples lie in the same places.
    let all = many_rays().part(0..128);
    let options = GBufferOptions {
        seed: Some(7),
        rays_at_once: Some(usize::MAX),
        ..unseeded(&style.config, None, 5e-3)
    };
    let [patch, alone] = subject
        .opened(Some(&grids(&subject.field, 1.0)), &paint())
        .map(|renderer| renderer.gbuffer(&all, &options));
    assert_eq!((patch.fine().len(), alone.fine().len()), (1, 1));
    let colours = |buffers: &RayBuffers| -> Vec<f32> {
        let rows = composites(buffers, &style);
        let rows = rows.chunks_exact(6).flat_map(|row| &row[..3]);
        rows.copied().collect()
    };
    assert_close("a patch", &colours(&patch), &colours(&alone), 1e-3);
}
