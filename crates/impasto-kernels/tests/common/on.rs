//! The kernels on the device under test, by numbers: what [`impasto_kernels::cpu`] says of slices,
//! through the operations.

use super::{backward as gradients, gradient, leaf, tensor, values};
use impasto_kernels::ops;
use std::sync::Arc;

pub mod hash_grid {
    use super::*;
    use impasto_kernels::HashGridSpec;

    pub fn forward(spec: &HashGridSpec, points: &[f32], table: &[f32]) -> Vec<f32> {
        let (points, table) = (
            tensor(points, [points.len() / 3, 3]),
            tensor(table, [table.len()]),
        );
        values(ops::hash_encode(points, table, *spec))
    }

    pub fn backward(spec: &HashGridSpec, points: &[f32], grad: &[f32]) -> Vec<f32> {
        let table = leaf(&vec![0.0; spec.params()], [spec.params()]);
        let points = tensor(points, [points.len() / 3, 3]);
        let out = ops::hash_encode(points, table.clone(), *spec);
        gradient(&table, &gradients(out, grad))
    }
}

pub mod exemplar {
    use super::*;
    use impasto_kernels::cpu::exemplar::PARAMS;

    pub fn forward(places: &[f32], normals: &[f32], table: &[f32]) -> Vec<f32> {
        let rows = places.len() / 4;
        let (places, normals) = (tensor(places, [rows, 4]), tensor(normals, [rows, 3]));
        values(ops::exemplar(places, normals, tensor(table, [PARAMS])))
    }

    pub fn backward(places: &[f32], normals: &[f32], grad: &[f32]) -> Vec<f32> {
        let rows = places.len() / 4;
        let table = leaf(&vec![0.0; PARAMS], [PARAMS]);
        let (places, normals) = (tensor(places, [rows, 4]), tensor(normals, [rows, 3]));
        let out = ops::exemplar(places, normals, table.clone());
        gradient(&table, &gradients(out, grad))
    }
}

pub mod mlp {
    use super::*;
    use impasto_kernels::MlpSpec;

    pub fn forward(spec: &MlpSpec, x: &[f32], params: &[f32]) -> Vec<f32> {
        let x = tensor(x, [x.len() / spec.inputs(), spec.inputs()]);
        values(ops::mlp(x, tensor(params, [params.len()]), spec))
    }

    pub fn backward(
        spec: &MlpSpec,
        x: &[f32],
        params: &[f32],
        grad: &[f32],
        need_input: bool,
    ) -> (Vec<f32>, Vec<f32>) {
        let shape = [x.len() / spec.inputs(), spec.inputs()];
        let x = if need_input {
            leaf(x, shape)
        } else {
            tensor(x, shape)
        };
        let params = leaf(params, [params.len()]);
        let grads = gradients(ops::mlp(x.clone(), params.clone(), spec), grad);
        let input = if need_input {
            gradient(&x, &grads)
        } else {
            Vec::new()
        };
        (input, gradient(&params, &grads))
    }
}

pub mod composite {
    use super::*;
    use impasto_kernels::CompositeLayout;

    pub fn forward(
        layout: &CompositeLayout,
        sigma: &[f32],
        colours: &[f32],
        channels: usize,
    ) -> Vec<f32> {
        let n = sigma.len();
        let (sigma, colours) = (tensor(sigma, [n]), tensor(colours, [n, channels]));
        values(ops::composite(sigma, colours, Arc::new(layout.clone())))
    }

    pub fn backward(
        layout: &CompositeLayout,
        sigma: &[f32],
        colours: &[f32],
        channels: usize,
        grad: &[f32],
    ) -> (Vec<f32>, Vec<f32>) {
        let n = sigma.len();
        let (sigma, colours) = (leaf(sigma, [n]), leaf(colours, [n, channels]));
        let out = ops::composite(sigma.clone(), colours.clone(), Arc::new(layout.clone()));
        let grads = gradients(out, grad);
        (gradient(&sigma, &grads), gradient(&colours, &grads))
    }
}

pub mod radiance {
    use super::*;
    use burn::tensor::Tensor;
    use impasto_kernels::cpu::radiance::Radiance;
    use impasto_kernels::{RadianceSpec, Volume};

    pub fn loss(spec: &RadianceSpec, volumes: &[Volume<&[f32]>; 2]) -> Radiance {
        let leaves: [Volume<Tensor<1>>; 2] = volumes
            .each_ref()
            .map(|v| v.as_ref().map(|numbers| leaf(numbers, [numbers.len()])));
        let out = ops::radiance_loss(leaves.clone(), Arc::new(spec.clone()));
        let numbers = values(out.clone().inner());
        let grads = out.slice_dim(0, 0..1).backward();
        Radiance {
            loss: numbers[0],
            error: numbers[1],
            densities: numbers[2..].to_vec(),
            grads: leaves.map(|v| v.map(|leaf| gradient(&leaf, &grads))),
        }
    }
}

pub mod perceptual {
    use super::*;
    use burn::tensor::Tensor;
    use impasto_kernels::PerceptualStack;

    /// An image and its features, in a graph.
    pub struct Taped {
        image: Tensor<3>,
        features: Tensor<1>,
    }

    pub fn forward(
        stack: &PerceptualStack,
        image: &[f32],
        height: usize,
        width: usize,
    ) -> (Vec<f32>, Taped) {
        let image = leaf(image, [height, width, 3]);
        let features = ops::perceptual(image.clone(), Arc::new(stack.clone()));
        (values(features.clone().inner()), Taped { image, features })
    }

    pub fn backward(taped: &Taped, grad: &[f32]) -> Vec<f32> {
        gradient(&taped.image, &gradients(taped.features.clone(), grad))
    }
}
