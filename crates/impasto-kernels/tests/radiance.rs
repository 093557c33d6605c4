//! The radiance loss: twin, gradients, poisoned samples, packing, determinism.

mod common;

use common::on::radiance;
use common::*;
use impasto_kernels::{
    Activation, CompositeLayout, Density, LayerSpec, MlpSpec, RadianceSpec, RaySpan, Volume,
    VolumeSpec, ops,
};
use std::sync::Arc;

const WIDTH: usize = 5;
const FEATURES: usize = 4;

fn spec(rays: usize, density: Density, view: usize) -> RadianceSpec {
    let base = |widths: &[usize]| MlpSpec::relu(widths, false, Activation::Relu);
    let bases = [
        base(&[WIDTH, 8, FEATURES]),
        base(&[WIDTH, FEATURES, 6, FEATURES, FEATURES]).with_blocks(vec![1..3, 3..4]),
    ];
    let volume = |base: &MlpSpec, hidden: &[usize]| VolumeSpec {
        base: base.clone(),
        geo: MlpSpec::relu(&[FEATURES, 1], false, Activation::Linear),
        density,
        app: MlpSpec::relu(
            &[&[FEATURES + view], hidden, &[3]].concat(),
            false,
            Activation::Sigmoid,
        ),
    };
    let spans = spans(rays);
    let total = spans.last().map_or(0, |span| span.outer.end);
    let mut distances = vec![0.0; total];
    for span in &spans {
        for (rank, i) in span.inner.clone().chain(span.outer.clone()).enumerate() {
            distances[i] = rank as f32 / 11.0;
        }
    }
    RadianceSpec {
        volumes: [volume(&bases[0], &[8]), volume(&bases[1], &[6, 6])],
        layout: Arc::new(CompositeLayout {
            rays: spans,
            deltas: numbers(1, total, 0.05..0.6),
            depths: numbers(2, total, 0.0..3.0),
            distances,
        }),
        views: numbers(3, rays * view, -1.0..1.0),
        targets: numbers(4, rays * 3, 0.0..1.0),
        depth: 0.3,
        distortion: 0.2,
        learned_from: 0.0,
    }
}

/// Inner and outer encodings and parameters.
fn inputs(spec: &RadianceSpec, seed: u64) -> [Volume<Vec<f32>>; 2] {
    let rays = &spec.layout.rays;
    let inner: usize = rays.iter().map(|r| r.inner.len()).sum();
    let counts = [inner, spec.layout.deltas.len() - inner];
    [0, 1].map(|v| {
        let (volume, seed) = (&spec.volumes[v], seed + 10 * v as u64);
        Volume {
            encoded: numbers(seed, counts[v] * WIDTH, -1.0..1.0),
            base: numbers(seed + 1, volume.base.params(), -0.8..0.8),
            geo: numbers(seed + 2, volume.geo.params(), -0.8..0.8),
            app: numbers(seed + 3, volume.app.params(), -0.8..0.8),
        }
    })
}

fn slices(volumes: &[Volume<Vec<f32>>; 2]) -> [Volume<&[f32]>; 2] {
    volumes.each_ref().map(|v| Volume {
        encoded: &*v.encoded,
        base: &v.base,
        geo: &v.geo,
        app: &v.app,
    })
}

