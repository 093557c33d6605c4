//! Networks whose layers share one flat weight vector: `base` as a plain chain or as the paper's
//! residual trunk, `app` with or without the paper's linear first layer (PAPER §2).
//!
//! What is linear and the same for all samples is folded into one chain of layers before any
//! sample is looked at: learned vectors become a vector per block, and two linear maps in a row
//! become one. The function and its gradients stay the same; a third of `app`'s work goes.

use burn::tensor::Tensor;
use impasto_kernels::{Activation, LayerSpec, MlpSpec, ops};

/// Layers of `base`: a first chain, then blocks `h ← B(g) + g` with `g = h + Z z`, where `z` is a
/// learned vector and `Z` linear. Without blocks it is a plain chain.
///
/// Parameters lie in the order: first chain, blocks, `Z`s.
#[derive(Debug, Clone)]
pub struct Trunk {
    chain: MlpSpec,
    shifts: Vec<MlpSpec>,
}

impl Trunk {
    /// Relu layers of the given widths, input first, features included.
    pub fn plain(widths: &[usize]) -> Self {
        Self {
            chain: MlpSpec::relu(widths, false, Activation::Relu),
            shifts: Vec::new(),
        }
    }

    /// One layer from `inputs` to `width`, then `blocks` of two layers, each after a part of a
    /// vector of `latent` numbers.
    pub fn residual(inputs: usize, width: usize, blocks: usize, latent: usize) -> Self {
        let mut widths = vec![inputs, width];
        widths.extend(std::iter::repeat_n(width, 2 * blocks));
        let chain = MlpSpec::relu(&widths, false, Activation::Relu);
        let shift = MlpSpec::relu(&[latent, width], false, Activation::Linear);
        Self {
            chain: chain.with_blocks((0..blocks).map(|b| 2 * b + 1..2 * b + 3).collect()),
            shifts: vec![shift; blocks],
        }
    }

    /// The chain of layers that samples go through, with [`Self::folded`] weights.
    pub fn chain(&self) -> &MlpSpec {
        &self.chain
    }

    /// All layers in the order of their parameters.
    pub fn layers(&self) -> impl Iterator<Item = &LayerSpec> {
        let shifts = self.shifts.iter().flat_map(MlpSpec::layers);
        self.chain.layers().iter().chain(shifts)
    }

    /// Length of the weight vector.
    pub fn params(&self) -> usize {
        self.layers().map(LayerSpec::params).sum()
    }

    /// Weights of [`Self::chain`].
    ///
    /// # Shapes
    /// `weights`: [`Self::params`]; `latent`: the learned vector, which a plain chain ignores and
    /// without which blocks get none.
    pub fn folded(&self, weights: &Tensor<1>, latent: Option<&Tensor<1>>) -> Tensor<1> {
        if self.shifts.is_empty() {
            return weights.clone();
        }
        let layers = self.chain.layers().iter().map(LayerSpec::params).sum();
        let mut split = Split { weights, at: 0 };
        let mut parts = vec![split.take(layers)];
        for shift in &self.shifts {
            parts.push(shifted(split.take(shift.params()), shift, latent));
        }
        Tensor::cat(parts, 0)
    }

    /// Features of encoded positions.
    ///
    /// # Shapes
    /// `encoded`: `[n, inputs]`; `weights` and `latent`: as of [`Self::folded`]; result:
    /// `[n, features]`.
    pub fn forward(
        &self,
        encoded: Tensor<2>,
        weights: &Tensor<1>,
        latent: Option<&Tensor<1>>,
    ) -> Tensor<2> {
        ops::mlp(encoded, self.folded(weights, latent), &self.chain)
    }
}

/// Layers of `app`: from features, optionally through a linear layer as wide as they are and
/// shifted by `Z z`, then, joined by what else there is to know of a sample, to a colour.
///
/// Parameters lie in the order: linear layer, the chain to the colour, `Z`.
#[derive(Debug, Clone)]
pub struct AppNetwork {
    pub(crate) features: usize,
    pub(crate) remap: Option<MlpSpec>,
    pub(crate) chain: MlpSpec,
    pub(crate) shift: Option<MlpSpec>,
}

