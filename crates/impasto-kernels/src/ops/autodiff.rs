//! Backward passes: each operation's saved state is the associated type of its step.

use super::{AdamState, KernelGrad, KernelOps, RadianceVolumes};
use crate::{
    AdamStep, CompositeLayout, HashGridSpec, MlpSpec, PerceptualStack, RadianceSpec, Volume,
};
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, NodeGuard, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend};
use burn::tensor::Slice;
use std::sync::Arc;

#[derive(Debug)]
struct HashEncode;

impl<B: KernelGrad> Backward<B, 1> for HashEncode {
    /// Points and grid sizes.
    type State = (FloatTensor<B>, HashGridSpec);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let (points, spec) = ops.state;
        unary::<B, _>(ops.parents, ops.node, grads, |grad| {
            B::hash_encode_backward(points, grad, spec)
        });
    }
}

#[derive(Debug)]
struct Exemplar;

impl<B: KernelGrad> Backward<B, 1> for Exemplar {
    /// Places and normals.
    type State = (FloatTensor<B>, FloatTensor<B>);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let (places, normals) = ops.state;
        unary::<B, _>(ops.parents, ops.node, grads, |grad| {
            B::exemplar_backward(places, normals, grad)
        });
    }
}

#[derive(Debug)]
struct Mlp;

impl<B: KernelGrad> Backward<B, 2> for Mlp {
    /// Input, parameters and layers; activations are recomputed.
    type State = (FloatTensor<B>, FloatTensor<B>, MlpSpec);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        let ([x_node, params_node], (x, params, spec)) = (ops.parents, ops.state);
        let (x_grad, params_grad) = B::mlp_backward(x, params, grad, spec, x_node.is_some());
        if let (Some(node), Some(grad)) = (x_node, x_grad) {
            grads.register::<B>(node.id, grad);
        }
        if let Some(node) = params_node {
            grads.register::<B>(node.id, params_grad);
        }
    }
}

#[derive(Debug)]
struct Composite;

impl<B: KernelGrad> Backward<B, 2> for Composite {
    /// Densities, colours and the constant layout.
    type State = (FloatTensor<B>, FloatTensor<B>, Arc<CompositeLayout>);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        let ([sigma_node, colour_node], (sigma, colours, layout)) = (ops.parents, ops.state);
        let (sigma_grad, colour_grad) = B::composite_backward(sigma, colours, grad, layout);
        if let Some(node) = sigma_node {
            grads.register::<B>(node.id, sigma_grad);
        }
        if let Some(node) = colour_node {
            grads.register::<B>(node.id, colour_grad);
        }
    }
}

#[derive(Debug)]
struct Perceptual;

impl<B: KernelGrad> Backward<B, 1> for Perceptual {
    /// Activations of the forward pass.
    type State = (B::PerceptualTape, Arc<PerceptualStack>);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let (tape, stack) = ops.state;
        unary::<B, _>(ops.parents, ops.node, grads, |grad| {
            B::perceptual_backward(tape, grad, &stack)
        });
    }
}

#[derive(Debug)]
struct RadianceLoss;

impl<B: KernelGrad> Backward<B, 8> for RadianceLoss {
    /// The gradients of the loss: they came with it.
    type State = [Volume<FloatTensor<B>>; 2];

    fn backward(self, ops: Ops<Self::State, 8>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        // Only the first number, the loss, has gradients.
        let of_loss = B::float_slice(grad, &[Slice::from(0..1)]);
        let grads_of = ops.state.into_iter().flat_map(Volume::into_array);
        for (node, own) in ops.parents.into_iter().zip(grads_of) {
            if let Some(node) = node {
                grads.register::<B>(node.id, B::scaled(own, of_loss.clone()));
            }
        }
    }
}

/// Puts a result into the graph, with the step back to where it came from.
fn finished<B: Backend, C: CheckpointStrategy, S: Backward<B, N>, const N: usize>(
    step: S,
    nodes: [NodeGuard; N],
    state: S::State,
    out: FloatTensor<B>,
) -> FloatTensor<Autodiff<B, C>> {
    match step.prepare::<C>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(state, out),
        OpsKind::UnTracked(prep) => prep.finish(out),
    }
}