/// One row through layers, and how near a relu came to its kink.
fn layers(mlp: &MlpSpec, params: &[f64], row: &[f64], margin: &mut f64) -> Vec<f64> {
    let (mut current, mut offset) = (row.to_vec(), 0);
    let mut shift = mlp.layers().iter().map(LayerSpec::params).sum::<usize>();
    let mut entry = Vec::new();
    for (i, layer) in mlp.layers().iter().enumerate() {
        if mlp.blocks().iter().any(|block| block.start == i) {
            let shifts = &params[shift..shift + current.len()];
            current.iter_mut().zip(shifts).for_each(|(x, s)| *x += s);
            shift += current.len();
            entry.clone_from(&current);
        }
        let (weight, bias) =
            params[offset..offset + layer.params()].split_at(layer.inputs * layer.outputs);
        offset += layer.params();
        let next = weight.chunks(layer.inputs).zip(bias).map(|(row, bias)| {
            let sum: f64 = row.iter().zip(&current).map(|(w, x)| w * x).sum();
            match layer.activation {
                Activation::Linear => sum + bias,
                Activation::Relu => {
                    *margin = margin.min((sum + bias).abs());
                    (sum + bias).max(0.0)
                }
                Activation::Sigmoid => 1.0 / (1.0 + (-sum - bias).exp()),
            }
        });
        current = next.collect();
        if mlp.blocks().iter().any(|block| block.end == i + 1) {
            current.iter_mut().zip(&entry).for_each(|(x, e)| *x += e);
        }
    }
    current
}

struct Evaluated {
    loss: f64,
    error: f64,
    densities: Vec<f64>,
    margin: f64,
}

fn twin(spec: &RadianceSpec, volumes: &[Volume<Vec<f64>>; 2]) -> Evaluated {
    let layout = &spec.layout;
    let rays = layout.rays.len();
    let view = spec.views.len() / rays;
    let split = volumes[0].encoded.len() / WIDTH;
    let mut out = Evaluated {
        loss: 0.0,
        error: 0.0,
        densities: vec![0.0; layout.deltas.len()],
        margin: f64::MAX,
    };
    for (ray, span) in layout.rays.iter().enumerate() {
        let mut transmittance = 1.0;
        let mut colour = [0.0; 3];
        let mut marched: Vec<(f64, f64)> = Vec::new();
        for i in span.inner.clone().chain(span.outer.clone()) {
            let v = usize::from(i >= split);
            let (shape, volume) = (&spec.volumes[v], &volumes[v]);
            let row = &volume.encoded[(i - v * split) * WIDTH..][..WIDTH];
            let features = layers(&shape.base, &volume.base, row, &mut out.margin);
            let raw = layers(&shape.geo, &volume.geo, &features, &mut out.margin)[0];
            let density = match shape.density {
                Density::Exp => raw.clamp(-15.0, 15.0).exp(),
                Density::Abs => {
                    out.margin = out.margin.min(raw.abs());
                    raw.abs()
                }
            };
            let mut input = features;
            input.extend(wide(&spec.views[ray * view..][..view]));
            let shade = layers(&shape.app, &volume.app, &input, &mut out.margin);
            let passed = (-density * f64::from(layout.deltas[i])).exp();
            let weight = transmittance * (1.0 - passed);
            transmittance *= passed + 1e-6;
            (0..3).for_each(|c| colour[c] += weight * shade[c]);
            out.loss += f64::from(spec.depth) * weight * f64::from(layout.depths[i]);
            marched.push((weight, f64::from(layout.distances[i])));
            out.densities[i] = density;
        }
        for (a, s) in &marched {
            let spread = marched.iter().map(|(b, t)| a * b * (s - t).abs());
            out.loss += f64::from(spec.distortion) * spread.sum::<f64>();
        }
        for (c, colour) in colour.iter().enumerate() {
            out.error += (colour - f64::from(spec.targets[ray * 3 + c])).powi(2) / 3.0;
        }
    }
    out.error /= rays as f64;
    out.loss = out.loss / rays as f64 + out.error;
    out
}

fn in_double(volumes: &[Volume<Vec<f32>>; 2]) -> [Volume<Vec<f64>>; 2] {
    volumes.clone().map(|v| v.map(|data| wide(&data)))
}

fn variants() -> impl Iterator<Item = (Density, usize)> {
    [Density::Exp, Density::Abs]
        .into_iter()
        .flat_map(|density| [0, 3].map(|view| (density, view)))
}

