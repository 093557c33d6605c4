//! MLPs too wide for a cube's shared memory, as products of whole matrices by the tensor library.
//! They are those that see few rows: the hypernetwork, and the VAE.

use crate::{Activation, MlpSpec};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend, Backend};
use burn::tensor::Slice;
use std::ops::Range;

/// A part of flat parameters as a matrix.
fn part<B: Backend>(flat: &FloatTensor<B>, range: Range<usize>, rows: usize) -> FloatTensor<B> {
    let columns = range.len() / rows;
    let part = B::float_slice(flat.clone(), &[Slice::from(range)]);
    B::float_reshape(part, [rows, columns].into())
}

/// See [`crate::cpu::mlp::forward`]; differentiable where the backend is.
pub(crate) fn forward<B: Backend>(
    x: FloatTensor<B>,
    params: &FloatTensor<B>,
    spec: &MlpSpec,
) -> FloatTensor<B> {
    let mut current = x;
    let mut entry = None;
    for (l, layer) in spec.layers().iter().enumerate() {
        if let Some(block) = spec.block_from(l) {
            let shift = part::<B>(params, spec.shift_range(block), 1);
            current = B::float_add(current, shift);
            entry = Some(current.clone());
        }
        let range = spec.layer_range(l);
        let bias = range.end - layer.outputs;
        let weight = part::<B>(params, range.start..bias, layer.outputs);
        let product = B::float_matmul(current, B::float_swap_dims(weight, 0, 1));
        current = B::float_add(product, part::<B>(params, bias..range.end, 1));
        if layer.layer_norm {
            let centred = B::float_sub(current.clone(), B::float_mean_dim(current, 1));
            let squared = B::float_mul(centred.clone(), centred.clone());
            let variance = B::float_add_scalar(B::float_mean_dim(squared, 1), 1e-5f32.into());
            current = B::float_div(centred, B::float_sqrt(variance));
        }
        current = match layer.activation {
            Activation::Linear => current,
            Activation::Relu => B::relu(current),
            Activation::Sigmoid => B::sigmoid(current),
        };
        if spec.block_to(l).is_some()
            && let Some(entry) = entry.take()
        {
            current = B::float_add(current, entry);
        }
    }
    current
}

/// See [`crate::cpu::mlp::backward`]: the gradient that the tensor library finds.
pub(crate) fn backward<B: Backend>(
    x: FloatTensor<B>,
    params: FloatTensor<B>,
    grad: FloatTensor<B>,
    spec: &MlpSpec,
) -> [Option<FloatTensor<B>>; 2] {
    type Graph<B> = Autodiff<B>;
    let leaf = |tensor| Graph::<B>::float_set_require_grad(Graph::<B>::from_inner(tensor), true);
    let leaves = [leaf(x), leaf(params)];
    let out = forward::<Graph<B>>(leaves[0].clone(), &leaves[1], spec);
    let weighed = Graph::<B>::float_mul(out, Graph::<B>::from_inner(grad));
    let grads = Graph::<B>::backward(Graph::<B>::float_sum(weighed));
    leaves.map(|leaf| Graph::<B>::grad(&leaf, &grads))
}
