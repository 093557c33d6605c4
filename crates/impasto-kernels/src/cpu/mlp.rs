//! Small multi-layer perceptrons over many rows, block by block.
//!
//! A block's activations stay in cache; the backward pass recomputes them instead of storing
//! them. Weights are data: gradients reach inputs *and* parameters, so that predicted weights
//! (the hypernetwork's output) and learned ones are the same path.

use super::math::exp;
use super::product::{Left, Start, add_product, product};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// What follows a layer's affine map (and its normalisation).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    Linear,
    /// `max(0, x)`.
    Relu,
    /// `1 / (1 + e^-x)`.
    Sigmoid,
}

/// One layer: affine map, optional LayerNorm over channels (eps 1e-5, no affine), activation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayerSpec {
    /// Input channels.
    pub inputs: usize,
    /// Output channels.
    pub outputs: usize,
    /// Whether LayerNorm follows the affine map.
    pub layer_norm: bool,
    /// Final non-linearity.
    pub activation: Activation,
}

impl LayerSpec {
    /// Numbers in this layer: a row-major `outputs × inputs` weight, then `outputs` biases.
    pub fn params(&self) -> usize {
        self.outputs * (self.inputs + 1)
    }
}

/// A chain of layers whose parameters lie one after the other in one flat vector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MlpSpec {
    layers: Vec<LayerSpec>,
}

const LAYER_NORM_EPS: f32 = 1e-5;
/// Rows a block: a layer's activations of width 64 are half of a first-level cache.
const BLOCK: usize = 64;
/// Rows of one task of a forward pass.
const TASK: usize = 1024;
/// Most pieces the rows are cut into for parameter gradients; fixed, so that sums do not depend
/// on the number of threads.
const PIECES: usize = 8;

impl MlpSpec {
    /// Chains `layers`.
    ///
    /// # Panics
    /// If there is no layer or neighbouring widths differ: specifications are program constants.
    pub fn new(layers: Vec<LayerSpec>) -> Self {
        assert!(!layers.is_empty(), "an MLP has at least one layer");
        for pair in layers.windows(2) {
            assert_eq!(
                pair[0].outputs, pair[1].inputs,
                "widths of neighbouring layers"
            );
        }
        Self { layers }
    }

    /// Hidden layers with relu, a last layer with `output`, widths given from input to output.
    pub fn relu(widths: &[usize], layer_norm: bool, output: Activation) -> Self {
        let last = widths.len().saturating_sub(2);
        Self::new(
            widths
                .windows(2)
                .enumerate()
                .map(|(i, w)| LayerSpec {
                    inputs: w[0],
                    outputs: w[1],
                    layer_norm: layer_norm && i < last,
                    activation: if i < last { Activation::Relu } else { output },
                })
                .collect(),
        )
    }

    /// The layers in order.
    pub fn layers(&self) -> &[LayerSpec] {
        &self.layers
    }

    /// Input channels.
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Output channels.
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Length of the flat parameter vector.
    pub fn params(&self) -> usize {
        self.layers.iter().map(LayerSpec::params).sum()
    }
}

/// Parameters in the order that products read them: per layer a row-major `inputs × outputs`
/// weight; biases as they are.
pub(crate) struct Packed<'a> {
    pub(crate) spec: &'a MlpSpec,
    params: &'a [f32],
    /// One per layer; none for [`FEW`] rows.
    transposed: Option<Vec<Vec<f32>>>,
}

/// For no more rows than this, rearranging the weights costs more than it saves.
const FEW: usize = 4;

impl<'a> Packed<'a> {
    /// Parameters for `rows` rows in all.
    pub(crate) fn new(spec: &'a MlpSpec, params: &'a [f32], rows: usize) -> Self {
        assert_eq!(params.len(), spec.params(), "parameters of an MLP");
        let mut packed = Self {
            spec,
            params,
            transposed: None,
        };
        let layers = 0..spec.layers.len();
        packed.transposed = (rows > FEW).then(|| layers.map(|i| packed.transpose(i)).collect());
        packed
    }

    fn transpose(&self, layer: usize) -> Vec<f32> {
        let LayerSpec {
            inputs, outputs, ..
        } = self.spec.layers[layer];
        let (weight, _) = self.layer(layer);
        let mut transposed = vec![0.0; weight.len()];
        for (o, row) in weight.chunks_exact(inputs).enumerate() {
            for (i, w) in row.iter().enumerate() {
                transposed[i * outputs + o] = *w;
            }
        }
        transposed
    }

