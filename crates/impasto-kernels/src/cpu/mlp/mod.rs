//! Small multi-layer perceptrons over many rows, block by block.
//!
//! A block's activations stay in cache; the backward pass recomputes them instead of storing
//! them. Weights are data: gradients reach inputs *and* parameters, so that predicted weights
//! (the hypernetwork's output) and learned ones are the same path.

mod spec;
mod tape;

pub use spec::{Activation, LayerSpec, MlpSpec};
pub(crate) use tape::{InputGrad, Packed, Tape};

use super::product::Start;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Rows a block: a layer's activations of width 64 are half of a first-level cache.
const BLOCK: usize = 64;
/// Rows of one task of a forward pass.
const TASK: usize = 1024;
/// Most pieces the rows are cut into for parameter gradients; fixed, so that sums do not depend
/// on the number of threads.
const PIECES: usize = 8;

/// Applies the MLP to every row of `x`.
///
/// # Shapes
/// `x`: `rows × inputs`; `params`: `spec.params()`; result: `rows × outputs`.
///
/// # Panics
/// If a slice does not have its stated length.
pub fn forward(spec: &MlpSpec, x: &[f32], params: &[f32]) -> Vec<f32> {
    let (inputs, outputs) = (spec.inputs(), spec.outputs());
    assert_eq!(x.len() % inputs, 0, "rows of an MLP's input");
    let mut out = vec![0.0; x.len() / inputs * outputs];
    let packed = &Packed::new(spec, params, x.len() / inputs);
    out.par_chunks_mut(TASK * outputs)
        .zip(x.par_chunks(TASK * inputs))
        .for_each(|(out, x)| Arch::new().dispatch(Forward { packed, x, out }));
    out
}

struct Forward<'a> {
    packed: &'a Packed<'a>,
    x: &'a [f32],
    out: &'a mut [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let spec = self.packed.spec;
        let (inputs, outputs) = (spec.inputs(), spec.outputs());
        let mut tape = Tape::new(spec, BLOCK.min(self.x.len() / inputs));
        let blocks = self.x.chunks(BLOCK * inputs);
        for (x, out) in blocks.zip(self.out.chunks_mut(BLOCK * outputs)) {
            tape.forward(simd, self.packed, x);
            out.copy_from_slice(&tape.output(spec)[..out.len()]);
        }
    }
}

/// Gradients of [`forward`] for its input (empty unless `need_input`) and its parameters.
///
/// # Shapes
/// `grad`: `rows × outputs`; results: `rows × inputs` and `spec.params()`.
pub fn backward(
    spec: &MlpSpec,
    x: &[f32],
    params: &[f32],
    grad: &[f32],
    need_input: bool,
) -> (Vec<f32>, Vec<f32>) {
    let (inputs, outputs) = (spec.inputs(), spec.outputs());
    let rows = x.len() / inputs;
    assert_eq!(grad.len(), rows * outputs, "gradient of an MLP's output");
    let piece = rows.div_ceil(PIECES).next_multiple_of(BLOCK).max(BLOCK);
    let mut input_grad = vec![0.0; if need_input { x.len() } else { 0 }];
    let mut input_pieces: Vec<&mut [f32]> = input_grad.chunks_mut(piece * inputs).collect();
    input_pieces.resize_with(rows.div_ceil(piece), Default::default);

    let packed = &Packed::new(spec, params, rows);
    let partial: Vec<Vec<f32>> = x
        .par_chunks(piece * inputs)
        .zip(grad.par_chunks(piece * outputs))
        .zip(input_pieces)
        .map(|((x, grad), input_grad)| {
            Arch::new().dispatch(PieceBackward {
                packed,
                x,
                grad,
                input_grad,
            })
        })
        .collect();
    let mut params_grad = vec![0.0; params.len()];
    for part in partial {
        params_grad.iter_mut().zip(part).for_each(|(s, p)| *s += p);
    }
    (input_grad, params_grad)
}

/// Returns the parameters' gradient; writes the input's, unless that is empty.
struct PieceBackward<'a> {
    packed: &'a Packed<'a>,
    x: &'a [f32],
    grad: &'a [f32],
    input_grad: &'a mut [f32],
}

impl WithSimd for PieceBackward<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let spec = self.packed.spec;
        let (inputs, outputs) = (spec.inputs(), spec.outputs());
        let mut tape = Tape::new(spec, BLOCK.min(self.x.len() / inputs));
        let mut params_grad = vec![0.0; spec.params()];
        let mut input_grads = self.input_grad.chunks_mut(BLOCK * inputs);
        let grads = self.grad.chunks(BLOCK * outputs);
        for (x, grad) in self.x.chunks(BLOCK * inputs).zip(grads) {
            tape.forward(simd, self.packed, x);
            let input_grad = InputGrad(input_grads.next().unwrap_or_default(), Start::Zero);
            tape.backward(simd, self.packed, x, grad, &mut params_grad, input_grad);
        }
        params_grad
    }
}
