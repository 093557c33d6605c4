//! The CPU: slices in, slices out, no copies of contiguous tensors.

use super::{AdamState, KernelGrad, KernelOps, RadianceVolumes};
use crate::cpu::perceptual::PerceptualTape;
use crate::cpu::{adam, composite, hash_grid, mlp, radiance};
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

/// Runs `f` on a tensor's numbers, copying only what is not contiguous.
fn with<R>(tensor: &Primitive, f: impl FnOnce(&[f32]) -> R) -> R {
    match tensor.as_slice::<f32>() {
        Some(slice) => f(slice),
        None => f(tensor.to_contiguous().storage::<f32>()),
    }
}

/// The numbers of a tensor where they lie, if that is in the CPU's memory.
#[derive(Debug, Clone)]
pub struct OnHost(Primitive);

impl OnHost {
    /// `None` for tensors of other devices and of autodiff graphs.
    pub fn of<const D: usize>(tensor: &Tensor<D>) -> Option<Self> {
        let primitive = tensor.clone().try_into_primitive::<Flex>().ok()?;
        Some(Self(match primitive.as_slice::<f32>() {
            Some(_) => primitive,
            None => primitive.to_contiguous(),
        }))
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

/// Makes a tensor the only content of its storage, in order: `storage_mut` hands out the whole
/// buffer, which a view shares with others. An unshared buffer is kept.
fn make_whole(tensor: &mut Primitive) {
    *tensor = tensor.to_contiguous();
}

fn rows(tensor: &Primitive) -> usize {
    tensor.shape()[0]
}

impl KernelOps for Flex {
    fn hash_encode(points: Primitive, table: Primitive, spec: HashGridSpec) -> Primitive {
        let out = with(&points, |p| {
            with(&table, |t| hash_grid::forward(&spec, p, t))
        });
        tensor(out, [rows(&points), spec.outputs()])
    }

    fn mlp(x: Primitive, params: Primitive, spec: MlpSpec) -> Primitive {
        let out = with(&x, |x| with(&params, |p| mlp::forward(&spec, x, p)));
        tensor(out, [rows(&x), spec.outputs()])
    }

    fn mlp_again(_: Primitive, _: Primitive, out: Primitive, _: MlpSpec) -> Primitive {
        out
    }

    fn composite(sigma: Primitive, colours: Primitive, layout: Arc<CompositeLayout>) -> Primitive {
        let channels = colours.shape()[1];
        let out = with(&sigma, |s| {
            with(&colours, |c| composite::forward(&layout, s, c, channels))
        });
        tensor(out, [layout.rays.len(), CompositeLayout::outputs(channels)])
    }

    fn perceptual(image: Primitive, stack: Arc<PerceptualStack>) -> Primitive {
        Self::perceptual_taped(image, &stack).0
    }

    fn radiance_loss(volumes: RadianceVolumes<Self>, spec: Arc<RadianceSpec>) -> Primitive {
        Self::radiance_loss_with_gradients(volumes.volumes(), &spec).0
    }

    fn adam(state: AdamState<Self>, grad: Primitive, step: AdamStep) -> AdamState<Self> {
        let AdamState {
            mut param,
            mut first,
            mut second,
        } = state;
        for tensor in [&mut param, &mut first, &mut second] {
            make_whole(tensor);
        }
        with(&grad, |grad| {
            adam::update(
                param.storage_mut::<f32>(),
                first.storage_mut::<f32>(),
                second.storage_mut::<f32>(),
                grad,
                &step,
            );
        });
        AdamState {
            param,
            first,
            second,
        }
    }
}

impl KernelGrad for Flex {
    type PerceptualTape = Arc<PerceptualTape>;

    fn hash_encode_backward(points: Primitive, grad: Primitive, spec: HashGridSpec) -> Primitive {
        let out = with(&points, |p| {
            with(&grad, |g| hash_grid::backward(&spec, p, g))
        });
        tensor(out, [spec.params()])
    }

    fn mlp_backward(
        x: Primitive,
        params: Primitive,
        grad: Primitive,
        spec: MlpSpec,
        need_input: bool,
    ) -> (Option<Primitive>, Primitive) {
        let (input, weights) = with(&x, |x| {
            with(&params, |p| {
                with(&grad, |g| mlp::backward(&spec, x, p, g, need_input))
            })
        });
        (
            need_input.then(|| tensor(input, [rows(&x), spec.inputs()])),
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
        let (s, c) = with(&sigma, |s| {
            with(&colours, |c| {
                with(&grad, |g| composite::backward(&layout, s, c, channels, g))
            })
        });
        (
            tensor(s, [rows(&sigma)]),
            tensor(c, [rows(&colours), channels]),
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
        if with(&factor, |f| f == [1.0]) {
            tensor
        } else {
            Self::float_mul(tensor, factor)
        }
    }

    fn perceptual_taped(
        image: Primitive,
        stack: &Arc<PerceptualStack>,
    ) -> (Primitive, Self::PerceptualTape) {
        let shape = image.shape();
        let (features, tape) = with(&image, |i| stack.forward(i, shape[0], shape[1]));
        let length = features.len();
        (tensor(features, [length]), Arc::new(tape))
    }

    fn perceptual_backward(
        tape: Self::PerceptualTape,
        grad: Primitive,
        stack: &PerceptualStack,
    ) -> Primitive {
        let (height, width) = tape.image_size();
        let out = with(&grad, |g| stack.backward(&tape, g));
        tensor(out, [height, width, 3])
    }
}
