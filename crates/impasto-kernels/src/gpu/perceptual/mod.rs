//! The frozen perceptual stack, forward and backward to the image.

mod convolution;
mod pixels;
mod statistics;

use super::launch::{Uploads, copied, from_slice, whole};
use crate::PerceptualStack;
use crate::cpu::convolution::Filters;
use crate::cpu::padded::Border;
use burn::backend::ops::FloatTensorOps;
use burn::tensor::Slice;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use convolution::{Convolution, Size, convolve};
use std::sync::Arc;

/// One layer's constants on the device. Filters are `[tap][input][output]`, outputs padded to
/// quads.
#[derive(Debug)]
struct DeviceFilters {
    forward: CubeTensor,
    backward: CubeTensor,
    bias: CubeTensor,
}

/// A stack's constants on a device.
#[derive(Debug)]
struct Constants {
    layers: Vec<DeviceFilters>,
    input_offset: CubeTensor,
}

/// Constants of stacks that still exist.
static KNOWN: Uploads<PerceptualStack, Arc<Constants>> = Uploads::new();

fn filters(like: &CubeTensor, filters: &Filters) -> CubeTensor {
    let quads = filters.outputs.div_ceil(4);
    let mut packed = vec![0.0; 9 * filters.inputs * quads * 4];
    for (i, row) in packed.chunks_exact_mut(4 * quads).enumerate() {
        let (tap, input) = (i / filters.inputs, i % filters.inputs);
        for (o, weight) in row.iter_mut().enumerate().take(filters.outputs) {
            *weight = filters.weight(tap, input, o);
        }
    }
    let length = packed.len();
    from_slice(like, packed, [length])
}

impl Constants {
    fn new(stack: &PerceptualStack, like: &CubeTensor) -> Self {
        let layers = stack.layers.iter().map(|layer| DeviceFilters {
            forward: filters(like, &layer.forward),
            backward: filters(like, &layer.backward),
            bias: from_slice(like, layer.bias.clone(), [layer.bias.len()]),
        });
        Self {
            layers: layers.collect(),
            input_offset: from_slice(like, stack.input_offset.to_vec(), [3]),
        }
    }
}

/// What one layer has seen and given.
#[derive(Debug, Clone)]
struct Step {
    /// Of the output.
    size: Size,
    pooled: Option<CubeTensor>,
    output: CubeTensor,
    statistics: Option<CubeTensor>,
}

/// Activations kept from a forward pass.
#[derive(Debug, Clone)]
pub struct StackTape {
    constants: Arc<Constants>,
    steps: Arc<Vec<Step>>,
}

/// See [`PerceptualStack::forward`].
///
/// # Shapes
/// `image`: `[height, width, 3]`.
///
/// # Panics
/// If the image is smaller than [`PerceptualStack::smallest`].
pub(crate) fn forward(image: CubeTensor, stack: &Arc<PerceptualStack>) -> (CubeTensor, StackTape) {
    let image = whole(image);
    let (height, width) = (image.meta.shape()[0], image.meta.shape()[1]);
    stack.check(height, width);
    let constants = KNOWN.of(stack, &image, || Arc::new(Constants::new(stack, &image)));
    let mut size = Size { height, width };
    let mut current = pixels::input(&image, stack.input_scale, &constants.input_offset);
    let mut steps: Vec<Step> = Vec::with_capacity(constants.layers.len());
    let mut results = Vec::new();
    for (layer, own) in stack.layers.iter().zip(&constants.layers) {
        let Filters {
            inputs, outputs, ..
        } = layer.forward;
        let pooled = layer.pool_before.then(|| {
            let to = Size {
                height: stack.odd_end.pooled(size.height),
                width: stack.odd_end.pooled(size.width),
            };
            let pooled = pixels::pool(&current, size, to, inputs);
            size = to;
            pooled
        });
        current = convolve(&Convolution {
            input: pooled.as_ref().unwrap_or(&current),
            mask: None,
            filters: &own.forward,
            bias: Some(&own.bias),
            size,
            inputs,
            outputs,
            wider: 0,
            mirrored: stack.border == Border::Mirrored,
        });
        let statistics = (layer.statistics).then(|| statistics::of(&current, size, outputs));
        results.extend(statistics.clone());
        steps.push(Step {
            size,
            pooled,
            output: current.clone(),
            statistics,
        });
    }
    results.insert(0, current);
    let tape = StackTape {
        steps: Arc::new(steps),
        constants,
    };
    (CubeBackend::float_cat(results, 0), tape)
}

/// See [`PerceptualStack::backward`].
pub(crate) fn backward(tape: &StackTape, grad: CubeTensor, stack: &PerceptualStack) -> CubeTensor {
    let grad = whole(grad);
    let mirrored = stack.border == Border::Mirrored;
    let StackTape { constants, steps } = tape;
    let [Some(last), Some(first)] = [steps.last(), steps.first()] else {
        unreachable!("a stack has layers");
    };
    let content = last.output.meta.num_elements();
    let of_content = CubeBackend::float_slice(grad.clone(), &[Slice::from(0..content)]);
    // Statistics are added in place, so the content's part must not be shared.
    let mut current = copied(&whole(of_content));
    let mut statistics_at = grad.meta.num_elements();
    for (i, filters) in constants.layers.iter().enumerate().rev() {
        let step = &steps[i];
        let Filters {
            inputs, outputs, ..
        } = stack.layers[i].forward;
        if let Some(own) = &step.statistics {
            statistics_at -= 2 * outputs;
            statistics::backward(&step.output, own, &grad, statistics_at, &current);
        }
        current = convolve(&Convolution {
            input: &current,
            mask: Some(&step.output),
            filters: &filters.backward,
            bias: None,
            size: step.size,
            inputs: outputs,
            outputs: inputs,
            wider: usize::from(mirrored),
            mirrored: false,
        });
        // What falls on a mirrored border belongs to the pixels that it mirrors.
        if mirrored {
            current = pixels::fold(&current, step.size, inputs);
        }
        if let (Some(pooled), Some(before)) = (&step.pooled, i.checked_sub(1)) {
            let before = &steps[before];
            let sizes = [before.size, step.size];
            current = pixels::pool_backward(&before.output, pooled, &current, sizes, inputs);
        }
    }
    let scaled = CubeBackend::float_mul_scalar(current, stack.input_scale.into());
    CubeBackend::float_reshape(scaled, [first.size.height, first.size.width, 3].into())
}