impl AppNetwork {
    /// The chain of layers that samples go through, with [`Self::folded`] weights: from features
    /// and all else to colour.
    pub fn chain(&self) -> &MlpSpec {
        &self.chain
    }

    /// All layers in the order of their parameters: what a hypernetwork predicts one by one.
    pub fn layers(&self) -> impl Iterator<Item = &LayerSpec> {
        let parts = self.remap.iter().chain([&self.chain]).chain(&self.shift);
        parts.flat_map(MlpSpec::layers)
    }

    /// Length of the weight vector.
    pub fn params(&self) -> usize {
        self.layers().map(LayerSpec::params).sum()
    }

    /// Weights of [`Self::chain`].
    ///
    /// # Shapes
    /// `weights`: [`Self::params`]; `latent`: the learned vector.
    pub fn folded(&self, weights: &Tensor<1>, latent: Option<&Tensor<1>>) -> Tensor<1> {
        if self.remap.is_none() && self.shift.is_none() {
            return weights.clone();
        }
        let width = self.features;
        let mut split = Split { weights, at: 0 };
        let remap = self.remap.as_ref().map(|_| {
            let map = split.take(width * width).reshape([width, width]);
            (map, split.take(width))
        });
        let LayerSpec {
            inputs, outputs, ..
        } = self.chain.layers()[0];
        let first = split.take(inputs * outputs).reshape([outputs, inputs]);
        let bias = split.take(outputs);
        let rest = split.take(self.chain.params() - (inputs + 1) * outputs);
        let of_features = first.clone().slice_dim(1, 0..width);
        let shift = self.shift.as_ref();
        let shift = shift.map(|spec| shifted(split.take(spec.params()), spec, latent));
        // What is added to the features before the chain.
        let (map, added) = match (remap, shift) {
            (Some((map, bias)), Some(shift)) => (Some(map), bias + shift),
            (Some((map, bias)), None) => (Some(map), bias),
            (None, Some(shift)) => (None, shift),
            (None, None) => return weights.clone(),
        };
        let added = of_features.clone().matmul(added.unsqueeze_dim(1));
        let bias = bias + added.squeeze_dim(1);
        let of_features = match map {
            Some(map) => of_features.matmul(map),
            None => of_features,
        };
        let others = (width < inputs).then(|| first.slice_dim(1, width..inputs));
        let first = Tensor::cat([of_features].into_iter().chain(others).collect(), 1);
        Tensor::cat(vec![first.reshape([inputs * outputs]), bias, rest], 0)
    }

    /// Colours in `(0, 1)`, or `known` ones with the gradients that computing them would have.
    ///
    /// # Shapes
    /// `inputs`: features and what joins them, `[n, …]` each; `weights`: as of [`Self::folded`];
    /// result and `known`: `[n, 3]`.
    pub fn forward(
        &self,
        mut inputs: Vec<Tensor<2>>,
        weights: Tensor<1>,
        known: Option<Tensor<2>>,
    ) -> Tensor<2> {
        let input = match inputs.len() {
            1 => inputs.remove(0),
            _ => Tensor::cat(inputs, 1),
        };
        match known {
            Some(colours) => ops::mlp_again(input, weights, &self.chain, colours),
            None => ops::mlp(input, weights, &self.chain),
        }
    }
}

/// `Z z`, or zeros without a vector.
fn shifted(weights: Tensor<1>, spec: &MlpSpec, latent: Option<&Tensor<1>>) -> Tensor<1> {
    match latent {
        Some(z) => ops::mlp(z.clone().unsqueeze(), weights, spec).squeeze_dim(0),
        None => Tensor::zeros([spec.outputs()], &weights.device()),
    }
}

/// A flat weight vector, part by part.
struct Split<'a> {
    weights: &'a Tensor<1>,
    at: usize,
}

impl Split<'_> {
    fn take(&mut self, length: usize) -> Tensor<1> {
        let start = self.at;
        self.at += length;
        self.weights.clone().slice_dim(0, start..self.at)
    }
}
