//! VGG-19 (Simonyan & Zisserman 2015) to relu4_1, out of a checkpoint.

use super::file::WeightsFile;
use crate::StyleError;
use impasto_kernels::{Border, ConvLayer, OddEnd, PerceptualStack};
use serde::{Deserialize, Serialize};

/// A layer of the network and where checkpoints keep it.
pub(super) struct VggLayer {
    pub name: &'static str,
    pub inputs: usize,
    pub outputs: usize,
    pool_before: bool,
    pub statistics: bool,
    /// Index within torchvision's `features`.
    torchvision: u32,
    /// Index within the style-transfer Sequential, which has paddings of its own and a first 1×1
    /// convolution.
    sequential: u32,
}

/// Name, channels in and out, indices; a block's first layer follows a pool and has statistics.
const fn vgg_layer(
    name: &'static str,
    [inputs, outputs]: [usize; 2],
    [torchvision, sequential]: [u32; 2],
) -> VggLayer {
    let first_of_block = name.as_bytes()[6] == b'1';
    VggLayer {
        name,
        inputs,
        outputs,
        pool_before: first_of_block && inputs > 3,
        statistics: first_of_block,
        torchvision,
        sequential,
    }
}

pub(super) const LAYERS: [VggLayer; 9] = [
    vgg_layer("conv1_1", [3, 64], [0, 2]),
    vgg_layer("conv1_2", [64, 64], [2, 5]),
    vgg_layer("conv2_1", [64, 128], [5, 9]),
    vgg_layer("conv2_2", [128, 128], [7, 12]),
    vgg_layer("conv3_1", [128, 256], [10, 16]),
    vgg_layer("conv3_2", [256, 256], [12, 19]),
    vgg_layer("conv3_3", [256, 256], [14, 22]),
    vgg_layer("conv3_4", [256, 256], [16, 25]),
    vgg_layer("conv4_1", [256, 512], [19, 29]),
];

/// ImageNet's mean colour. The installed network's inputs are `image − MEAN`, RGB, whatever it was
/// made from, so that small weights meet small numbers.
pub(super) const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// How a checkpoint keeps VGG-19.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// torchvision's `features.N.weight`, filters as they were trained.
    Torchvision,
    /// The `Sequential` of style-transfer programs: `0.weight` turns RGB into the trained inputs,
    /// and filters are normalised to a mean activation of 1.
    Normalised,
}

impl Scheme {
    /// How `checkpoint` keeps the network, by its names.
    ///
    /// # Errors
    /// If it has neither scheme's first layer.
    pub fn of(checkpoint: &WeightsFile) -> Result<Self, StyleError> {
        if checkpoint.shape("features.0.weight").is_some() {
            Ok(Self::Torchvision)
        } else if checkpoint.shape("0.weight").is_some() {
            Ok(Self::Normalised)
        } else {
            let names: Vec<&str> = checkpoint.names().take(3).collect();
            let found = if names.is_empty() {
                "no tensor at all".to_owned()
            } else {
                format!("{} …", names.join(", "))
            };
            Err(checkpoint.fault(format!(
                "is no VGG-19: it has neither \"features.0.weight\" (torchvision) nor \"0.weight\" \
                 (normalised for style transfer), but {found}"
            )))
        }
    }

    pub(super) fn key(self, place: &VggLayer) -> String {
        match self {
            Self::Torchvision => format!("features.{}", place.torchvision),
            Self::Normalised => place.sequential.to_string(),
        }
    }
}

/// A layer's filters `[output][input][dy][dx]`.
pub(super) struct LayerWeights {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

/// The network of these filters, with the statistics of the layers that `statistics` picks.
pub(super) fn stack(
    layers: &[LayerWeights],
    statistics: impl Fn(&VggLayer) -> bool,
) -> PerceptualStack {
    let layers = layers.iter().zip(&LAYERS).map(|(layer, place)| {
        let (bias, statistics) = (layer.bias.clone(), statistics(place));
        ConvLayer::new(&layer.weight, bias, place.pool_before, statistics)
    });
    PerceptualStack::new(layers.collect(), 1.0, MEAN)
        .bordered(Border::Mirrored)
        .ending(OddEnd::Kept)
}
