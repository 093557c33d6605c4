//! GPUs: tensors stay where they are.

use super::{AdamState, KernelGrad, KernelOps, RadianceVolumes};
use crate::gpu::composite::DeviceLayout;
use crate::gpu::launch::{copied, whole};
use crate::gpu::{adam, composite, exemplar, hash_grid, mlp, perceptual, plain_mlp, radiance};
use crate::{
    AdamStep, CompositeLayout, HashGridSpec, MlpSpec, PerceptualStack, RadianceSpec, Volume,
};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use std::sync::Arc;

type Primitive = FloatTensor<CubeBackend>;

impl KernelOps for CubeBackend {
    fn hash_encode(points: Primitive, table: Primitive, spec: HashGridSpec) -> Primitive {
        hash_grid::encode(&whole(points), &whole(table), &spec)
    }

    fn exemplar(places: Primitive, normals: Primitive, table: Primitive) -> Primitive {
        exemplar::read(&whole(places), &whole(normals), &whole(table))
    }

    fn mlp(x: Primitive, params: Primitive, spec: MlpSpec) -> Primitive {
        let (x, params) = (whole(x), whole(params));
        if mlp::fits(&spec) {
            return mlp::forward(&x, &params, &spec);
        }
        plain_mlp::forward::<Self>(x, &params, &spec)
    }

    fn mlp_again(_: Primitive, _: Primitive, out: Primitive, _: MlpSpec) -> Primitive {
        out
    }

    fn composite(sigma: Primitive, colours: Primitive, layout: Arc<CompositeLayout>) -> Primitive {
        let sigma = whole(sigma);
        composite::forward(&DeviceLayout::of(&sigma, &layout), &sigma, &whole(colours))
    }

    fn perceptual(image: Primitive, stack: Arc<PerceptualStack>) -> Primitive {
        perceptual::forward(image, &stack).0
    }

    fn radiance_loss(volumes: RadianceVolumes<Self>, spec: Arc<RadianceSpec>) -> Primitive {
        radiance::loss(volumes.volumes(), &spec).0
    }

    fn adam(state: AdamState<Self>, grad: Primitive, step: AdamStep) -> AdamState<Self> {
        // What somebody else holds must stay as it is.
        let own = state.into_array().map(|tensor| {
            if tensor.handle.can_mut() {
                whole(tensor)
            } else {
                copied(&tensor)
            }
        });
        adam::update(own.each_ref(), &whole(grad), &step);
        AdamState::from_array(own)
    }
}

impl KernelGrad for CubeBackend {
    type PerceptualTape = perceptual::StackTape;

    fn hash_encode_backward(points: Primitive, grad: Primitive, spec: HashGridSpec) -> Primitive {
        hash_grid::spread(&whole(points), &whole(grad), &spec)
    }

    fn exemplar_backward(places: Primitive, normals: Primitive, grad: Primitive) -> Primitive {
        exemplar::spread(&whole(places), &whole(normals), &whole(grad))
    }

    fn mlp_backward(
        x: Primitive,
        params: Primitive,
        grad: Primitive,
        spec: MlpSpec,
        need_input: bool,
    ) -> (Option<Primitive>, Primitive) {
        let (x, params, grad) = (whole(x), whole(params), whole(grad));
        if mlp::fits(&spec) {
            return mlp::backward(&x, &params, &grad, &spec, need_input);
        }
        let [input, weights] = plain_mlp::backward::<Self>(x, params, grad, &spec);
        let Some(weights) = weights else {
            unreachable!("every layer depends on its parameters");
        };
        (input.filter(|_| need_input), weights)
    }

    fn composite_backward(
        sigma: Primitive,
        colours: Primitive,
        grad: Primitive,
        layout: Arc<CompositeLayout>,
    ) -> (Primitive, Primitive) {
        layout.in_order();
        let sigma = whole(sigma);
        let device = DeviceLayout::of(&sigma, &layout);
        composite::backward(&device, &sigma, &whole(colours), &whole(grad), 0.0)
    }

    fn radiance_loss_with_gradients(
        volumes: [Volume<Primitive>; 2],
        spec: &RadianceSpec,
    ) -> (Primitive, [Volume<Primitive>; 2]) {
        radiance::loss(volumes, spec)
    }

    fn scaled(tensor: Primitive, factor: Primitive) -> Primitive {
        Self::float_mul(tensor, factor)
    }

    fn perceptual_taped(
        image: Primitive,
        stack: &Arc<PerceptualStack>,
    ) -> (Primitive, Self::PerceptualTape) {
        perceptual::forward(image, stack)
    }

    fn perceptual_backward(
        tape: Self::PerceptualTape,
        grad: Primitive,
        stack: &PerceptualStack,
    ) -> Primitive {
        perceptual::backward(&tape, grad, stack)
    }
}
