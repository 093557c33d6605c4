//! The frozen perceptual stack, forward and backward to the image.

mod convolution;
mod pixels;
mod statistics;

use super::launch::{from_slice, whole};
use crate::PerceptualStack;
use crate::cpu::convolution::Filters;
use crate::cpu::perceptual::Border;
use burn::backend::ops::FloatTensorOps;
use burn_cubecl::tensor::CubeTensor;
use burn_cubecl::{CubeBackend, CubeDevice};
use convolution::{Mode, Size, convolve};
use std::sync::{Arc, OnceLock};

/// One layer's constants on the device. Filters are `[tap][input][output]`, outputs padded to
/// quads.
#[derive(Debug)]
struct Layer {
    forward: CubeTensor,
    backward: CubeTensor,
    bias: CubeTensor,
    inputs: usize,
    outputs: usize,
    pool_before: bool,
    statistics: bool,
}

/// A stack's constants on a device.
#[derive(Debug)]
struct Constants {
    layers: Vec<Layer>,
    input_offset: CubeTensor,
}

/// The constants of a stack on the first device that asked for them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Resident(OnceLock<(CubeDevice, Arc<Constants>)>);

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
    fn of(stack: &PerceptualStack, like: &CubeTensor) -> Arc<Self> {
        let make = || Arc::new(Self::new(stack, like));
        let (device, first) = stack
            .resident
            .0
            .get_or_init(|| (like.device.clone(), make()));
        match *device == like.device {
            true => Arc::clone(first),
            false => make(),
        }
    }

    fn new(stack: &PerceptualStack, like: &CubeTensor) -> Self {
        let layers = stack.layers.iter().map(|layer| Layer {
            forward: filters(like, &layer.forward),
            backward: filters(like, &layer.backward),
            bias: from_slice(like, layer.bias.clone(), [layer.bias.len()]),
            inputs: layer.forward.inputs,
            outputs: layer.forward.outputs,
            pool_before: layer.pool_before,
            statistics: layer.statistics,
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
pub struct Tape {
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
pub(crate) fn forward(image: CubeTensor, stack: &PerceptualStack) -> (CubeTensor, Tape) {
    let image = whole(image);
    let (height, width) = (image.meta.shape()[0], image.meta.shape()[1]);
    stack.check(height, width);
    let constants = Constants::of(stack, &image);
    let mut size = Size { height, width };
    let mut current = pixels::input(&image, stack.input_scale, &constants.input_offset);
    let mut steps: Vec<Step> = Vec::with_capacity(constants.layers.len());
    let mut results = Vec::new();
    for layer in &constants.layers {
        let pooled = layer.pool_before.then(|| {
            let to = Size {
                height: stack.odd_end.pooled(size.height),
                width: stack.odd_end.pooled(size.width),
            };
            let pooled = pixels::pool(&current, size, to, layer.inputs);
            size = to;
            pooled
        });
        let mode = Mode {
            inputs: layer.inputs,
            outputs: layer.outputs,
            wider: 0,
            mirrored: stack.border == Border::Mirrored,
            relu: true,
            masked: false,
        };
        let input = (pooled.as_ref().unwrap_or(&current), None);
        current = convolve(input, (&layer.forward, Some(&layer.bias)), size, mode);
        let statistics = layer
            .statistics
            .then(|| statistics::of(&current, size, layer.outputs));
        results.extend(statistics.clone());
        steps.push(Step {
            size,
            pooled,
            output: current.clone(),
            statistics,
        });
    }
    results.insert(0, current);
    let tape = Tape {
        steps: Arc::new(steps),
        constants,
    };
    (CubeBackend::float_cat(results, 0), tape)
}

/// See [`PerceptualStack::backward`].
pub(crate) fn backward(tape: &Tape, grad: CubeTensor, stack: &PerceptualStack) -> CubeTensor {
    let grad = whole(grad);
    let mirrored = stack.border == Border::Mirrored;
    let Tape { constants, steps } = tape;
    let [Some(last), Some(first)] = [steps.last(), steps.first()] else {
        unreachable!("a stack has layers");
    };
    let content = last.output.meta.num_elements();
    let slice = burn::tensor::Slice::from(0..content);
    // Statistics are added in place, so the content's part must not be shared.
    let mut current =
        super::launch::copied(&whole(CubeBackend::float_slice(grad.clone(), &[slice])));
    let mut statistics_at = grad.meta.num_elements();
    for (i, layer) in constants.layers.iter().enumerate().rev() {
        let step = &steps[i];
        if let Some(own) = &step.statistics {
            statistics_at -= 2 * layer.outputs;
            let of = (step.size, layer.outputs);
            statistics::backward((&step.output, own), (&grad, statistics_at), &current, of);
        }
        let mode = Mode {
            inputs: layer.outputs,
            outputs: layer.inputs,
            wider: usize::from(mirrored),
            mirrored: false,
            relu: false,
            masked: true,
        };
        let input = (&current, Some(&step.output));
        current = convolve(input, (&layer.backward, None), step.size, mode);
        // What falls on a mirrored border belongs to the pixels that it mirrors.
        if mirrored {
            current = pixels::fold(&current, step.size, layer.inputs);
        }
        if let (Some(pooled), Some(before)) = (&step.pooled, i.checked_sub(1)) {
            let before = &steps[before];
            let from = (&before.output, before.size);
            current = pixels::pool_backward(from, (pooled, step.size), &current, layer.inputs);
        }
    }
    let scaled = CubeBackend::float_mul_scalar(current, stack.input_scale.into());
    CubeBackend::float_reshape(scaled, [first.size.height, first.size.width, 3].into())
}
