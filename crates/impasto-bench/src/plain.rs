//! The same computations in plain operations of the tensor library, for comparison.

use crate::cases::tensor;
use burn::tensor::activation::relu;
use burn::tensor::module::{conv2d, max_pool2d};
use burn::tensor::ops::{ConvOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor};

/// Forward and backward to the image through convolutions with relu and pools, statistics after
/// pools and the last layer as the loss.
pub(crate) fn perceptual(
    layers: &[(usize, usize, bool)],
    weights: &[Vec<f32>],
    image: &[f32],
    [height, width]: [usize; 2],
) -> impl FnMut() -> Tensor<4> {
    let device = Device::flex().autodiff();
    let image: Tensor<4> = tensor(image.to_vec(), [1, 3, height, width], &device);
    let layers: Vec<_> = layers
        .iter()
        .zip(weights)
        .map(|((inputs, outputs, pool), weight)| {
            let weight: Tensor<4> = tensor(weight.clone(), [*outputs, *inputs, 3, 3], &device);
            let bias = tensor(vec![0.01; *outputs], [*outputs], &device);
            (weight, bias, *pool)
        })
        .collect();
    move || {
        let image = image.clone().require_grad();
        let mut x = image.clone();
        let mut loss: Option<Tensor<1>> = None;
        for (weight, bias, pool) in &layers {
            if *pool {
                x = max_pool2d(x, MaxPoolOptions::new([2, 2]));
            }
            let options = ConvOptions::new([1, 1], [1, 1], [1, 1], 1);
            x = relu(conv2d(x, weight.clone(), Some(bias.clone()), options));
            if *pool {
                let spread = x.clone().mean() + x.clone().square().mean();
                loss = Some(loss.map_or(spread.clone(), |sum| sum + spread));
            }
        }
        let loss = loss.map_or(x.clone().mean(), |sum| sum + x.mean());
        let mut gradients = loss.backward();
        image
            .grad_remove(&mut gradients)
            .unwrap_or_else(|| image.clone().inner())
    }
}

/// Forward and backward of an MLP with relu after every layer, gradients for input and weights.
pub(crate) fn mlp(
    widths: &[usize],
    x: &[f32],
    params: &[f32],
    grad: &[f32],
) -> impl FnMut() -> Option<Tensor<2>> {
    let device = Device::flex().autodiff();
    let rows = x.len() / widths[0];
    let x: Tensor<2> = tensor(x.to_vec(), [rows, widths[0]], &device);
    let grad: Tensor<2> = tensor(grad.to_vec(), [rows, widths[widths.len() - 1]], &device);
    let mut layers = Vec::new();
    let mut at = 0;
    for pair in widths.windows(2) {
        let weights = pair[0] * pair[1];
        let (weight, bias) = params[at..at + weights + pair[1]].split_at(weights);
        at += weights + pair[1];
        let weight: Tensor<2> = tensor(weight.to_vec(), [pair[0], pair[1]], &device);
        let bias: Tensor<2> = tensor(bias.to_vec(), [1, pair[1]], &device);
        layers.push((weight, bias));
    }
    move || {
        let x = x.clone().require_grad();
        let mut leaves = Vec::new();
        let mut current = x.clone();
        for (weight, bias) in &layers {
            let (weight, bias) = (weight.clone().require_grad(), bias.clone().require_grad());
            current = relu(current.matmul(weight.clone()) + bias.clone());
            leaves.extend([weight, bias]);
        }
        let mut gradients = (current * grad.clone()).sum().backward();
        for leaf in &leaves {
            std::hint::black_box(leaf.grad_remove(&mut gradients));
        }
        x.grad_remove(&mut gradients)
    }
}

/// Compositing of rays with equally many samples, forward and backward to densities and colours.
pub(crate) fn composite(
    rays: usize,
    per_ray: usize,
    sigma: &[f32],
    colours: &[f32],
) -> impl FnMut() -> Option<Tensor<3>> {
    let device = Device::flex().autodiff();
    let sigma: Tensor<2> = tensor(sigma.to_vec(), [rays, per_ray], &device);
    let colours: Tensor<3> = tensor(colours.to_vec(), [rays, per_ray, 3], &device);
    move || {
        let (sigma, colours) = (sigma.clone().require_grad(), colours.clone().require_grad());
        let depth = sigma.clone() * 0.02;
        let passed = (-depth.clone()).exp();
        let before = (-(depth.clone().cumsum(1) - depth)).exp();
        let weight = (-passed + 1.0) * before;
        let out = (colours.clone() * weight.unsqueeze_dim(2)).sum_dim(1);
        let mut gradients = out.sum().backward();
        std::hint::black_box(sigma.grad_remove(&mut gradients));
        colours.grad_remove(&mut gradients)
    }
}
