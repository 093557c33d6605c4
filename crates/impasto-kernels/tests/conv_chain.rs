//! Chains of convolutions: twin, poisoned pixels, refusals.

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

fn twin(image: &FeatureMap) -> Pixels {
    let pixels = wide(&image.data);
    let pixels = pixels.chunks(5).map(<[f64]>::to_vec).collect();
    let mut current = (image.height, image.width, pixels);
    for layer in layers() {
        let (height, width, pixels) = resampled(current, layer.resample);
        let mirrored = |at: isize, size: usize| {
            let last = size as isize - 1;
            (last - (last - at.abs()).abs()) as usize
        };
        let pixel = |i: usize| {
            let (y, x) = ((i / width) as isize, (i % width) as isize);
            let output = |o: usize| {
                let mut sum = f64::from(layer.bias[o]);
                for tap in 0..9 {
                    let (dy, dx) = (tap as isize / 3 - 1, tap as isize % 3 - 1);
                    let (y, x) = (mirrored(y + dy, height), mirrored(x + dx, width));
                    for (i, value) in pixels[y * width + x].iter().enumerate() {
                        let weight = layer.weight[(o * layer.inputs + i) * 9 + tap];
                        sum += f64::from(weight) * value;
                    }
                }
                sum.max(0.0)
            };
            (0..layer.bias.len()).map(output).collect()
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
        let (h, w, expected) = twin(&image);
        assert_eq!((found.height, found.width, found.channels), (h, w, 3));
        let what = format!("{width}×{height}");
        assert_close(&what, &found.data, &expected.concat(), 1e-5);
    }
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
