//! What stays on a GPU is what the host computes. `IMPASTO_DEVICE=gpu` names the device.
#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use burn::tensor::{Device, Tensor};
use impasto_field::sampling::{Samples, VolumeSamples};
use impasto_field::training::{BatchSize, FieldTraining, LossWeights};
use impasto_field::{
    AppConfig, Appearance, AppearanceConfig, DistilledFeatures, EncodingConfig, Field, FieldConfig,
    FieldWeights, GBuffer, GBufferOptions, Ground, OccupancyGrids, PaintSpec, Parameters,
    RadianceField, RayBatch, Renderer, SamplingConfig, Shading, VolumeConfig, host, jitter,
};
use impasto_kernels::device::{is_cpu, tested};
use impasto_kernels::gpu::{DensityGrids, FieldSpec, Rays, SamplesRead, Targets, descend};
use impasto_kernels::{
    CompositeLayout, Density, DensityGrid, HashGridSpec, MlpSpec, OccupancySpec, RaySpan, Volume,
    VolumeSpec,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::sync::Arc;

/// The GPU that tests run on; `None`, said once, where that is the CPU.
#[allow(clippy::print_stderr, reason = "a test says why it is skipped")]
fn gpu() -> Option<Device> {
    let device = tested();
    if is_cpu(&device) {
        eprintln!("skipped: IMPASTO_DEVICE names no GPU");
        return None;
    }
    Some(device)
}

const SIDE: usize = 12;

fn hash_grid() -> HashGridSpec {
    HashGridSpec {
        levels: 4,
        features: 2,
        log2_entries: 9,
        coarsest: 4.0,
        finest: 24.0,
    }
}

/// Where samples lie in their parts.
const SEED: u64 = 11;
/// A sample counts, whatever is expected of it.
const ANY: f32 = -1.0;

fn config() -> FieldConfig {
    let volume = VolumeConfig {
        encoding: EncodingConfig::HashGrid(hash_grid()),
        base: vec![16, 8],
        geo: vec![],
        density: Density::Exp,
    };
    FieldConfig {
        inner: volume.clone(),
        outer: volume,
        latent: None,
        sampling: SamplingConfig::Occupancy(sampling()),
    }
}

fn sampling() -> OccupancySpec {
    OccupancySpec {
        samples: 24,
        uniform_fraction: 0.5,
        inner_step: 0.05,
        outer_steps: 32,
        inner_grid: SIDE,
        outer_grid: SIDE,
        near: 0.02,
    }
}

fn photo_app() -> AppearanceConfig {
    AppearanceConfig {
        app: AppConfig {
            hidden: vec![16],
            layer_norm: false,
            view_bands: Some(2),
            remap: false,
        },
        shading: Shading::Samples,
        latent: None,
    }
}

fn paint() -> PaintSpec {
    PaintSpec {
        distilled: DISTILLED,
    }
}

const DISTILLED: HashGridSpec = HashGridSpec {
    levels: 2,
    features: 2,
    log2_entries: 10,
    coarsest: 4.0,
    finest: 9.0,
};

/// Blobs in empty space.
fn grids() -> OccupancyGrids {
    let levels = |k: f32| {
        let level = move |cell: usize| {
            let wave = (cell as f32 * k).sin() + (cell as f32 * 0.013).cos();
            if wave > 0.4 { (wave * 120.0) as u8 } else { 0 }
        };
        DensityGrid::from_levels((0..SIDE.pow(3)).map(level).collect()).unwrap()
    };
    OccupancyGrids::new(levels(0.37), levels(0.73))
}

fn many_rays(count: usize) -> RayBatch {
    let mut rays = RayBatch::default();
    for i in 0..count {
        let at = |k: f32| (i as f32 * k).sin();
        let origin = [0.3 * at(0.7), 0.3 * at(1.3), -0.4];
        // As wide as a camera's: the finer paint is, the more of it a rounding error changes.
        rays.push_painted(origin, [0.4 * at(2.1), 0.4 * at(0.9), 1.0], 0.01);
    }
    rays
}

fn resident_rays(rays: &RayBatch, surface: impl Fn(usize) -> Option<f32>) -> Rays {
    let mut resident = Rays::default();
    for i in 0..rays.len() {
        let shift = jitter(Some(SEED), i);
        resident.push(rays.origins[i], rays.directions[i], shift, surface(i));
    }
    resident
}

#[test]
#[allow(clippy::too_many_lines, reason = "one comparison, number by number")]
fn marching_is_the_hosts() {
    let Some(device) = gpu() else { return };
    let (grids, rays) = (grids(), many_rays(300));
    let resident = DensityGrids::new([grids.inner(), grids.outer()], None, &device);
    let surface = |ray: usize| ray.is_multiple_of(3).then_some(0.25);
    let found = resident
        .march(&resident_rays(&rays, surface), &sampling(), ANY)
        .read();
    // With a seed nothing is left out; the host lays samples where that seed says.
    let wanted = Field::new(config()).sample(&rays, Some(&grids), Some(SEED));
    let n = wanted.len();
    assert_eq!(
        (n, found.points.len(), found.steps.len()),
        (300 * 24, 3 * n, 4 * n)
    );
    let mut other_counts = 0;
    let mut next = [0, wanted.inner.len()];
    let cubes = [&wanted.inner.cube[..], &wanted.outer.cube].concat();
    for (ray, (span, own)) in wanted
        .layout
        .rays
        .iter()
        .zip(found.spans.chunks(4))
        .enumerate()
    {
        let own: Vec<usize> = own.iter().map(|i| *i as usize).collect();
        let counts = [own[1] - own[0], own[3] - own[2]];
        assert_eq!(counts[0] + counts[1], 24, "ray {ray}");
        assert!(
            ray == 0 || own[0] == next[0],
            "inner samples follow each other"
        );
        next = [own[1], own[3]];
        // Rounding decides where half a sample belongs.
        if counts != [span.inner.len(), span.outer.len()] {
            other_counts += 1;
            continue;
        }
        let same = own[0]..own[1];
        for (i, j) in span
            .inner
            .clone()
            .zip(same)
            .chain(span.outer.clone().zip(own[2]..own[3]))
        {
            let near = |a: f32, b: f32| (a - b).abs() <= 2e-3 * a.abs().max(1.0);
            let layout = &wanted.layout;
            for axis in 0..3 {
                assert!(
                    near(cubes[3 * i + axis], found.points[3 * j + axis]),
                    "ray {ray}"
                );
            }
            for (k, steps) in [&layout.deltas, &layout.depths, &layout.distances]
                .into_iter()
                .enumerate()
            {
                assert!(
                    near(steps[i], found.steps[k * n + j]),
                    "ray {ray}: steps {k}"
                );
            }
            let off = surface(ray).map_or(0.0, |at| (layout.distances[i] - at).abs());
            assert!(
                near(off, found.steps[3 * n + j]),
                "ray {ray}: from its surface"
            );
        }
    }
    assert_eq!(next[1], n, "every sample has a ray");
    assert!(
        other_counts <= 6,
        "{other_counts} rays divide their samples otherwise"
    );
}

#[test]
fn poisoned_rays_take_no_inner_samples_there_either() {
    let Some(device) = gpu() else { return };
    let grids = grids();
    let resident = DensityGrids::new([grids.inner(), grids.outer()], None, &device);
    let mut rays = RayBatch::default();
    rays.push([f32::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]);
    rays.push([0.0, 0.0, 0.0], [f32::INFINITY, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let found = resident
        .march(&resident_rays(&rays, |_| None), &sampling(), ANY)
        .read();
    let inner: Vec<u32> = found.spans.chunks(4).map(|own| own[1] - own[0]).collect();
    assert_eq!(inner[..3], [0, 0, 0]);
    assert!(inner[3] > 0, "the ray beside them is as it was");
    let of_last = 3 * found.spans[12] as usize..3 * found.spans[13] as usize;
    assert!(found.points[of_last].iter().all(|x| x.is_finite()));
}

/// Networks of the field of [`config`] with [`photo_app`].
fn spec() -> FieldSpec {
    let field = config();
    let grid = field.inner.encoding.hash_grid().unwrap();
    let volume = |dimensions: usize| VolumeSpec {
        base: field.inner.trunk(dimensions, None).chain().clone(),
        geo: field.inner.geo_spec(),
        density: Density::Exp,
        app: photo_app().network(8).chain().clone(),
    };
    FieldSpec {
        grids: [grid, grid],
        volumes: [volume(3), volume(4)],
    }
}

/// Random weights of [`spec`].
fn weights(seed: u64, device: &Device) -> (FieldWeights, Appearance) {
    let field = Field::new(config());
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut weights = field.init(&mut rng, device);
    for table in [&mut weights.inner.encoding, &mut weights.outer.encoding] {
        let numbers = (0..table.dims()[0]).map(|_| rng.random_range(-1.0..1.0));
        *table = Tensor::from_data(&numbers.collect::<Vec<f32>>()[..], device);
    }
    let app = Appearance::init(photo_app(), field.features(), &mut rng, device);
    (weights, app)
}

fn volumes(weights: &FieldWeights, app: &Appearance) -> [Volume<Tensor<1>>; 2] {
    let volume = |branch: &impasto_field::BranchWeights, app: &Tensor<1>| Volume {
        encoded: branch.encoding.clone(),
        base: branch.base.clone(),
        geo: branch.geo.clone(),
        app: app.clone(),
    };
    [
        volume(&weights.inner, &app.inner),
        volume(&weights.outer, &app.outer),
    ]
}

/// The device's samples as the host's.
fn on_host(read: &SamplesRead, rays: &RayBatch, depths: usize) -> Samples {
    let n = read.points.len() / 3;
    let split = read.spans[2] as usize;
    let mut volumes = [VolumeSamples::default(), VolumeSamples::default()];
    for (v, range) in [0..split, split..n].into_iter().enumerate() {
        volumes[v].cube = read.points[3 * range.start..3 * range.end].to_vec();
    }
    let spans = read.spans.chunks(4).map(|own| RaySpan {
        inner: own[0] as usize..own[1] as usize,
        outer: own[2] as usize..own[3] as usize,
    });
    let rows = |k: usize| read.steps[k * n..(k + 1) * n].to_vec();
    let layout = CompositeLayout {
        rays: spans.collect(),
        deltas: rows(0),
        depths: rows(depths),
        distances: rows(2),
    };
    let [inner, outer] = volumes;
    Samples {
        inner,
        outer,
        layout: Arc::new(layout),
        views: rays.views(),
    }
}

/// Largest difference in units of the largest number.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let size = a.iter().fold(1e-12f32, |m, x| m.max(x.abs()));
    a.iter()
        .zip(b)
        .fold(0.0f32, |m, (a, b)| m.max((a - b).abs()))
        / size
}

#[test]
#[allow(clippy::too_many_lines, reason = "one comparison, number by number")]
fn a_descent_has_the_loss_and_the_gradients_of_the_hosts() {
    let Some(device) = gpu() else { return };
    let (grids, rays) = (grids(), many_rays(200));
    let resident = DensityGrids::new([grids.inner(), grids.outer()], None, &device);
    let surface = |ray: usize| ray.is_multiple_of(4).then_some(0.3);
    let samples = resident.march(&resident_rays(&rays, surface), &sampling(), ANY);
    let colours: Vec<f32> = (0..600).map(|i| (i as f32 * 0.7).sin().abs()).collect();
    let (depth, distortion) = (0.3, 0.05);

    let (own, app) = weights(3, &device);
    let views = impasto_field::encoding::frequencies_of(&samples.directions(), 2);
    let targets = Targets {
        views: Some(views),
        colours: colours.clone(),
        depth,
        distortion,
        learned_from: 0.6,
    };
    let found = descend(&spec(), &samples, &volumes(&own, &app), &targets);

    let cpu = Device::flex();
    let (own, app) = weights(3, &cpu);
    let level = RadianceField::new(own, app);
    let level = level.map(|_, tensor| Tensor::from_inner(tensor.clone()).require_grad());
    let wanted = LossWeights {
        surface: depth,
        learned_from: 0.6,
        distortion,
    };
    let all = on_host(&samples.read(), &rays, 3);
    let loss = Field::new(config()).loss(&level, &all, colours, wanted);
    let numbers = host(loss.clone().inner());
    let [total, error] = host(found.loss)[..] else {
        unreachable!("two numbers")
    };
    assert!(
        (total / numbers[0] - 1.0).abs() < 1e-4,
        "{total} {}",
        numbers[0]
    );
    assert!(
        (error / numbers[1] - 1.0).abs() < 1e-4,
        "{error} {}",
        numbers[1]
    );
    assert!(difference(&numbers[2..], &host(found.densities)) < 1e-4);
    let gradients = loss.slice_dim(0, 0..1).backward();
    for (v, (volume, found)) in volumes(&level.weights, &level.app)
        .into_iter()
        .zip(found.gradients)
        .enumerate()
    {
        for (i, (leaf, found)) in volume
            .into_array()
            .into_iter()
            .zip(found.into_array())
            .enumerate()
        {
            let wanted = host(leaf.grad(&gradients).unwrap());
            assert!(wanted.iter().any(|g| *g != 0.0));
            let off = difference(&wanted, &host(found));
            assert!(off < 1e-3, "volume {v}, parameter {i}: {off}");
        }
    }
}

#[test]
#[allow(clippy::too_many_lines, reason = "one story, step by step")]
fn grids_remember_what_samples_and_random_places_saw() {
    let Some(device) = gpu() else { return };
    let grids = grids();
    // The inner volume's lower half is never seen.
    let cells = SIDE.pow(3);
    let flags = [
        (0..cells)
            .map(|cell| cell >= cells / 2)
            .collect::<Vec<bool>>(),
        vec![true; cells],
    ];
    let resident = DensityGrids::new(
        [grids.inner(), grids.outer()],
        Some(flags.each_ref().map(Vec::as_slice)),
        &device,
    );
    let read = resident.read().map(Option::unwrap);
    for (read, wanted) in read.iter().zip([grids.inner(), grids.outer()]) {
        assert_eq!(read.levels(), wanted.levels());
        assert_eq!(read.opacities(), wanted.opacities());
    }
    // Layers of zeros: the density is one everywhere.
    let weights = spec().volumes.map(|volume| Volume {
        encoded: Tensor::zeros(
            [config().inner.encoding.hash_grid().unwrap().params()],
            &device,
        ),
        base: Tensor::zeros([volume.base.params()], &device),
        geo: Tensor::zeros([volume.geo.params()], &device),
        app: Tensor::zeros([1], &device),
    });
    let samples = resident.march(&resident_rays(&many_rays(300), |_| None), &sampling(), ANY);
    let points = samples.read();
    let densities: Tensor<1> = Tensor::ones([points.points.len() / 3], &device) * 7.0;
    for _ in 0..80 {
        resident.observe(&samples, &densities);
    }
    // No random places yet: what samples saw is all that changes.
    resident.update(&spec(), &weights, ([0.0, 0.0], [1.0; 2]), 1);
    let [inner, outer] = resident.read().map(Option::unwrap);
    let split = points.spans[2] as usize;
    let mut twins = [grids.inner().clone(), grids.outer().clone()];
    for _ in 0..80 {
        for (i, point) in points.points.as_chunks::<3>().0.iter().enumerate() {
            twins[usize::from(i >= split)].observe(*point, 7.0);
        }
    }
    twins.iter_mut().for_each(DensityGrid::settle);
    for (found, twin) in [&inner, &outer].into_iter().zip(&twins) {
        let pairs = found.observed().iter().zip(twin.observed());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-3));
        for (cell, (found, wanted)) in found.levels().iter().zip(twin.levels()).enumerate() {
            assert!(
                found.abs_diff(*wanted) <= 1,
                "{found} for {wanted} in cell {cell}"
            );
        }
    }
    for seed in 0..80 {
        resident.update(&spec(), &weights, ([1.0, 1.0], [1.0; 2]), seed);
    }
    let [after, far] = resident.read().map(Option::unwrap);
    let one = DensityGrid::level_of(1.0);
    for (cell, seen) in flags[0].iter().enumerate() {
        let (level, before) = (after.levels()[cell], inner.levels()[cell]);
        if *seen {
            assert!(level.abs_diff(one) <= 1, "{level} in cell {cell}");
        } else {
            assert_eq!(level, before, "cell {cell} is never looked at");
        }
    }
    // Only the shell of the outer cube holds outer points.
    assert_eq!(far.level([0.5; 3]), outer.level([0.5; 3]));
    assert!(far.level([0.5, 0.5, 0.1]).abs_diff(one) <= 1);
}

