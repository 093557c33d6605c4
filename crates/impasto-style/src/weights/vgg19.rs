//! VGG-19 (Simonyan & Zisserman 2015) to relu4_1, out of a checkpoint.

use super::checkpoint::Checkpoint;
use super::installed::{Vgg19Facts, write};
use crate::perceptual::rescale;
use crate::{StyleError, picture};
use image::RgbImage;
use impasto_kernels::{Border, ConvLayer, OddEnd, PerceptualStack};
use serde::{Deserialize, Serialize};

/// A layer of the network and where checkpoints keep it.
pub(super) struct Place {
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
const fn place(
    name: &'static str,
    [inputs, outputs]: [usize; 2],
    [torchvision, sequential]: [u32; 2],
) -> Place {
    let first_of_block = name.as_bytes()[6] == b'1';
    Place {
        name,
        inputs,
        outputs,
        pool_before: first_of_block && inputs > 3,
        statistics: first_of_block,
        torchvision,
        sequential,
    }
}

pub(super) const PLACES: [Place; 9] = [
    place("conv1_1", [3, 64], [0, 2]),
    place("conv1_2", [64, 64], [2, 5]),
    place("conv2_1", [64, 128], [5, 9]),
    place("conv2_2", [128, 128], [7, 12]),
    place("conv3_1", [128, 256], [10, 16]),
    place("conv3_2", [256, 256], [12, 19]),
    place("conv3_3", [256, 256], [14, 22]),
    place("conv3_4", [256, 256], [16, 25]),
    place("conv4_1", [256, 512], [19, 29]),
];

/// Torchvision's inputs are `(image − MEAN) / DEVIATION`, RGB. The installed network's are
/// `image − MEAN` whatever it was made from, so that small weights meet small numbers.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Filters that hardly fire would get absurd scales: a mean below this part of its layer's average
/// counts as this part.
const LEAST_SHARE: f32 = 0.01;

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
    pub fn of(checkpoint: &Checkpoint) -> Result<Self, StyleError> {
        if checkpoint.shape("features.0.weight").is_some() {
            Ok(Self::Torchvision)
        } else if checkpoint.shape("0.weight").is_some() {
            Ok(Self::Normalised)
        } else {
            let names: Vec<&str> = checkpoint.names().take(3).collect();
            let found = match names.is_empty() {
                true => "no tensor at all".to_owned(),
                false => format!("{} …", names.join(", ")),
            };
            Err(checkpoint.fault(format!(
                "is no VGG-19: it has neither \"features.0.weight\" (torchvision) nor \"0.weight\" \
                 (normalised for style transfer), but {found}"
            )))
        }
    }

    fn key(self, place: &Place) -> String {
        match self {
            Self::Torchvision => format!("features.{}", place.torchvision),
            Self::Normalised => place.sequential.to_string(),
        }
    }
}

