//! One block of rows through all layers and back.

use super::super::math::exp;
use super::super::product::{Left, ProductTarget, Start, product};
use super::{Activation, LayerSpec, MlpSpec};
use pulp::Simd;

const LAYER_NORM_EPS: f32 = 1e-5;

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
        let layers = 0..spec.layers().len();
        packed.transposed = (rows > FEW).then(|| layers.map(|i| packed.transpose(i)).collect());
        packed
    }

    fn transpose(&self, layer: usize) -> Vec<f32> {
        let LayerSpec {
            inputs, outputs, ..
        } = self.spec.layers()[layer];
        let (weight, _) = self.layer(layer);
        let mut transposed = vec![0.0; weight.len()];
        for (o, row) in weight.chunks_exact(inputs).enumerate() {
            for (i, w) in row.iter().enumerate() {
                transposed[i * outputs + o] = *w;
            }
        }
        transposed
    }

    /// Row-major `outputs × inputs` weight, and biases.
    fn layer(&self, layer: usize) -> (&[f32], &[f32]) {
        let LayerSpec {
            inputs, outputs, ..
        } = self.spec.layers()[layer];
        self.params[self.spec.layer_range(layer)].split_at(inputs * outputs)
    }

    /// A block's vector.
    fn shift(&self, block: usize) -> &[f32] {
        &self.params[self.spec.shift_range(block)]
    }
}

/// Where the gradient of a block's input goes, and upon what; nowhere if that is empty.
pub(crate) struct InputGrad<'a>(pub(crate) &'a mut [f32], pub(crate) Start<'a>);

/// One block's activations, kept for the backward pass.
pub(crate) struct Tape {
    /// Output of each layer, `rows × outputs`, before its block's input is added to it.
    outputs: Vec<Vec<f32>>,
    /// Per block, what its first layer sees.
    entries: Vec<Vec<f32>>,
    /// Per block, what comes out.
    sums: Vec<Vec<f32>>,
    /// LayerNorm's output before the activation, empty where a layer has none.
    normalised: Vec<Vec<f32>>,
    /// LayerNorm's `1 / sqrt(var + eps)` per row.
    inverse_std: Vec<Vec<f32>>,
    /// Gradients on their way back, `rows × widest`.
    current: Vec<f32>,
    next: Vec<f32>,
    /// The gradient that goes past a block.
    past: Vec<f32>,
}

impl Tape {
    /// Room for blocks of up to `rows` rows.
    pub(crate) fn new(spec: &MlpSpec, rows: usize) -> Self {
        let room = |l: &LayerSpec, n: usize| vec![0.0; if l.layer_norm { rows * n } else { 0 }];
        let widths = spec.layers().iter().map(|l| l.inputs.max(l.outputs));
        let widest = rows * widths.max().unwrap_or(0);
        let layers = || spec.layers().iter();
        let blocks = || (0..spec.blocks().len()).map(|b| vec![0.0; rows * spec.block_width(b)]);
        Self {
            outputs: layers().map(|l| vec![0.0; rows * l.outputs]).collect(),
            entries: blocks().collect(),
            sums: blocks().collect(),
            normalised: layers().map(|l| room(l, l.outputs)).collect(),
            inverse_std: layers().map(|l| room(l, 1)).collect(),
            current: vec![0.0; widest],
            next: vec![0.0; widest],
            past: vec![0.0; if spec.blocks().is_empty() { 0 } else { widest }],
        }
    }

    /// What came out for the rows that went through last, behind which older ones may lie.
    pub(crate) fn output(&self, spec: &MlpSpec) -> &[f32] {
        after(spec, spec.layers().len() - 1, &self.outputs, &self.sums)
    }

