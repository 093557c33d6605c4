//! Makes the installed VGG-19 out of a checkpoint.

use super::file::WeightsFile;
use super::installed::{Vgg19Facts, write};
use super::vgg19::{LAYERS, LayerWeights, MEAN, Scheme, VggLayer, stack};
use crate::perceptual::{check_size, rescale};
use crate::{StyleError, picture};
use image::RgbImage;

/// Torchvision's inputs are `(image − MEAN) / DEVIATION`, RGB.
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Filters that hardly fire would get absurd scales: a mean below this part of its layer's average
/// counts as this part.
const LEAST_SHARE: f32 = 0.01;

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
    checkpoint: &mut WeightsFile,
    pictures: &[RgbImage],
) -> Result<(Vec<u8>, Vgg19Facts), StyleError> {
    let scheme = Scheme::of(checkpoint)?;
    let mut layers = LAYERS
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
    checkpoint: &mut WeightsFile,
    scheme: Scheme,
    place: &VggLayer,
) -> Result<LayerWeights, StyleError> {
    let key = scheme.key(place);
    let (inputs, outputs) = (place.inputs as u64, place.outputs as u64);
    Ok(LayerWeights {
        weight: checkpoint.floats(&format!("{key}.weight"), &[outputs, inputs, 3, 3])?,
        bias: checkpoint.floats(&format!("{key}.bias"), &[outputs])?,
    })
}

/// Makes the first layer, which sees `matrix · image + shift`, see `image − MEAN`. Mirrored borders
/// make that exact: with zeros around its input, no bias could stand in for a shift there.
fn fold_colours(first: &mut LayerWeights, matrix: &[f32], shift: &[f32]) {
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

/// Mean activation of every filter, per layer.
fn mean_activations(
    layers: &[LayerWeights],
    pictures: &[RgbImage],
) -> Result<Vec<Vec<f32>>, StyleError> {
    let stack = stack(layers, |_| true);
    let mut means: Vec<Vec<f32>> = (LAYERS.iter())
        .map(|place| vec![0.0; place.outputs])
        .collect();
    for image in pictures {
        let (width, height) = (image.width() as usize, image.height() as usize);
        check_size(&stack, height, width)?;
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
    checkpoint: &WeightsFile,
    layers: &mut [LayerWeights],
    means: Vec<Vec<f32>>,
) -> Result<(), StyleError> {
    let mut inputs = vec![1.0; 3];
    for ((layer, place), mut scale) in layers.iter_mut().zip(&LAYERS).zip(means) {
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
