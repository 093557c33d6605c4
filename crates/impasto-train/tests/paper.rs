//! The paper's networks against stored numbers of an independent implementation (float32): values
//! to 1e-5, gradients to 1e-4.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use burn::tensor::{Gradients, Tensor, TensorData};
use impasto_field::encoding::matrix;
use impasto_field::sampling::{Samples, VolumeSamples};
use impasto_field::sphere::outer_point;
use impasto_field::{
    AppConfig, Appearance, AppearanceConfig, BranchWeights, EncodingConfig, Field, FieldConfig,
    FieldWeights, HierarchicalConfig, RayBatch, SamplingConfig, Shading, Trunk, VolumeConfig, host,
};
use impasto_kernels::device::tested;
use impasto_kernels::{Activation, CompositeLayout, Density, LayerSpec, MlpSpec, RaySpan, ops};
use impasto_style::{Hypernetwork, HypernetworkWeights};
use safetensors::SafeTensors;
use std::sync::Arc;

/// Relative agreement of gradients.
const GRADIENTS: f64 = 1e-4;
/// In the whole render all colours of a ray are nearly alike, so that little depends on densities:
/// of their gradients (norm 0.003) rounding leaves 3 digits. Central differences in double
/// precision lie 6e-4 (inner) and 2e-4 (outer) from the stored ones.
const FAINT: f64 = 1e-3;
const WIDTH: usize = 24;
const LATENT: usize = 64;
const CODE: usize = 32;
const TRUNK: [&str; 7] = [
    "linear0.0",
    "linear1.0",
    "linear2.0",
    "linear3.0",
    "linear4.0",
    "z_linear1",
    "z_linear2",
];
const GEO: [&str; 2] = ["sigma_layer0.0", "sigma_layer1"];
const APP: [&str; 6] = [
    "base_remap_layers",
    "rgb_layer0.0",
    "rgb_layer1.0",
    "rgb_layer2.0",
    "rgb_layer3",
    "z_linear3",
];
const HYPER: [&str; 5] = [
    "hyper_rgb.layers.0",
    "hyper_rgb.layers.1.hyper_linear",
    "hyper_rgb.layers.2.hyper_linear",
    "hyper_rgb.layers.3.hyper_linear",
    "hyper_rgb.layers.4",
];

fn device() -> burn::tensor::Device {
    tested().autodiff()
}

fn leaf(numbers: Vec<f32>) -> Tensor<1> {
    let length = numbers.len();
    Tensor::from_data(TensorData::new(numbers, [length]), &device()).require_grad()
}

struct Golden(Vec<u8>);

impl Golden {
    fn new(path: &str) -> Self {
        let path = format!("{}/{path}.safetensors", env!("CARGO_MANIFEST_DIR"));
        Self(std::fs::read(path).unwrap())
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap();
        let (numbers, _) = tensor.data().as_chunks::<4>();
        numbers.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    /// Weight and bias of layers, one after the other.
    fn flat(&self, prefix: &str, layers: &[&str]) -> Vec<f32> {
        let parts = layers
            .iter()
            .flat_map(|layer| ["weight", "bias"].map(|part| (layer, part)));
        parts
            .flat_map(|(layer, part)| self.floats(&format!("{prefix}{layer}.{part}")))
            .collect()
    }

    fn check(&self, name: &str, found: &[f32]) {
        close(name, found, &self.floats(name), 1e-5);
    }

    /// Compares the gradient of a leaf that was made by [`Self::flat`].
    fn check_gradient(
        &self,
        (branch, layers): (&str, &[&str]),
        (leaf, gradients): (&Tensor<1>, &Gradients),
        tolerance: f64,
    ) {
        let wanted = self.flat(&format!("grad.{branch}"), layers);
        let found = host(leaf.grad(gradients).unwrap());
        close(layers[0], &found, &wanted, tolerance);
    }
}

fn close(what: &str, found: &[f32], wanted: &[f32], tolerance: f64) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let square = |v: f32| f64::from(v).powi(2);
    let error: f64 = found.iter().zip(wanted).map(|(a, b)| square(a - b)).sum();
    let error = (error / wanted.iter().map(|b| square(*b)).sum::<f64>()).sqrt();
    assert!(error < tolerance, "{what}: {error:e}");
}