#[test]
fn densities_that_cannot_be_measured_are_not_skipped() {
    let Some(device) = gpu() else { return };
    let grids = grids();
    let resident = DensityGrids::new([grids.inner(), grids.outer()], None, &device);
    let samples = resident.march(&resident_rays(&many_rays(4), |_| None), &sampling(), ANY);
    let read = samples.read();
    let poison = vec![f32::NAN; read.points.len() / 3];
    for _ in 0..80 {
        resident.observe(&samples, &Tensor::from_data(&poison[..], &device));
    }
    let weights = volumes(&weights(1, &device).0, &weights(1, &device).1);
    resident.update(&spec(), &weights, ([0.0; 2], [1.0; 2]), 1);
    let [inner, _] = resident.read().map(Option::unwrap);
    let first = read.points.as_chunks::<3>().0[0];
    assert!(
        DensityGrid::density_of(inner.level(first)) > 50.0,
        "opaque, as far as it can be"
    );
}

#[test]
fn renders_and_patches_are_the_hosts() {
    let Some(device) = gpu() else { return };
    let (field, rays) = (Field::new(config()), many_rays(500));
    let mut settings = photo_app();
    settings.shading = Shading::Painted(paint());
    settings.app.layer_norm = true;
    let all = [device, Device::flex()].map(|device| {
        let (own, photo) = weights(5, &device);
        let style = Appearance::init(
            settings.clone(),
            field.features(),
            &mut Pcg64::seed_from_u64(8),
            &device,
        );
        let features = DistilledFeatures::init(DISTILLED, &mut Pcg64::seed_from_u64(9), &device);
        let ground = Ground {
            photo: photo.clone(),
            // Of a size that shows.
            features: Some(features.map(|_, own| own.clone() * 1e3)),
        };
        let renderer = Renderer::open(field.clone(), own, Some(grids()), ground, &settings);
        let rendered = renderer.render(&rays, &[&photo, &style, &style]);
        let options = GBufferOptions {
            config: &settings,
            photo: Some(&photo),
            seed: Some(7),
            least_weight: 0.0,
            rays_at_once: Some(200),
        };
        let buffers = renderer.gbuffer(&rays, &options);
        assert_eq!(buffers.fine().iter().map(GBuffer::rays).sum::<usize>(), 500);
        let photo = host(buffers.photo.clone().unwrap().slice_dim(1, 0..3));
        (rendered, buffers.shade(&style), photo)
    });
    let [
        (found, painted, photo),
        (wanted, wanted_painted, wanted_photo),
    ] = all;
    let alike = |a: &[f32], b: &[f32], what: &str| {
        assert_eq!(a.len(), b.len());
        let far = a
            .iter()
            .zip(b)
            .filter(|(a, b)| (*a - *b).abs() > 2.0 / 255.0)
            .count();
        // Rounding decides where a few samples are.
        assert!(
            far * 100 <= a.len(),
            "{what}: {far} of {} numbers differ",
            a.len()
        );
    };
    for (found, wanted) in found.colours.iter().zip(&wanted.colours) {
        alike(found, wanted, "a render");
    }
    assert_eq!(found.colours[1], found.colours[2]);
    let near = |(a, b): &(&f32, &f32)| (**a - **b).abs() > 0.01 * b.abs().max(0.1);
    let far = found.depth.iter().zip(&wanted.depth).filter(near).count();
    assert!(far <= 10, "{far} of 500 depths differ");
    // Seeds go through other groups of rays: the same light, not the same samples.
    let mean = |rows: &[f32]| rows.iter().sum::<f32>() / 1500.0;
    for (found, wanted) in [(&painted, &wanted_painted), (&photo, &wanted_photo)] {
        assert!((mean(found) - mean(wanted)).abs() < 0.01);
    }
}

