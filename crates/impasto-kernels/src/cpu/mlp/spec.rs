//! What an MLP looks like.

use std::ops::Range;

/// What follows a layer's affine map (and its normalisation).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
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

/// A chain of layers, some of which may form residual blocks `x ↦ f(x + s) + (x + s)`, with a
/// learned vector `s` per block.
///
/// Parameters lie in one flat vector: all layers in order, then the blocks' vectors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MlpSpec {
    layers: Vec<LayerSpec>,
    blocks: Vec<Range<usize>>,
}

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
        Self {
            layers,
            blocks: Vec::new(),
        }
    }

    /// Makes ranges of layers residual blocks.
    ///
    /// # Panics
    /// If a block has no layer, begins with the very first one, overlaps its predecessor or ends
    /// with another width than it starts with.
    #[must_use]
    pub fn with_blocks(self, blocks: Vec<Range<usize>>) -> Self {
        let mut end = 1;
        for block in &blocks {
            assert!(
                end <= block.start && block.start < block.end && block.end <= self.layers.len(),
                "residual blocks are ranges of layers behind the first one, in order"
            );
            assert_eq!(
                self.layers[block.start].inputs,
                self.layers[block.end - 1].outputs,
                "widths at both ends of a residual block"
            );
            end = block.end;
        }
        Self { blocks, ..self }
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

    /// The residual blocks, as ranges of layers, in order.
    pub fn blocks(&self) -> &[Range<usize>] {
        &self.blocks
    }

    /// Width of a block.
    pub(crate) fn block_width(&self, block: usize) -> usize {
        self.layers[self.blocks[block].start].inputs
    }

    /// The block that begins with a layer.
    pub(crate) fn block_from(&self, layer: usize) -> Option<usize> {
        self.blocks.iter().position(|block| block.start == layer)
    }

    /// The block that ends with a layer.
    pub(crate) fn block_to(&self, layer: usize) -> Option<usize> {
        self.blocks.iter().position(|block| block.end == layer + 1)
    }

    /// Where a layer's parameters lie.
    pub(crate) fn layer_range(&self, layer: usize) -> Range<usize> {
        let before = &self.layers[..layer];
        let start = before.iter().map(LayerSpec::params).sum::<usize>();
        start..start + self.layers[layer].params()
    }

    /// Where a block's vector lies.
    pub(crate) fn shift_range(&self, block: usize) -> Range<usize> {
        let layers: usize = self.layers.iter().map(LayerSpec::params).sum();
        let before: usize = (0..block).map(|b| self.block_width(b)).sum();
        layers + before..layers + before + self.block_width(block)
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
        let layers: usize = self.layers.iter().map(LayerSpec::params).sum();
        let blocks = 0..self.blocks.len();
        layers + blocks.map(|b| self.block_width(b)).sum::<usize>()
    }
}