    /// Where a layer's parameters lie.
    fn range(&self, layer: usize) -> std::ops::Range<usize> {
        let before = &self.spec.layers[..layer];
        let start = before.iter().map(LayerSpec::params).sum::<usize>();
        start..start + self.spec.layers[layer].params()
    }

    /// Row-major `outputs × inputs` weight, and biases.
    fn layer(&self, layer: usize) -> (&[f32], &[f32]) {
        let LayerSpec {
            inputs, outputs, ..
        } = self.spec.layers[layer];
        self.params[self.range(layer)].split_at(inputs * outputs)
    }
}

/// One block's activations, kept for the backward pass.
pub(crate) struct Tape {
    /// Output of each layer, `rows × outputs`.
    outputs: Vec<Vec<f32>>,
    /// LayerNorm's output before the activation, empty where a layer has none.
    normalised: Vec<Vec<f32>>,
    /// LayerNorm's `1 / sqrt(var + eps)` per row.
    inverse_std: Vec<Vec<f32>>,
    /// Gradients on their way back, `rows × widest`.
    current: Vec<f32>,
    next: Vec<f32>,
}

impl Tape {
    /// Room for blocks of up to `rows` rows.
    pub(crate) fn new(spec: &MlpSpec, rows: usize) -> Self {
        let room = |l: &LayerSpec, n: usize| vec![0.0; if l.layer_norm { rows * n } else { 0 }];
        let widths = spec.layers.iter().map(|l| l.inputs.max(l.outputs));
        let widest = rows * widths.max().unwrap_or(0);
        let layers = || spec.layers.iter();
        Self {
            outputs: layers().map(|l| vec![0.0; rows * l.outputs]).collect(),
            normalised: layers().map(|l| room(l, l.outputs)).collect(),
            inverse_std: layers().map(|l| room(l, 1)).collect(),
            current: vec![0.0; widest],
            next: vec![0.0; widest],
        }
    }

    /// The last layer's output for the block that went through last, behind which older ones may
    /// lie.
    pub(crate) fn output(&self) -> &[f32] {
        &self.outputs[self.outputs.len() - 1]
    }

    /// Sends a block of rows through the layers.
    #[inline(always)]
    pub(crate) fn forward<S: Simd>(&mut self, simd: S, packed: &Packed<'_>, x: &[f32]) {
        let rows = x.len() / packed.spec.inputs();
        for (i, layer) in packed.spec.layers.iter().enumerate() {
            let (before, rest) = self.outputs.split_at_mut(i);
            let input = if i == 0 {
                x
            } else {
                &before[i - 1][..rows * layer.inputs]
            };
            let out = &mut rest[0][..rows * layer.outputs];
            let (weight, bias) = packed.layer(i);
            if let Some(transposed) = &packed.transposed {
                let input = Left::new(input, rows, layer.inputs);
                let out = (&mut *out, Start::Row(bias), layer.outputs);
                product(simd, out, input, &transposed[i], layer.outputs);
            } else {
                let rows = out.chunks_exact_mut(layer.outputs);
                for (out, x) in rows.zip(input.chunks_exact(layer.inputs)) {
                    let weights = weight.chunks_exact(layer.inputs);
                    for ((out, bias), weight) in out.iter_mut().zip(bias).zip(weights) {
                        *out = bias + lane_sum(weight, x, |w, x| w * x);
                    }
                }
            }
            if layer.layer_norm {
                normalise(out, layer.outputs, &mut self.inverse_std[i]);
                self.normalised[i][..out.len()].copy_from_slice(out);
            }
            activate(out, layer.activation);
        }
    }

