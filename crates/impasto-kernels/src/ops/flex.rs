//! The CPU: slices in, slices out, no copies of contiguous tensors.

use super::{AdamState, KernelGrad, KernelOps, RadianceVolumes};
use crate::cpu::perceptual::PerceptualTape;
use crate::cpu::{adam, composite, exemplar, hash_grid, mlp, radiance};
use crate::{
    AdamStep, CompositeLayout, HashGridSpec, MlpSpec, PerceptualStack, RadianceSpec, Volume,
};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Flex, TensorMetadata};
use burn::tensor::{Shape, Tensor, TensorData};
use std::ops::Deref;
use std::sync::Arc;

type Primitive = FloatTensor<Flex>;

/// The numbers of a tensor where they lie, if that is in the CPU's memory.
#[derive(Debug, Clone)]
pub struct OnHost(Primitive);

impl OnHost {
    /// `None` for tensors of other devices and of autodiff graphs.
    pub fn of<const D: usize>(tensor: &Tensor<D>) -> Option<Self> {
        let primitive = tensor.clone().try_into_primitive::<Flex>().ok()?;
        Some(Self::new(primitive))
    }

    /// Copies only what is not contiguous.
    fn new(tensor: Primitive) -> Self {
        Self(match tensor.as_slice::<f32>() {
            Some(_) => tensor,
            None => tensor.to_contiguous(),
        })
    }

    fn rows(&self) -> usize {
        self.0.shape()[0]
    }
}

impl Deref for OnHost {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        // Contiguous, and every tensor of this program is f32.
        self.0.as_slice().unwrap_or_default()
    }
}

fn tensor(data: Vec<f32>, shape: impl Into<Shape>) -> Primitive {
    Primitive::from_data(TensorData::new(data, shape))
}

impl KernelOps for Flex {
    fn hash_encode(points: Primitive, table: Primitive, spec: HashGridSpec) -> Primitive {
        let [points, table] = [points, table].map(OnHost::new);
        let out = hash_grid::forward(&spec, &points, &table);
        tensor(out, [points.rows(), spec.outputs()])
    }

    fn exemplar(places: Primitive, normals: Primitive, table: Primitive) -> Primitive {
        let [places, normals, table] = [places, normals, table].map(OnHost::new);
        let out = exemplar::forward(&places, &normals, &table);
        tensor(out, [places.rows(), exemplar::FEATURES])
    }

    fn mlp(x: Primitive, params: Primitive, spec: MlpSpec) -> Primitive {
        let [x, params] = [x, params].map(OnHost::new);
        let out = mlp::forward(&spec, &x, &params);
        tensor(out, [x.rows(), spec.outputs()])
    }

    fn mlp_again(_: Primitive, _: Primitive, out: Primitive, _: MlpSpec) -> Primitive {
        out
    }

    fn composite(sigma: Primitive, colours: Primitive, layout: Arc<CompositeLayout>) -> Primitive {
        let channels = colours.shape()[1];
        let [sigma, colours] = [sigma, colours].map(OnHost::new);
        let out = composite::forward(&layout, &sigma, &colours, channels);
        tensor(out, [layout.rays.len(), CompositeLayout::outputs(channels)])
    }

    fn perceptual(image: Primitive, stack: Arc<PerceptualStack>) -> Primitive {
        Self::perceptual_taped(image, &stack).0
    }

    fn radiance_loss(volumes: RadianceVolumes<Self>, spec: Arc<RadianceSpec>) -> Primitive {
        Self::radiance_loss_with_gradients(volumes.volumes(), &spec).0
    }

    fn adam(state: AdamState<Self>, grad: Primitive, step: AdamStep) -> AdamState<Self> {
        // `storage_mut` hands out the whole buffer, which a view shares with others: each becomes the
        // only content of its storage, in order. An unshared buffer is kept.
        let mut own = state.into_array().map(|tensor| tensor.to_contiguous());
        let [param, first, second] = own.each_mut().map(Primitive::storage_mut::<f32>);
        adam::update(param, first, second, &OnHost::new(grad), &step);
        AdamState::from_array(own)
    }
}

impl KernelGrad for Flex {
    type PerceptualTape = Arc<PerceptualTape>;

    fn hash_encode_backward(points: Primitive, grad: Primitive, spec: HashGridSpec) -> Primitive {
        let [points, grad] = [points, grad].map(OnHost::new);
        let out = hash_grid::backward(&spec, &points, &grad);
        tensor(out, [spec.params()])
    }

    fn exemplar_backward(places: Primitive, normals: Primitive, grad: Primitive) -> Primitive {
        let [places, normals, grad] = [places, normals, grad].map(OnHost::new);
        let out = exemplar::backward(&places, &normals, &grad);
        tensor(out, [exemplar::PARAMS])
    }

    fn mlp_backward(
        x: Primitive,
        params: Primitive,
        grad: Primitive,
        spec: MlpSpec,
        need_input: bool,
    ) -> (Option<Primitive>, Primitive) {
        let [x, params, grad] = [x, params, grad].map(OnHost::new);
        let (input, weights) = mlp::backward(&spec, &x, &params, &grad, need_input);
        (
            need_input.then(|| tensor(input, [x.rows(), spec.inputs()])),
            tensor(weights, [spec.params()]),
        )
    }

    fn composite_backward(
        sigma: Primitive,
        colours: Primitive,
        grad: Primitive,
        layout: Arc<CompositeLayout>,
    ) -> (Primitive, Primitive) {
        let channels = colours.shape()[1];
        let [sigma, colours, grad] = [sigma, colours, grad].map(OnHost::new);
        let (of_sigma, of_colours) =
            composite::backward(&layout, &sigma, &colours, channels, &grad);
        (
            tensor(of_sigma, [sigma.rows()]),
            tensor(of_colours, [colours.rows(), channels]),
        )
    }

    fn radiance_loss_with_gradients(
        volumes: [Volume<Primitive>; 2],
        spec: &RadianceSpec,
    ) -> (Primitive, [Volume<Primitive>; 2]) {
        let whole = volumes.map(|v| v.map(|tensor| tensor.to_contiguous()));
        let slices = whole
            .each_ref()
            .map(|v| v.as_ref().map(Primitive::storage::<f32>));
        let result = radiance::loss(spec, &slices);
        let flat = |numbers: Vec<f32>| {
            let length = numbers.len();
            tensor(numbers, [length])
        };
        let numbers = [vec![result.loss, result.error], result.densities].concat();
        (flat(numbers), result.grads.map(|v| v.map(flat)))
    }

    /// A loss that is the end of its graph has a gradient of one: nothing to do for millions of
    /// numbers.
    fn scaled(tensor: Primitive, factor: Primitive) -> Primitive {
        if *OnHost::new(factor.clone()) == [1.0] {
            return tensor;
        }
        Self::float_mul(tensor, factor)
    }

    fn perceptual_taped(
        image: Primitive,
        stack: &Arc<PerceptualStack>,
    ) -> (Primitive, Self::PerceptualTape) {
        let shape = image.shape();
        let (features, tape) = stack.forward(&OnHost::new(image), shape[0], shape[1]);
        let length = features.len();
        (tensor(features, [length]), Arc::new(tape))
    }

    fn perceptual_backward(
        tape: Self::PerceptualTape,
        grad: Primitive,
        stack: &PerceptualStack,
    ) -> Primitive {
        let (height, width) = tape.image_size();
        let out = stack.backward(&tape, &OnHost::new(grad));
        tensor(out, [height, width, 3])
    }
}