#[test]
fn equals_its_twin_whatever_the_number_of_rays() {
    for (density, view) in variants() {
        for rays in [1, 8, 9, 150, 1000] {
            let spec = spec(rays, density, view);
            let volumes = inputs(&spec, 30);
            let found = radiance::loss(&spec, &slices(&volumes));
            let wanted = twin(&spec, &in_double(&volumes));
            let what = format!("{density:?}, {view} numbers of view, {rays} rays");
            let numbers = [found.loss, found.error];
            assert_close(&what, &numbers, &[wanted.loss, wanted.error], 1e-5);
            assert_close(&what, &found.densities, &wanted.densities, 1e-5);
        }
    }
}

/// One of the eight vectors.
fn part<T>(volumes: &mut [Volume<T>; 2], i: usize) -> &mut T {
    let volume = &mut volumes[i / 4];
    match i % 4 {
        0 => &mut volume.encoded,
        1 => &mut volume.base,
        2 => &mut volume.geo,
        _ => &mut volume.app,
    }
}

#[test]
fn gradients_equal_the_twins_differences() {
    for (density, view) in variants() {
        let spec = spec(12, density, view);
        let mut volumes = (0..1000)
            .map(|seed| inputs(&spec, 100 * seed))
            .find(|v| twin(&spec, &in_double(v)).margin > 2e-5)
            .expect("one of a thousand seeds stays off the kinks");
        let mut grads = radiance::loss(&spec, &slices(&volumes)).grads;
        for i in 0..8 {
            let wide = in_double(&volumes);
            let wanted = differences(part(&mut volumes, i), |x| {
                let mut wide = wide.clone();
                part(&mut wide, i).copy_from_slice(x);
                twin(&spec, &wide).loss
            });
            let what = format!("{density:?}, {view} numbers of view, input {i}");
            assert_close(&what, part(&mut grads, i), &wanted, 1e-4);
        }
    }
}

#[test]
fn gradients_of_many_rays_are_those_of_each() {
    // Several tiles in each of several pieces.
    let all = spec(400, Density::Exp, 3);
    let volumes = inputs(&all, 40);
    let split = volumes[0].encoded.len() / WIDTH;
    let found = radiance::loss(&all, &slices(&volumes));
    for ray in [0, 27, 48, 49, 50, 171, 399] {
        let span = &all.layout.rays[ray];
        let rows = [
            span.inner.clone(),
            span.outer.start - split..span.outer.end - split,
        ];
        let pick = |data: &[f32]| [&data[span.inner.clone()], &data[span.outer.clone()]].concat();
        let inner = span.inner.len();
        let one = RadianceSpec {
            volumes: all.volumes.clone(),
            layout: Arc::new(CompositeLayout {
                rays: vec![RaySpan {
                    inner: 0..inner,
                    outer: inner..inner + span.outer.len(),
                }],
                deltas: pick(&all.layout.deltas),
                depths: pick(&all.layout.depths),
                distances: pick(&all.layout.distances),
            }),
            views: all.views[3 * ray..3 * ray + 3].to_vec(),
            targets: all.targets[3 * ray..3 * ray + 3].to_vec(),
            ..all
        };
        let mut own = volumes.clone();
        for (own, rows) in own.iter_mut().zip(&rows) {
            own.encoded = own.encoded[rows.start * WIDTH..rows.end * WIDTH].to_vec();
        }
        let alone = radiance::loss(&one, &slices(&own));
        let densities = wide(&pick(&found.densities));
        assert_close("densities", &alone.densities, &densities, 1e-5);
        for (v, rows) in rows.iter().enumerate() {
            let among = &found.grads[v].encoded[rows.start * WIDTH..rows.end * WIDTH];
            let wanted = alone.grads[v].encoded.iter().map(|g| f64::from(*g) / 400.0);
            let wanted: Vec<f64> = wanted.collect();
            if wanted.iter().any(|g| *g != 0.0) {
                assert_close(&format!("ray {ray}, volume {v}"), among, &wanted, 1e-4);
            }
        }
    }
}

