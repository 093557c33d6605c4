//! Chains of convolutions: twin, gradients, poisoned pixels, refusals.

mod common;

use common::*;
use impasto_kernels::{ConvChain, ConvLayer, FeatureMap, Resample};

struct Layer {
    resample: Resample,
    inputs: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
}

/// Down and up again, with enough channels for filtering in patches.
fn layers() -> Vec<Layer> {
    use Resample::{Double, Halve, Keep};
    let widths = [(5, 40), (40, 36), (36, 7), (7, 3)];
    let steps = [Keep, Halve, Keep, Double];
    let each = widths.into_iter().zip(steps).enumerate();
    each.map(|(i, ((inputs, outputs), resample))| {
        let bound = (2.0 / (inputs * 9) as f32).sqrt();
        Layer {
            resample,
            inputs,
            weight: numbers(i as u64, outputs * inputs * 9, -bound..bound),
            bias: numbers(50 + i as u64, outputs, -0.2..0.4),
        }
    })
    .collect()
}

fn chain() -> ConvChain {
    let layer = |l: Layer| (l.resample, ConvLayer::new(&l.weight, l.bias, false, false));
    ConvChain::new(layers().into_iter().map(layer).collect())
}

/// All numbers of the layers: of each its weight, then its bias.
fn params() -> Vec<f64> {
    let each = layers().into_iter();
    each.flat_map(|l| wide(&[l.weight, l.bias].concat()))
        .collect()
}

fn image(height: usize, width: usize) -> FeatureMap {
    FeatureMap {
        height,
        width,
        channels: 5,
        data: numbers(9, height * width * 5, 0.0..1.0),
    }
}

type Pixels = (usize, usize, Vec<Vec<f64>>);

fn resampled((height, width, pixels): Pixels, resample: Resample) -> Pixels {
    let at = |y: usize, x: usize| &pixels[y * width + x];
    let (h, w) = match resample {
        Resample::Keep => return (height, width, pixels),
        Resample::Halve => (height / 2, width / 2),
        Resample::Double => (2 * height, 2 * width),
    };
    let pixel = |i: usize| {
        let (y, x) = (i / w, i % w);
        if resample == Resample::Double {
            return at(y / 2, x / 2).clone();
        }
        let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| at(2 * y + dy, 2 * x + dx));
        (0..four[0].len())
            .map(|c| four.iter().map(|p| p[c]).fold(f64::MIN, f64::max))
            .collect()
    };
    (h, w, (0..h * w).map(pixel).collect())
}

/// The chain with these numbers, with or without the last relu.
fn twin(image: &FeatureMap, mut params: &[f64], ends_linear: bool) -> Pixels {
    let pixels = wide(&image.data);
    let pixels = pixels.chunks(5).map(<[f64]>::to_vec).collect();
    let mut current = (image.height, image.width, pixels);
    for (l, layer) in layers().into_iter().enumerate() {
        let (weight, rest) = params.split_at(layer.weight.len());
        let (bias, rest) = rest.split_at(layer.bias.len());
        params = rest;
        let least = match ends_linear && l == 3 {
            true => f64::MIN,
            false => 0.0,
        };
        let (height, width, pixels) = resampled(current, layer.resample);
        let mirrored = |at: isize, size: usize| {
            let last = size as isize - 1;
            (last - (last - at.abs()).abs()) as usize
        };
        let pixel = |i: usize| {
            let (y, x) = ((i / width) as isize, (i % width) as isize);
            let output = |o: usize| {
                let mut sum = bias[o];
                for tap in 0..9 {
                    let (dy, dx) = (tap as isize / 3 - 1, tap as isize % 3 - 1);
                    let (y, x) = (mirrored(y + dy, height), mirrored(x + dx, width));
                    for (i, value) in pixels[y * width + x].iter().enumerate() {
                        sum += weight[(o * layer.inputs + i) * 9 + tap] * value;
                    }
                }
                sum.max(least)
            };
            (0..bias.len()).map(output).collect()
        };
        current = (height, width, (0..height * width).map(pixel).collect());
    }
    current
}