fn linspace(from: f32, to: f32, count: usize) -> Vec<f32> {
    let step = (to - from) / (count - 1) as f32;
    (0..count).map(|i| from + step * i as f32).collect()
}

fn weighted<const D: usize>(tensor: Tensor<D>, weights: Vec<f32>) -> Tensor<1> {
    let weights = Tensor::<D>::from_data(TensorData::new(weights, tensor.dims()), &device());
    (tensor * weights).sum()
}

/// The paper's `app`, 24 wide: learned for photos, or predicted.
fn app(predicted: bool) -> AppearanceConfig {
    AppearanceConfig {
        app: AppConfig {
            hidden: vec![WIDTH, WIDTH, WIDTH / 2],
            layer_norm: predicted,
            view_bands: Some(4),
            remap: true,
        },
        shading: Shading::Samples,
        latent: (!predicted).then_some(LATENT),
    }
}

fn geo() -> MlpSpec {
    MlpSpec::relu(&[WIDTH, WIDTH / 2, 1], false, Activation::Linear)
}

/// Hypernetworks with stored weights, and the names of each one's layers.
fn hypernetwork(golden: &Golden, branch: &str) -> (Hypernetwork, HypernetworkWeights) {
    let app = app(true).network(WIDTH);
    let weights = HYPER.map(|layer| {
        leaf(golden.flat(
            &format!("param.{branch}"),
            &hyper(layer).each_ref().map(String::as_str),
        ))
    });
    (
        Hypernetwork::new(CODE, 16, app.layers(), 5),
        HypernetworkWeights(weights.into()),
    )
}

fn hyper(layer: &str) -> [String; 3] {
    ["0.net.0", "1.net.0", "2"].map(|part| format!("{layer}.hypo_params.net.{part}"))
}

#[test]
fn a_branch_of_the_geometry_stage_agrees() {
    let golden = Golden::new("tests/golden/mlp_geometry_stage");
    let trunk = Trunk::residual(63, WIDTH, 2, LATENT);
    let app = app(false).network(WIDTH);
    let [base, geo_weights, app_weights] =
        [&TRUNK[..], &GEO, &APP].map(|layers| leaf(golden.flat("param.", layers)));
    assert_eq!(base.dims()[0], trunk.params());
    assert_eq!(app_weights.dims()[0], app.params());
    let latent = leaf(golden.floats("latent"));
    let position = matrix(golden.floats("position"), 63, &device());
    let view = matrix(golden.floats("view"), 27, &device());
    let features = trunk.forward(position, &base, Some(&latent));
    let sigma = ops::mlp(features.clone(), geo_weights.clone(), &geo()).abs();
    let folded = app.folded(&app_weights, Some(&latent));
    let rgb = app.forward(vec![features, view], folded, None);
    golden.check("sigma", &host(sigma.clone()));
    golden.check("rgb", &host(rgb.clone()));
    let loss = weighted(rgb, linspace(0.1, 1.0, 36)) + weighted(sigma, linspace(-1.0, 1.0, 12));
    let gradients = loss.backward();
    golden.check_gradient(("", &TRUNK), (&base, &gradients), GRADIENTS);
    golden.check_gradient(("", &GEO), (&geo_weights, &gradients), GRADIENTS);
    golden.check_gradient(("", &APP), (&app_weights, &gradients), GRADIENTS);
}

