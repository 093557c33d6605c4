//! The perceptual stack's slow twin, and small random stacks.

use super::*;
use burn::tensor::Tensor;
use impasto_kernels::{Border, ConvLayer, OddEnd, PerceptualStack, ops};
use std::sync::Arc;

/// One convolution of a test's stack.
pub struct Conv {
    pub inputs: usize,
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
    pub pool_before: bool,
    pub statistics: bool,
}

pub const SCALE: f32 = 2.5;
pub const OFFSET: [f32; 3] = [1.1, 0.7, 1.4];

/// Random filters for a chain of channels from RGB on.
pub fn random_stack(
    seed: u64,
    channels: &[usize],
    pools: &[usize],
    statistics: &[usize],
) -> Vec<Conv> {
    let mut inputs = 3;
    let mut layers = Vec::new();
    for (i, outputs) in channels.iter().copied().enumerate() {
        let bound = (2.0 / inputs as f32).sqrt() / 2.0;
        let seed = seed * 100 + i as u64;
        layers.push(Conv {
            inputs,
            weight: numbers(seed, outputs * inputs * 9, -bound..bound),
            bias: numbers(seed + 50, outputs, -0.3..0.5),
            pool_before: pools.contains(&i),
            statistics: statistics.contains(&i),
        });
        inputs = outputs;
    }
    layers
}

pub fn stack(layers: &[Conv]) -> PerceptualStack {
    let layers = layers
        .iter()
        .map(|l| ConvLayer::new(&l.weight, l.bias.clone(), l.pool_before, l.statistics))
        .collect();
    PerceptualStack::new(layers, SCALE, OFFSET)
}

/// A channels-last image in double precision.
#[derive(Clone)]
pub struct Image {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    pub data: Vec<f64>,
}

impl Image {
    fn get(&self, y: isize, x: isize, c: usize, border: Border) -> f64 {
        let inside = |at: isize, size: usize| (0..size as isize).contains(&at);
        let mirrored = |at: isize, size: usize| {
            let last = size as isize - 1;
            last - (last - at.abs()).abs()
        };
        let (y, x) = match border {
            Border::Zeros => (y, x),
            Border::Mirrored => (mirrored(y, self.height), mirrored(x, self.width)),
        };
        if inside(y, self.height) && inside(x, self.width) {
            self.data[(y as usize * self.width + x as usize) * self.channels + c]
        } else {
            0.0
        }
    }

    /// An image of `f(y, x, channel)`.
    fn of(
        [height, width, channels]: [usize; 3],
        mut f: impl FnMut(isize, isize, usize) -> f64,
    ) -> Self {
        let mut data = Vec::new();
        for y in 0..height {
            for x in 0..width {
                data.extend((0..channels).map(|c| f(y as isize, x as isize, c)));
            }
        }
        Self {
            height,
            width,
            channels,
            data,
        }
    }

    pub fn statistics(&self, c: usize) -> (f64, f64) {
        let values: Vec<f64> = self
            .data
            .iter()
            .skip(c)
            .step_by(self.channels)
            .copied()
            .collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        (mean, (sum / (n - 1.0).max(1.0) + 1e-5).sqrt())
    }
}

/// The stack's features by direct convolution, and how near it came to a kink of relu or pool.
pub fn twin(layers: &[Conv], image: &[f64], height: usize, width: usize) -> (Vec<f64>, f64) {
    let modes = (Border::Zeros, OddEnd::Dropped);
    twin_with(modes, layers, image, [height, width])
}

/// The same with other borders and ends.
pub fn twin_with(
    (border, odd_end): (Border, OddEnd),
    layers: &[Conv],
    image: &[f64],
    [height, width]: [usize; 2],
) -> (Vec<f64>, f64) {
    let mut margin = f64::MAX;
    let mut current = Image::of([height, width, 3], |y, x, c| {
        let value = image[(y as usize * width + x as usize) * 3 + c];
        value * f64::from(SCALE) - f64::from(OFFSET[c])
    });
    let mut statistics = Vec::new();
    for layer in layers {
        if layer.pool_before {
            let half = |size: usize| match odd_end {
                OddEnd::Dropped => size / 2,
                OddEnd::Kept => size.div_ceil(2),
            };
            let shape = [half(current.height), half(current.width), current.channels];
            current = Image::of(shape, |y, x, c| {
                let mut window: Vec<f64> = [(0, 0), (0, 1), (1, 0), (1, 1)]
                    .map(|(dy, dx)| (2 * y + dy, 2 * x + dx))
                    .into_iter()
                    .filter(|(y, x)| {
                        (*y as usize) < current.height && (*x as usize) < current.width
                    })
                    .map(|(y, x)| current.get(y, x, c, Border::Zeros))
                    .collect();
                window.sort_by(|a, b| b.total_cmp(a));
                if let [first, second, ..] = window[..]
                    && first > 0.0
                {
                    margin = margin.min(first - second);
                }
                window[0]
            });
        }
        let shape = [current.height, current.width, layer.bias.len()];
        current = Image::of(shape, |y, x, o| {
            let mut sum = f64::from(layer.bias[o]);
            for i in 0..layer.inputs {
                for tap in 0..9 {
                    let weight = layer.weight[(o * layer.inputs + i) * 9 + tap];
                    let (dy, dx) = (tap as isize / 3 - 1, tap as isize % 3 - 1);
                    sum += f64::from(weight) * current.get(y + dy, x + dx, i, border);
                }
            }
            margin = margin.min(sum.abs());
            sum.max(0.0)
        });
        if layer.statistics {
            let pairs: Vec<_> = (0..current.channels)
                .map(|c| current.statistics(c))
                .collect();
            statistics.extend(pairs.iter().map(|p| p.0));
            statistics.extend(pairs.iter().map(|p| p.1));
        }
    }
    ([current.data, statistics].concat(), margin)
}

/// Like VGG's first blocks, with a handful of channels: smallest image 8 × 8.
pub fn small_vgg(seed: u64) -> Vec<Conv> {
    random_stack(seed, &[4, 5, 6, 4, 7, 5], &[2, 4, 5], &[0, 2, 4, 5])
}

/// Enough channels for several strips and for the filtering of large images, a last strip that is
/// not full, and a small image behind the pool.
pub fn wide_stack(seed: u64) -> Vec<Conv> {
    random_stack(seed, &[40, 70, 130, 36], &[3], &[1, 3])
}

/// Checks the gradient of the stack as an operation by central differences.
pub fn check_operation(stack: PerceptualStack, image: &[f32], [height, width]: [usize; 2]) {
    let (stack, shape) = (Arc::new(stack), [height, width, 3]);
    let run = |image: Tensor<3>| ops::perceptual(image, Arc::clone(&stack));
    let tracked = leaf(image, shape);
    let out = run(tracked.clone());
    let weights = numbers(6, out.dims()[0], -1.0..1.0);
    let grad = gradient(&tracked, &backward(out, &weights));
    check_gradient("image", image, &grad, 1e-3, |image| {
        dot(&values(run(tensor(image, shape))), &weights)
    });
}