#[test]
fn samples_near_the_camera_learn_less() {
    // Layers are linear on the way back: a sample's share is that of its encoding's gradient.
    let mut near = spec(40, Density::Exp, 3);
    let volumes = inputs(&near, 7);
    let whole = radiance::loss(&near, &slices(&volumes));
    near.learned_from = 0.7;
    let found = radiance::loss(&near, &slices(&volumes));
    assert_same(
        "loss",
        &[found.loss, found.error],
        &[whole.loss, whole.error],
    );
    let split = volumes[0].encoded.len() / WIDTH;
    let mut shares = [0, 0];
    for v in 0..2 {
        let rows = found.grads[v].encoded.chunks(WIDTH);
        for (i, (row, all)) in rows.zip(whole.grads[v].encoded.chunks(WIDTH)).enumerate() {
            let s = f64::from(near.layout.distances[i + v * split]);
            let distance = s / (1.0 - s);
            let share = (distance / 0.7).powi(2).min(1.0);
            shares[usize::from(share < 1.0)] += 1;
            let wanted: Vec<f64> = all.iter().map(|g| f64::from(*g) * share).collect();
            if wanted.iter().any(|g| *g != 0.0) {
                assert_close(&format!("volume {v}, sample {i}"), row, &wanted, 1e-4);
            } else {
                assert!(row.iter().all(|g| *g == 0.0));
            }
        }
    }
    assert!(shares.iter().all(|count| *count > 20), "{shares:?}");
}

#[test]
fn operation_has_the_gradients_times_its_factor() {
    let spec = Arc::new(spec(20, Density::Exp, 3));
    let volumes = inputs(&spec, 5);
    let found = radiance::loss(&spec, &slices(&volumes));
    let leaves = volumes.map(|v| v.map(|data| leaf(&data, [data.len()])));
    for factor in [1.0, -3.0] {
        let out = ops::radiance_loss(leaves.clone(), Arc::clone(&spec));
        let numbers = values(out.clone().inner());
        assert_same("loss", &numbers[..2], &[found.loss, found.error]);
        assert_same("densities", &numbers[2..], &found.densities);
        let gradients = (out.slice_dim(0, 0..1) * factor).backward();
        let mut taken = leaves
            .clone()
            .map(|v| v.map(|leaf| gradient(&leaf, &gradients)));
        let mut grads = found.grads.clone();
        for i in 0..8 {
            let wanted: Vec<f32> = part(&mut grads, i).iter().map(|g| g * factor).collect();
            assert_same(&format!("input {i}"), part(&mut taken, i), &wanted);
        }
    }
}

#[test]
fn a_poisoned_sample_spoils_its_own_ray_only() {
    let spec = spec(40, Density::Exp, 3);
    let mut volumes = inputs(&spec, 8);
    let ray = 20;
    let poisoned = spec.layout.rays[ray].inner.start;
    volumes[0].encoded[poisoned * WIDTH] = f32::NAN;
    let found = radiance::loss(&spec, &slices(&volumes));
    assert!(found.loss.is_nan(), "it does not go unnoticed");
    for (other, span) in spec.layout.rays.iter().enumerate() {
        let rows = span.inner.start * WIDTH..span.inner.end * WIDTH;
        let spoilt = found.grads[0].encoded[rows].iter().any(|g| !g.is_finite());
        assert_eq!(spoilt, other == ray, "ray {other}");
    }
}

#[test]
#[should_panic(expected = "packed ray by ray")]
fn refuses_samples_with_gaps() {
    let mut spec = spec(9, Density::Exp, 0);
    Arc::make_mut(&mut spec.layout).rays.swap(2, 5);
    let volumes = inputs(&spec, 1);
    radiance::loss(&spec, &slices(&volumes));
}

#[test]
fn does_not_depend_on_threads() {
    let spec = spec(400, Density::Exp, 3);
    let volumes = inputs(&spec, 2);
    assert_deterministic("loss and gradients", || {
        let found = radiance::loss(&spec, &slices(&volumes));
        let grads = found.grads.into_iter();
        let grads = grads.flat_map(|v| [v.encoded, v.base, v.geo, v.app].concat());
        [found.loss, found.error].into_iter().chain(grads).collect()
    });
}