#[test]
fn a_branch_of_the_stylization_stage_agrees() {
    let golden = Golden::new("tests/golden/mlp_stylization_stage");
    let trunk = Trunk::residual(63, WIDTH, 2, LATENT);
    let app = app(true).network(WIDTH);
    let base = leaf(golden.flat("param.", &TRUNK));
    let latent = leaf(golden.floats("latent"));
    let style = leaf(golden.floats("style"));
    let (hypernetwork, hyper_weights) = hypernetwork(&golden, "");
    let predicted = hypernetwork.predict(&hyper_weights, &style.clone().unsqueeze());
    let layers: Vec<String> = (0..5).map(|i| format!("predicted.{i}")).collect();
    let layers: Vec<&str> = layers.iter().map(String::as_str).collect();
    close(
        "predicted",
        &host(predicted.clone()),
        &golden.flat("", &layers),
        1e-5,
    );
    let features = trunk.forward(
        matrix(golden.floats("position"), 63, &device()),
        &base,
        Some(&latent),
    );
    let view = matrix(golden.floats("view"), 27, &device());
    let rgb = app.forward(vec![features, view], app.folded(&predicted, None), None);
    golden.check("rgb", &host(rgb.clone()));
    let gradients = weighted(rgb, linspace(0.1, 1.0, 36)).backward();
    golden.check_gradient(("", &TRUNK), (&base, &gradients), GRADIENTS);
    for (layer, weights) in HYPER.iter().zip(&hyper_weights.0) {
        golden.check_gradient(
            ("", &hyper(layer).each_ref().map(String::as_str)),
            (weights, &gradients),
            GRADIENTS,
        );
    }
    close(
        "style",
        &host(style.grad(&gradients).unwrap()),
        &golden.floats("grad.style"),
        1e-4,
    );
}

/// A field of the paper's shape whose encodings are exact.
fn field() -> Field {
    let volume = VolumeConfig {
        encoding: EncodingConfig::Frequency { bands: 10 },
        base: vec![WIDTH; 5],
        geo: vec![WIDTH / 2],
        density: Density::Abs,
    };
    Field::new(FieldConfig {
        inner: volume.clone(),
        outer: volume,
        latent: Some(LATENT),
        sampling: SamplingConfig::Hierarchical(HierarchicalConfig {
            first: 16,
            more: 16,
            near: 0.0,
        }),
    })
}

/// Both volumes' weights from a file's parameters.
fn field_weights(golden: &Golden) -> FieldWeights {
    let latent = leaf(golden.floats("latent"));
    let branch = |name: &str| {
        let prefix = format!("param.{name}");
        BranchWeights {
            encoding: leaf(vec![0.0]),
            base: leaf(golden.flat(&prefix, &TRUNK)),
            geo: leaf(golden.flat(&prefix, &GEO)),
        }
    };
    FieldWeights {
        latent: Some(latent),
        inner: branch("fg_net."),
        outer: branch("bg_net."),
        coarse: None,
    }
}

/// A file's rays with its 16 depths and 16 inverse radii each.
fn samples(golden: &Golden) -> Samples {
    let rows = |name: &str| golden.floats(name).as_chunks::<3>().0.to_vec();
    let (origins, directions) = (rows("origin"), rows("direction"));
    let rays = origins.len();
    let near = golden.floats("foreground_depths");
    let far = golden.floats("foreground_far");
    let inverse = golden.floats("background_inverse_radii");
    let each = near.len() / rays;
    let (mut inner, mut outer) = (VolumeSamples::default(), VolumeSamples::default());
    let mut steps: [[Vec<f32>; 2]; 2] = Default::default();
    let mut layout = CompositeLayout::default();
    for ray in 0..rays {
        let (o, d) = (origins[ray], directions[ray]);
        let length = d.iter().map(|c| c * c).sum::<f32>().sqrt();
        let own = ray * each..(ray + 1) * each;
        let mut edges = near[own.clone()].to_vec();
        edges.push(far[ray]);
        // Near to far is descending in inverse radius.
        let radii: Vec<f32> = inverse[own.clone()].iter().rev().copied().collect();
        for (i, t) in edges[..each].iter().enumerate() {
            inner.raw.extend([0, 1, 2].map(|a| o[a] + t * d[a]));
            inner.cube.extend([0.0; 3]);
            steps[0][0].push((edges[i + 1] - t) * length);
            steps[0][1].push(*t);
        }
        for (i, s) in radii.iter().enumerate() {
            let (point, depth) = outer_point(o, d, *s);
            outer.raw.extend(point);
            outer.cube.extend([0.0; 3]);
            steps[1][0].push(radii.get(i + 1).map_or(1e10, |next| s - next));
            steps[1][1].push(depth);
        }
        layout.rays.push(RaySpan {
            inner: own.clone(),
            outer: rays * each + own.start..rays * each + own.end,
        });
    }
    layout.deltas = [&steps[0][0][..], &steps[1][0]].concat();
    layout.depths = [&steps[0][1][..], &steps[1][1]].concat();
    layout.distances = vec![0.0; layout.deltas.len()];
    Samples {
        inner,
        outer,
        layout: Arc::new(layout),
        views: RayBatch {
            touches: vec![0.0; origins.len()],
            origins,
            directions,
        }
        .views(),
    }
}