#[test]
fn equals_its_twin_at_every_parity() {
    for (height, width) in [(4, 4), (5, 9), (24, 31), (40, 26)] {
        let image = image(height, width);
        let found = chain().forward(&image);
        let (h, w, expected) = twin(&image, &params(), false);
        assert_eq!((found.height, found.width, found.channels), (h, w, 3));
        let what = format!("{width}×{height}");
        assert_close(&what, &found.data, &expected.concat(), 1e-5);
    }
}

#[test]
fn gradients_are_those_of_its_twins_central_differences() {
    const STEP: f64 = 1e-6;
    let (image, params) = (image(10, 13), params());
    for ends_linear in [false, true] {
        let chain = match ends_linear {
            true => chain().ending_linear(),
            false => chain(),
        };
        let (out, tape) = chain.taped(&image);
        assert_same("result", &out.data, &chain.forward(&image).data);
        let expected = twin(&image, &params, ends_linear).2.concat();
        assert_close("result", &out.data, &expected, 1e-5);
        let weights = numbers(70, out.data.len(), -1.0..1.0);
        let grad = FeatureMap {
            data: weights.clone(),
            ..out
        };
        let gradients = chain.backward(&tape, &grad).into_iter();
        let gradients = gradients.flat_map(|g| [g.weight, g.bias].concat());
        let gradients = wide(&gradients.collect::<Vec<f32>>());
        let loss = |params: &[f64]| -> f64 {
            let out = twin(&image, params, ends_linear).2.concat();
            out.iter()
                .zip(&weights)
                .map(|(a, b)| a * f64::from(*b))
                .sum()
        };
        let size = norm(gradients.iter().copied());
        for seed in 0..8 {
            // Every number at once, or a hundredth of them.
            let direction = numbers(900 + seed, params.len(), -1.0..1.0);
            let direction = direction.iter().enumerate().map(|(i, d)| {
                let used = seed < 2 || i as u64 % 100 == seed;
                if used { f64::from(d.signum()) } else { 0.0 }
            });
            let direction: Vec<f64> = direction.collect();
            let moved = |sign: f64| -> Vec<f64> {
                let pairs = params.iter().zip(&direction);
                pairs.map(|(p, d)| p + sign * STEP * d).collect()
            };
            let measured = (loss(&moved(1.0)) - loss(&moved(-1.0))) / (2.0 * STEP);
            let pairs = gradients.iter().zip(&direction);
            let predicted: f64 = pairs.map(|(g, d)| g * d).sum();
            assert!(
                (measured - predicted).abs() < 1e-4 * size,
                "direction {seed}: gradient {predicted:.6}, difference {measured:.6} of {size:.3}"
            );
        }
    }
}

#[test]
fn a_poisoned_pixel_poisons_the_gradients_of_what_saw_it() {
    let mut poisoned = image(8, 8);
    poisoned.data[3] = f32::NAN;
    let (out, tape) = chain().taped(&poisoned);
    let grad = FeatureMap {
        data: vec![1.0; out.data.len()],
        ..out
    };
    let gradients = chain().backward(&tape, &grad);
    assert!(
        gradients
            .iter()
            .any(|g| g.weight.iter().any(|w| w.is_nan()))
    );
}

#[test]
#[should_panic(expected = "gradient of a chain")]
fn refuses_a_gradient_of_another_shape() {
    let (out, tape) = chain().taped(&image(8, 8));
    let grad = FeatureMap {
        data: vec![1.0; 3],
        height: 1,
        width: 1,
        ..out
    };
    let _ = chain().backward(&tape, &grad);
}

#[test]
fn a_poisoned_pixel_shows_and_stays_in_its_neighbourhood() {
    let mut poisoned = image(30, 30);
    let clean = chain().forward(&poisoned);
    poisoned.data[0] = f32::NAN;
    let found = chain().forward(&poisoned);
    assert!(found.data[..3].iter().all(|v| v.is_nan()));
    let last = found.data.len() - 3;
    assert_same("a far pixel", &found.data[last..], &clean.data[last..]);
}

#[test]
#[should_panic(expected = "too small")]
fn refuses_an_image_that_cannot_be_mirrored() {
    assert_eq!(chain().smallest(), 4);
    let _ = chain().forward(&image(3, 9));
}
