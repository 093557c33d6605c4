//! Networks whose layers share one flat weight vector: `base` as a plain chain or as the paper's
//! residual trunk, `app` with or without the paper's linear first layer (PAPER §2).

use burn::tensor::Tensor;
use impasto_kernels::{Activation, LayerSpec, MlpSpec, ops};

/// Layers of `base`: a first chain, then blocks `h ← B(g) + g` with `g = h + Z z`, where `z` is a
/// learned vector and `Z` linear. Without blocks it is a plain chain.
///
/// Parameters lie in the order: first chain, blocks, `Z`s.
#[derive(Debug, Clone)]
pub struct Trunk {
    first: MlpSpec,
    blocks: Vec<MlpSpec>,
    shifts: Vec<MlpSpec>,
}

impl Trunk {
    /// Relu layers of the given widths, input first, features included.
    pub fn plain(widths: &[usize]) -> Self {
        Self {
            first: MlpSpec::relu(widths, false, Activation::Relu),
            blocks: Vec::new(),
            shifts: Vec::new(),
        }
    }

    /// One layer from `inputs` to `width`, then `blocks` of two layers, each after a part of a
    /// vector of `latent` numbers.
    pub fn residual(inputs: usize, width: usize, blocks: usize, latent: usize) -> Self {
        let block = MlpSpec::relu(&[width, width, width], false, Activation::Relu);
        let shift = MlpSpec::relu(&[latent, width], false, Activation::Linear);
        Self {
            first: MlpSpec::relu(&[inputs, width], false, Activation::Relu),
            blocks: vec![block; blocks],
            shifts: vec![shift; blocks],
        }
    }

    /// The chain of layers, where that is all there is.
    pub fn chain(&self) -> Option<&MlpSpec> {
        self.blocks.is_empty().then_some(&self.first)
    }

    /// All parts in the order of their parameters.
    pub fn parts(&self) -> impl Iterator<Item = &MlpSpec> {
        let rest = self.blocks.iter().chain(&self.shifts);
        std::iter::once(&self.first).chain(rest)
    }

    /// Length of the weight vector.
    pub fn params(&self) -> usize {
        self.parts().map(MlpSpec::params).sum()
    }

    /// Features of encoded positions.
    ///
    /// # Shapes
    /// `encoded`: `[n, inputs]`; `weights`: [`Self::params`]; `latent`: the learned vector, which
    /// a plain chain ignores and without which blocks get none; result: `[n, features]`.
    pub fn forward(
        &self,
        encoded: Tensor<2>,
        weights: &Tensor<1>,
        latent: Option<&Tensor<1>>,
    ) -> Tensor<2> {
        let mut split = Split::new(weights);
        let mut features = ops::mlp(encoded, split.take(&self.first), &self.first);
        let blocks: Vec<_> = self.blocks.iter().map(|b| split.take(b)).collect();
        for ((block, weights), shift) in self.blocks.iter().zip(blocks).zip(&self.shifts) {
            let shifted = shifted(features, &mut split, shift, latent);
            features = ops::mlp(shifted.clone(), weights, block) + shifted;
        }
        features
    }
}

/// Layers of `app`: from features, optionally through a linear layer as wide as they are and
/// shifted by `Z z`, then, joined by what else there is to know of a sample, to a colour.
///
/// Parameters lie in the order: linear layer, the chain to the colour, `Z`.
#[derive(Debug, Clone)]
pub struct AppNetwork {
    pub(crate) remap: Option<MlpSpec>,
    pub(crate) chain: MlpSpec,
    pub(crate) shift: Option<MlpSpec>,
}

impl AppNetwork {
    /// The chain of layers from features and all else, where that is all there is.
    pub fn chain(&self) -> Option<&MlpSpec> {
        self.remap.is_none().then_some(&self.chain)
    }

    /// All parts in the order of their parameters.
    pub fn parts(&self) -> impl Iterator<Item = &MlpSpec> {
        self.remap.iter().chain([&self.chain]).chain(&self.shift)
    }

    /// All layers in the order of their parameters: what a hypernetwork predicts one by one.
    pub fn layers(&self) -> impl Iterator<Item = &LayerSpec> {
        self.parts().flat_map(MlpSpec::layers)
    }

    /// Length of the weight vector.
    pub fn params(&self) -> usize {
        self.parts().map(MlpSpec::params).sum()
    }

    /// Colours in `(0, 1)`.
    ///
    /// # Shapes
    /// `features`: `[n, f]`; `others`: further inputs, `[n, …]` each; `weights`: [`Self::params`];
    /// `latent`: the learned vector; result: `[n, 3]`.
    pub fn forward(
        &self,
        features: Tensor<2>,
        others: Vec<Tensor<2>>,
        weights: &Tensor<1>,
        latent: Option<&Tensor<1>>,
    ) -> Tensor<2> {
        let mut split = Split::new(weights);
        let mut inputs = match &self.remap {
            Some(remap) => vec![ops::mlp(features, split.take(remap), remap)],
            None => vec![features],
        };
        let chain = split.take(&self.chain);
        if let Some(shift) = &self.shift {
            inputs = inputs
                .into_iter()
                .map(|f| shifted(f, &mut split, shift, latent))
                .collect();
        }
        inputs.extend(others);
        let input = match inputs.len() {
            1 => inputs.remove(0),
            _ => Tensor::cat(inputs, 1),
        };
        ops::mlp(input, chain, &self.chain)
    }
}

/// `features + Z z` for every row.
fn shifted(
    features: Tensor<2>,
    split: &mut Split<'_>,
    shift: &MlpSpec,
    latent: Option<&Tensor<1>>,
) -> Tensor<2> {
    let weights = split.take(shift);
    match latent {
        Some(z) => features + ops::mlp(z.clone().unsqueeze(), weights, shift),
        None => features,
    }
}

/// A flat weight vector, part by part.
struct Split<'a> {
    weights: &'a Tensor<1>,
    at: usize,
}

impl<'a> Split<'a> {
    fn new(weights: &'a Tensor<1>) -> Self {
        Self { weights, at: 0 }
    }

    fn take(&mut self, spec: &MlpSpec) -> Tensor<1> {
        let start = self.at;
        self.at += spec.params();
        if start == 0 && self.at == self.weights.dims()[0] {
            return self.weights.clone();
        }
        self.weights.clone().slice_dim(0, start..self.at)
    }
}