/// A layer's filters `[output][input][dy][dx]`.
pub(super) struct Layer {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

/// Makes the file that [`Perceptual::vgg19`](crate::Perceptual::vgg19) reads: conv1_1 to conv4_1 with every filter rescaled so
/// that its mean activation over natural images is 1 (Gatys et al. 2016), in half precision.
///
/// Activations are measured over `pictures`, each with the same weight. Checkpoints that are
/// normalised already are only converted.
///
/// # Errors
/// If the checkpoint lacks a layer or has it in another shape, a layer never fires, a number does
/// not fit half precision, or a picture is smaller than 9 pixels a side.
pub fn normalise(
    checkpoint: &mut Checkpoint,
    pictures: &[RgbImage],
) -> Result<(Vec<u8>, Vgg19Facts), StyleError> {
    let scheme = Scheme::of(checkpoint)?;
    let mut layers = PLACES
        .iter()
        .map(|place| read_layer(checkpoint, scheme, place))
        .collect::<Result<Vec<_>, _>>()?;
    match scheme {
        Scheme::Torchvision => {
            for (i, w) in layers[0].weight.iter_mut().enumerate() {
                *w /= DEVIATION[i / 9 % 3];
            }
            let means = mean_activations(&layers, pictures)?;
            normalise_layers(checkpoint, &mut layers, means)?;
        }
        Scheme::Normalised => {
            let matrix = checkpoint.floats("0.weight", &[3, 3, 1, 1])?;
            let shift = checkpoint.floats("0.bias", &[3])?;
            fold_colours(&mut layers[0], &matrix, &shift);
        }
    }
    write(checkpoint, &layers, scheme)
}

fn read_layer(
    checkpoint: &mut Checkpoint,
    scheme: Scheme,
    place: &Place,
) -> Result<Layer, StyleError> {
    let key = scheme.key(place);
    let (inputs, outputs) = (place.inputs as u64, place.outputs as u64);
    Ok(Layer {
        weight: checkpoint.floats(&format!("{key}.weight"), &[outputs, inputs, 3, 3])?,
        bias: checkpoint.floats(&format!("{key}.bias"), &[outputs])?,
    })
}

/// Makes the first layer, which sees `matrix · image + shift`, see `image − MEAN`. Mirrored borders
/// make that exact: with zeros around its input, no bias could stand in for a shift there.
fn fold_colours(first: &mut Layer, matrix: &[f32], shift: &[f32]) {
    let middle: [f32; 3] = std::array::from_fn(|row| {
        (0..3).map(|c| matrix[3 * row + c] * MEAN[c]).sum::<f32>() + shift[row]
    });
    for (filter, bias) in first.weight.chunks_exact_mut(27).zip(&mut first.bias) {
        for tap in 0..9 {
            let seen: [f32; 3] = std::array::from_fn(|row| filter[9 * row + tap]);
            for c in 0..3 {
                filter[9 * c + tap] = (0..3).map(|row| seen[row] * matrix[3 * row + c]).sum();
            }
            *bias += (0..3).map(|row| seen[row] * middle[row]).sum::<f32>();
        }
    }
}

/// The network of these filters, with the statistics of the layers that `statistics` picks.
pub(super) fn stack(layers: &[Layer], statistics: impl Fn(&Place) -> bool) -> PerceptualStack {
    let layers = layers.iter().zip(&PLACES).map(|(layer, place)| {
        let statistics = statistics(place);
        ConvLayer::new(
            &layer.weight,
            layer.bias.clone(),
            place.pool_before,
            statistics,
        )
    });
    PerceptualStack::new(layers.collect(), 1.0, MEAN)
        .bordered(Border::Mirrored)
        .ending(OddEnd::Kept)
}

/// Mean activation of every filter, per layer.
fn mean_activations(layers: &[Layer], pictures: &[RgbImage]) -> Result<Vec<Vec<f32>>, StyleError> {
    let stack = stack(layers, |_| true);
    let mut means: Vec<Vec<f32>> = (PLACES.iter())
        .map(|place| vec![0.0; place.outputs])
        .collect();
    for image in pictures {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let least = stack.smallest();
        if width.min(height) < least {
            return Err(StyleError::TooSmall {
                width,
                height,
                least,
            });
        }
        let features = stack.forward(&picture(image), height, width).0;
        let mut rest = &features[features.len() - stack.statistics_len()..];
        for means in &mut means {
            let (own, _deviations) = rest.split_at(means.len());
            for (mean, own) in means.iter_mut().zip(own) {
                *mean += own / pictures.len() as f32;
            }
            rest = &rest[2 * means.len()..];
        }
    }
    Ok(means)
}

fn normalise_layers(
    checkpoint: &Checkpoint,
    layers: &mut [Layer],
    means: Vec<Vec<f32>>,
) -> Result<(), StyleError> {
    let mut inputs = vec![1.0; 3];
    for ((layer, place), mut scale) in layers.iter_mut().zip(&PLACES).zip(means) {
        let average = scale.iter().sum::<f32>() / scale.len() as f32;
        if !(average.is_finite() && average > 0.0) {
            return Err(checkpoint.fault(format!(
                "has a layer {} that {} on the pictures it was measured on: these are no trained \
                 filters",
                place.name,
                if average.is_finite() {
                    "never fires"
                } else {
                    "overflows"
                },
            )));
        }
        scale
            .iter_mut()
            .for_each(|m| *m = m.max(LEAST_SHARE * average));
        rescale(&mut layer.weight, &mut layer.bias, &inputs, &scale);
        inputs = scale;
    }
    Ok(())
}