impl<B: KernelOps + KernelGrad, C: CheckpointStrategy> KernelOps for Autodiff<B, C> {
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        spec: HashGridSpec,
    ) -> FloatTensor<Self> {
        let (points, (table, node)) = (points.into_primitive(), table.into_parts());
        let out = B::hash_encode(points.clone(), table, spec);
        finished::<B, C, _, 1>(HashEncode, [node], (points, spec), out)
    }

    fn exemplar(
        places: FloatTensor<Self>,
        normals: FloatTensor<Self>,
        table: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        let [places, normals] = [places, normals].map(FloatTensor::<Self>::into_primitive);
        let (table, node) = table.into_parts();
        let out = B::exemplar(places.clone(), normals.clone(), table);
        finished::<B, C, _, 1>(Exemplar, [node], (places, normals), out)
    }

    fn mlp(x: FloatTensor<Self>, params: FloatTensor<Self>, spec: MlpSpec) -> FloatTensor<Self> {
        let out = B::mlp(
            x.clone().into_primitive(),
            params.clone().into_primitive(),
            spec.clone(),
        );
        Self::mlp_again(x, params, Self::FloatTensorPrimitive::new(out), spec)
    }

    fn mlp_again(
        x: FloatTensor<Self>,
        params: FloatTensor<Self>,
        out: FloatTensor<Self>,
        spec: MlpSpec,
    ) -> FloatTensor<Self> {
        let ((x, x_node), (params, params_node)) = (x.into_parts(), params.into_parts());
        let out = out.into_primitive();
        finished::<B, C, _, 2>(Mlp, [x_node, params_node], (x, params, spec), out)
    }

    fn composite(
        sigma: FloatTensor<Self>,
        colours: FloatTensor<Self>,
        layout: Arc<CompositeLayout>,
    ) -> FloatTensor<Self> {
        let ((sigma, sigma_node), (colours, colour_node)) =
            (sigma.into_parts(), colours.into_parts());
        let out = B::composite(sigma.clone(), colours.clone(), Arc::clone(&layout));
        let state = (sigma, colours, layout);
        finished::<B, C, _, 2>(Composite, [sigma_node, colour_node], state, out)
    }

    fn radiance_loss(volumes: RadianceVolumes<Self>, spec: Arc<RadianceSpec>) -> FloatTensor<Self> {
        let mut nodes = Vec::with_capacity(8);
        let volumes = volumes.volumes().map(|volume| {
            volume.map(|tensor| {
                let (primitive, node) = tensor.into_parts();
                nodes.push(node);
                primitive
            })
        });
        let Ok(nodes) = <[_; 8]>::try_from(nodes) else {
            unreachable!("one node for each of eight tensors");
        };
        match RadianceLoss.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let (out, grads) = B::radiance_loss_with_gradients(volumes, &spec);
                prep.finish(grads, out)
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::radiance_loss(RadianceVolumes::new(volumes), spec))
            }
        }
    }

    fn perceptual(image: FloatTensor<Self>, stack: Arc<PerceptualStack>) -> FloatTensor<Self> {
        let (image, node) = image.into_parts();
        match Perceptual.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let (out, tape) = B::perceptual_taped(image, &stack);
                prep.finish((tape, stack), out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::perceptual(image, stack)),
        }
    }

    /// An optimiser's update is no part of a graph: gradients stop here.
    fn adam(state: AdamState<Self>, grad: FloatTensor<Self>, step: AdamStep) -> AdamState<Self> {
        let state = state
            .into_array()
            .map(Self::FloatTensorPrimitive::into_primitive);
        let state = B::adam(AdamState::from_array(state), grad.into_primitive(), step);
        AdamState::from_array(state.into_array().map(Self::FloatTensorPrimitive::new))
    }
}