    /// Gradients for the block that went through last: adds the parameters' to `params_grad`;
    /// the input's go to `input_grad`, upon its `start`, unless that is empty.
    #[inline(always)]
    pub(crate) fn backward<S: Simd>(
        &mut self,
        simd: S,
        packed: &Packed<'_>,
        (x, grad): (&[f32], &[f32]),
        params_grad: &mut [f32],
        (input_grad, start): (&mut [f32], Start<'_>),
    ) {
        let spec = packed.spec;
        let rows = x.len() / spec.inputs();
        self.current[..grad.len()].copy_from_slice(grad);
        for (i, layer) in spec.layers.iter().enumerate().rev() {
            self.before_affine(layer, i, rows);
            let g = &self.current[..rows * layer.outputs];
            let input = match i {
                0 => x,
                _ => &self.outputs[i - 1][..rows * layer.inputs],
            };
            add_layer_grad(simd, layer, &mut params_grad[packed.range(i)], g, input);
            let (target, start) = match i {
                0 if input_grad.is_empty() => continue,
                0 => (&mut *input_grad, start),
                _ => (&mut self.next[..rows * layer.inputs], Start::Zero),
            };
            let (weight, _) = packed.layer(i);
            let g = Left::new(g, rows, layer.outputs);
            let target = (target, start, layer.inputs);
            product(simd, target, g, weight, layer.inputs);
            std::mem::swap(&mut self.current, &mut self.next);
        }
    }

    /// Turns the current gradient (with respect to layer `i`'s output) into the one before its
    /// affine map.
    #[inline(always)]
    fn before_affine(&mut self, layer: &LayerSpec, i: usize, rows: usize) {
        let grad = &mut self.current[..rows * layer.outputs];
        let out = &self.outputs[i];
        match layer.activation {
            Activation::Linear => {}
            Activation::Relu => {
                for (g, y) in grad.iter_mut().zip(out) {
                    *g = if *y > 0.0 { *g } else { 0.0 };
                }
            }
            Activation::Sigmoid => {
                for (g, y) in grad.iter_mut().zip(out) {
                    *g *= y * (1.0 - y);
                }
            }
        }
        if layer.layer_norm {
            let n = layer.outputs;
            let rows = grad
                .chunks_exact_mut(n)
                .zip(self.normalised[i].chunks_exact(n));
            for ((g, y), inverse_std) in rows.zip(&self.inverse_std[i]) {
                let mean = lane_sum(g, y, |g, _| g) / n as f32;
                let along = lane_sum(g, y, |g, y| g * y) / n as f32;
                for (g, y) in g.iter_mut().zip(y) {
                    *g = inverse_std * (*g - mean - y * along);
                }
            }
        }
    }
}

/// `Σ f(aᵢ, bᵢ)` in 16 interleaved partial sums: a single running sum would have to be added in
/// order, one number at a time.
#[inline(always)]
fn lane_sum(a: &[f32], b: &[f32], f: impl Fn(f32, f32) -> f32) -> f32 {
    const LANES: usize = 16;
    let mut lanes = [0f32; LANES];
    let (a_lanes, a_rest) = a.as_chunks::<LANES>();
    let (b_lanes, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a_lanes.iter().zip(b_lanes) {
        for lane in 0..LANES {
            lanes[lane] += f(a[lane], b[lane]);
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| f(*a, *b)).sum();
    lanes.iter().sum::<f32>() + rest
}

#[inline(always)]
fn normalise(rows: &mut [f32], width: usize, inverse_std: &mut [f32]) {
    for (row, inv) in rows.chunks_exact_mut(width).zip(inverse_std) {
        let mean = lane_sum(row, row, |v, _| v) / width as f32;
        let var = lane_sum(row, row, |v, _| (v - mean) * (v - mean)) / width as f32;
        *inv = (var + LAYER_NORM_EPS).sqrt().recip();
        for v in row {
            *v = (*v - mean) * *inv;
        }
    }
}

#[inline(always)]
fn activate(values: &mut [f32], activation: Activation) {
    match activation {
        Activation::Linear => {}
        // Not `max`, which would turn NaN into 0 and hide a broken input.
        Activation::Relu => values
            .iter_mut()
            .for_each(|v| *v = if *v < 0.0 { 0.0 } else { *v }),
        Activation::Sigmoid => values.iter_mut().for_each(|v| *v = 1.0 / (1.0 + exp(-*v))),
    }
}

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
            out.copy_from_slice(&tape.output()[..out.len()]);
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
        for (sum, p) in params_grad.iter_mut().zip(part) {
            *sum += p;
        }
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
            let input_grad = (input_grads.next().unwrap_or_default(), Start::Zero);
            tape.backward(simd, self.packed, (x, grad), &mut params_grad, input_grad);
        }
        params_grad
    }
}

/// Adds a block's part of a layer's gradient: weight, then bias.
#[inline(always)]
fn add_layer_grad<S: Simd>(
    simd: S,
    layer: &LayerSpec,
    layer_grad: &mut [f32],
    grad: &[f32],
    input: &[f32],
) {
    let rows = grad.len() / layer.outputs;
    let (weight, bias) = layer_grad.split_at_mut(layer.inputs * layer.outputs);
    let transposed = Left::transposed(grad, rows, layer.outputs);
    add_product(simd, weight, transposed, input, layer.inputs);
    for row in grad.chunks_exact(layer.outputs) {
        for (b, g) in bias.iter_mut().zip(row) {
            *b += g;
        }
    }
}