fn colours(field: &Field, golden: &Golden, weights: &FieldWeights, app: &Appearance) -> Tensor<2> {
    let values = field.evaluate(weights, samples(golden));
    values.gbuffer(&app.config).shade(app).slice_dim(1, 0..3)
}

#[test]
fn a_render_of_the_geometry_stage_agrees() {
    let golden = Golden::new("../impasto-kernels/tests/golden/render_geometry_stage");
    let (field, weights) = (field(), field_weights(&golden));
    let app = Appearance {
        config: app(false),
        inner: leaf(golden.flat("param.fg_net.", &APP)),
        outer: leaf(golden.flat("param.bg_net.", &APP)),
        paint: None,
        latent: weights.latent.clone(),
    };
    let rgb = colours(&field, &golden, &weights, &app);
    golden.check("out.rgb", &host(rgb.clone()));
    let gradients = weighted(rgb, linspace(0.1, 1.0, 60)).backward();
    let volumes = [
        ("fg_net.", &weights.inner, &app.inner),
        ("bg_net.", &weights.outer, &app.outer),
    ];
    for (name, branch, app) in volumes {
        golden.check_gradient((name, &TRUNK), (&branch.base, &gradients), GRADIENTS);
        golden.check_gradient((name, &GEO), (&branch.geo, &gradients), FAINT);
        golden.check_gradient((name, &APP), (app, &gradients), GRADIENTS);
    }
}

#[test]
fn a_render_of_the_stylization_stage_agrees() {
    let golden = Golden::new("tests/golden/render_stylization_stage");
    let (field, weights) = (field(), field_weights(&golden));
    let code = leaf(golden.floats("style")).unsqueeze();
    let branches = ["fg_net.", "bg_net."].map(|name| (name, hypernetwork(&golden, name)));
    let [inner, outer] = branches
        .each_ref()
        .map(|(_, (net, weights))| net.predict(weights, &code));
    let app = Appearance {
        config: app(true),
        inner,
        outer,
        paint: None,
        latent: None,
    };
    let rgb = colours(&field, &golden, &weights, &app);
    golden.check("out.rgb", &host(rgb.clone()));
    let gradients = weighted(rgb, linspace(0.1, 1.0, 60)).backward();
    for (name, (_, weights)) in &branches {
        for (layer, weights) in HYPER.iter().zip(&weights.0) {
            let layers = hyper(layer);
            let layers = layers.each_ref().map(String::as_str);
            golden.check_gradient((name, &layers), (weights, &gradients), GRADIENTS);
        }
    }
}

#[test]
fn numbers_of_parameters_are_the_papers() {
    let trunks = [63, 84].map(|inputs| Trunk::residual(inputs, 128, 2, 64).params());
    let geo = MlpSpec::relu(&[128, 64, 1], false, Activation::Linear).params();
    let app = |predicted: bool| {
        let mut config = app(predicted);
        config.app.hidden = vec![128, 128, 64];
        config.network(128)
    };
    let level = trunks.iter().sum::<usize>() + 2 * (geo + app(false).params()) + 64;
    assert_eq!(level, 340_680);
    let predicted: usize = app(true).layers().map(LayerSpec::params).sum();
    assert_eq!(predicted, 61_443);
    let hypernetwork = Hypernetwork::new(512, 64, app(true).layers(), 5);
    assert_eq!(hypernetwork.lengths().iter().sum::<usize>(), 4_178_755);
}