    /// Sends some rows through the layers.
    #[inline(always)]
    pub(crate) fn forward<S: Simd>(&mut self, simd: S, packed: &Packed<'_>, x: &[f32]) {
        let spec = packed.spec;
        let rows = x.len() / spec.inputs();
        for (i, layer) in spec.layers().iter().enumerate() {
            let (before, rest) = self.outputs.split_at_mut(i);
            let mut input = match i {
                0 => x,
                _ => &after(spec, i - 1, before, &self.sums)[..rows * layer.inputs],
            };
            if let Some(block) = spec.block_from(i) {
                let entry = &mut self.entries[block][..input.len()];
                add_to_rows(entry, input, packed.shift(block));
                input = entry;
            }
            let out = &mut rest[0][..rows * layer.outputs];
            let (weight, bias) = packed.layer(i);
            // A product fills whole vectors with neighbouring outputs.
            let transposed = packed.transposed.as_ref().filter(|_| layer.outputs > 1);
            if let Some(transposed) = transposed {
                let input = Left::new(input, rows, layer.inputs);
                let out = ProductTarget::new(out, Start::Row(bias), layer.outputs);
                product(simd, out, input, &transposed[i]);
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
            if let Some(block) = spec.block_to(i) {
                let sums = self.sums[block].iter_mut().zip(&*out);
                for ((sum, out), entry) in sums.zip(&self.entries[block]) {
                    *sum = out + entry;
                }
            }
        }
    }

    /// Gradients for the block that went through last, `x`: adds the parameters' to `params_grad`;
    /// the input's go where [`InputGrad`] says.
    #[inline(always)]
    pub(crate) fn backward<S: Simd>(
        &mut self,
        simd: S,
        packed: &Packed<'_>,
        x: &[f32],
        grad: &[f32],
        params_grad: &mut [f32],
        InputGrad(input_grad, start): InputGrad<'_>,
    ) {
        let spec = packed.spec;
        let rows = x.len() / spec.inputs();
        self.current[..grad.len()].copy_from_slice(grad);
        for (i, layer) in spec.layers().iter().enumerate().rev() {
            if spec.block_to(i).is_some() {
                let through = rows * layer.outputs;
                self.past[..through].copy_from_slice(&self.current[..through]);
            }
            self.before_affine(layer, i, rows);
            let g = &self.current[..rows * layer.outputs];
            let block = spec.block_from(i);
            let input = match (i, block) {
                (0, _) => x,
                (_, Some(block)) => &self.entries[block],
                (_, None) => after(spec, i - 1, &self.outputs, &self.sums),
            };
            let input = &input[..rows * layer.inputs];
            let layer_grad = &mut params_grad[spec.layer_range(i)];
            add_layer_grad(simd, layer, layer_grad, g, input);
            let (target, start) = match i {
                0 if input_grad.is_empty() => continue,
                0 => (&mut *input_grad, start),
                _ => (&mut self.next[..rows * layer.inputs], Start::Zero),
            };
            let (weight, _) = packed.layer(i);
            let g = Left::new(g, rows, layer.outputs);
            let target = ProductTarget::new(target, start, layer.inputs);
            product(simd, target, g, weight);
            if let Some(block) = block {
                let entry_grad = &mut self.next[..rows * layer.inputs];
                let pairs = entry_grad.iter_mut().zip(&self.past);
                pairs.for_each(|(g, past)| *g += past);
                let shift_grad = &mut params_grad[spec.shift_range(block)];
                add_rows(shift_grad, entry_grad);
            }
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

/// What layer `layer` hands on: its output, or the sum that ends its block.
#[inline(always)]
fn after<'a>(
    spec: &MlpSpec,
    layer: usize,
    outputs: &'a [Vec<f32>],
    sums: &'a [Vec<f32>],
) -> &'a [f32] {
    match spec.block_to(layer) {
        Some(block) => &sums[block],
        None => &outputs[layer],
    }
}

/// `out = rows + vector`, for every row.
#[inline(always)]
fn add_to_rows(out: &mut [f32], rows: &[f32], vector: &[f32]) {
    let width = vector.len();
    let rows = rows.chunks_exact(width);
    for (out, row) in out.chunks_exact_mut(width).zip(rows) {
        for ((out, x), v) in out.iter_mut().zip(row).zip(vector) {
            *out = x + v;
        }
    }
}

/// Adds all rows to `sum`.
#[inline(always)]
fn add_rows(sum: &mut [f32], rows: &[f32]) {
    for row in rows.chunks_exact(sum.len()) {
        sum.iter_mut().zip(row).for_each(|(s, x)| *s += x);
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
    let weight = ProductTarget::new(weight, Start::Sum, layer.inputs);
    product(simd, weight, transposed, input);
    add_rows(bias, grad);
}