#[test]
fn fields_that_cannot_stay_there_say_so() {
    let Some(device) = gpu() else { return };
    let field = Field::new(config());
    let batch = BatchSize {
        samples: 2400,
        rays: [10, 10_000],
        rays_at_once: 1000,
    };
    let training = |field: &Field, app: &AppearanceConfig, device: &Device| {
        let training = FieldTraining::new(field.clone(), app, |_| true, batch, device);
        !training.on_host()
    };
    assert!(training(&field, &photo_app(), &device));
    assert!(!training(&field, &photo_app(), &Device::flex()));
    let mut remapped = photo_app();
    remapped.app.remap = true;
    assert!(!training(&field, &remapped, &device));
    let shifted = AppearanceConfig {
        latent: Some(4),
        ..photo_app()
    };
    assert!(!training(&field, &shifted, &device));
    let painted = AppearanceConfig {
        shading: Shading::Painted(paint()),
        ..photo_app()
    };
    assert!(!training(&field, &painted, &device));
    let mut frequencies = config();
    frequencies.inner.encoding = EncodingConfig::Frequency { bands: 4 };
    let frequencies = Field::new(frequencies);
    assert!(!training(&frequencies, &photo_app(), &device));
    let wide = MlpSpec::relu(&[8, 1024, 3], false, impasto_kernels::Activation::Sigmoid);
    let mut spec = spec();
    spec.volumes[0].app = wide;
    assert!(!spec.fits());
}
