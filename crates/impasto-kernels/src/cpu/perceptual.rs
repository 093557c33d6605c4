//! The frozen perceptual stack: 3×3 convolutions with relu and 2×2 max-pooling (VGG), forward,
//! and backward to the image only.

use super::convolution::{ConvLayer, convolve};
use super::padded::{Border, FeatureMap, OddEnd, Padded, pool, pool_backward};
use super::statistics::ChannelStatistics;

/// A frozen stack of convolutions over an RGB image in `[0, 1]`.
#[derive(Debug, Clone)]
pub struct PerceptualStack {
    pub(crate) layers: Vec<ConvLayer>,
    pub(crate) input_scale: f32,
    pub(crate) input_offset: [f32; 3],
    pub(crate) border: Border,
    pub(crate) odd_end: OddEnd,
}

/// Activations kept from a forward pass.
#[derive(Debug)]
pub struct PerceptualTape {
    outputs: Vec<Padded>,
    pooled: Vec<Option<Padded>>,
    statistics: Vec<Option<ChannelStatistics>>,
}

impl PerceptualTape {
    /// Height and width of the image.
    pub fn image_size(&self) -> (usize, usize) {
        (self.outputs[0].height, self.outputs[0].width)
    }

    /// Outputs, after relu, of the layers that contribute statistics, in order.
    pub fn features(&self) -> impl Iterator<Item = FeatureMap> {
        let layers = self.outputs.iter().zip(&self.statistics);
        layers.filter_map(|(output, own)| own.as_ref().map(|_| FeatureMap::of(output)))
    }
}

impl PerceptualStack {
    /// Chains `layers`; the first takes RGB, the last one's output is the content feature.
    ///
    /// The first layer sees `image · input_scale − input_offset`, with zeros around it and odd ends
    /// dropped, until [`PerceptualStack::bordered`] and [`PerceptualStack::ending`] say otherwise.
    /// With zeros, an offset folded into the first bias would be wrong at the image's border.
    ///
    /// # Panics
    /// If there is no layer, the first one follows a pool, or neighbouring widths differ.
    pub fn new(layers: Vec<ConvLayer>, input_scale: f32, input_offset: [f32; 3]) -> Self {
        let mut channels = 3;
        for layer in &layers {
            assert_eq!(
                layer.forward.inputs, channels,
                "channels of neighbouring convolutions"
            );
            channels = layer.forward.outputs;
        }
        assert!(
            layers.first().is_some_and(|first| !first.pool_before),
            "a perceptual stack has layers, the first of which sees the image itself"
        );
        Self {
            layers,
            input_scale,
            input_offset,
            border: Border::default(),
            odd_end: OddEnd::default(),
        }
    }

    /// The same stack with another border around the input of every convolution.
    #[must_use]
    pub fn bordered(mut self, border: Border) -> Self {
        self.border = border;
        self
    }

    /// The same stack with another treatment of odd sizes.
    #[must_use]
    pub fn ending(mut self, odd_end: OddEnd) -> Self {
        self.odd_end = odd_end;
        self
    }

    fn pools(&self) -> usize {
        self.layers.iter().filter(|l| l.pool_before).count()
    }

    /// Smallest height and width of an image of which every pooling leaves what the next
    /// convolution needs: one pixel a side, or two where borders are mirrored.
    pub fn smallest(&self) -> usize {
        let needed = match self.border {
            Border::Zeros => 1,
            Border::Mirrored => 2,
        };
        match self.odd_end {
            OddEnd::Dropped => needed << self.pools(),
            OddEnd::Kept => ((needed - 1) << self.pools()) + 1,
        }
    }

    /// Channels of the layers that contribute statistics, in order.
    pub fn statistics_channels(&self) -> Vec<usize> {
        self.layers
            .iter()
            .filter(|l| l.statistics)
            .map(|l| l.forward.outputs)
            .collect()
    }

    /// Length of the statistics part: mean and deviation of every such channel.
    pub fn statistics_len(&self) -> usize {
        2 * self.statistics_channels().iter().sum::<usize>()
    }

    /// Height, width and channels of the content feature of an image.
    pub fn content_shape(&self, height: usize, width: usize) -> [usize; 3] {
        let channels = self.layers[self.layers.len() - 1].forward.outputs;
        let side = |size| (0..self.pools()).fold(size, |size, _| self.odd_end.pooled(size));
        [side(height), side(width), channels]
    }

    /// Content feature (channels-last), then mean and deviation of each statistics layer in order
    /// (`[mean₁, std₁, mean₂, std₂, …]`).
    ///
    /// # Shapes
    /// `image`: `height × width × 3`; result: `content_shape` numbers plus `statistics_len`.
    ///
    /// # Panics
    /// If the image is smaller than [`PerceptualStack::smallest`] or the slice has another length.
    pub fn forward(
        &self,
        image: &[f32],
        height: usize,
        width: usize,
    ) -> (Vec<f32>, PerceptualTape) {
        assert_eq!(
            image.len(),
            height * width * 3,
            "image of a perceptual stack"
        );
        self.check(height, width);
        let mut current = Padded::from_image(image, width, self.input_scale, self.input_offset);
        self.surround(&mut current);
        let mut tape = PerceptualTape {
            outputs: Vec::with_capacity(self.layers.len()),
            pooled: Vec::with_capacity(self.layers.len()),
            statistics: Vec::with_capacity(self.layers.len()),
        };
        let mut statistics = Vec::with_capacity(self.statistics_len());
        for layer in &self.layers {
            let pooled = layer.pool_before.then(|| {
                let mut pooled = pool(tape.outputs.last().unwrap_or(&current), self.odd_end);
                self.surround(&mut pooled);
                pooled
            });
            let input = pooled.as_ref().or(tape.outputs.last()).unwrap_or(&current);
            let mut out = convolve(input, &layer.forward, Some(&layer.bias));
            self.surround(&mut out);
            tape.statistics.push(layer.statistics.then(|| {
                let own = ChannelStatistics::of(&out);
                statistics.extend(own.mean.iter().chain(&own.std).map(|x| *x as f32));
                own
            }));
            tape.pooled.push(pooled);
            tape.outputs.push(out);
            if tape.outputs.len() == 1 {
                current = Padded::zeros(1, 1, 1);
            }
        }
        let mut result = tape
            .outputs
            .last()
            .map_or_else(Vec::new, |last| FeatureMap::of(last).data);
        result.extend(statistics);
        (result, tape)
    }

    /// # Panics
    /// If an image of this size is too small.
    pub(crate) fn check(&self, height: usize, width: usize) {
        assert!(
            height.min(width) >= self.smallest(),
            "image of {width}×{height} is too small for the perceptual stack"
        );
    }

    /// Fills the border of a convolution's input, where zeros are not what it takes.
    fn surround(&self, input: &mut Padded) {
        if self.border == Border::Mirrored {
            input.mirror_border();
        }
    }

    /// Gradient of [`PerceptualStack::forward`] for the image. The filters are constants.
    ///
    /// # Shapes
    /// `grad`: like the result of `forward`; result: `height × width × 3`.
    pub fn backward(&self, tape: &PerceptualTape, grad: &[f32]) -> Vec<f32> {
        let last = &tape.outputs[tape.outputs.len() - 1];
        let content = last.pixels() * last.channels;
        assert_eq!(
            grad.len(),
            content + self.statistics_len(),
            "gradient of a perceptual stack"
        );
        let mut current =
            Padded::from_rows(&grad[..content], last.height, last.width, last.channels);
        let mut statistics = &grad[content..];
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let out = &tape.outputs[i];
            if let Some(of_layer) = &tape.statistics[i] {
                let (rest, own) = statistics.split_at(statistics.len() - 2 * out.channels);
                of_layer.backward(out, own, &mut current);
                statistics = rest;
            }
            current.back_through_relu(out);
            // What falls on a mirrored border belongs to the pixels that it mirrors, so there the
            // gradient is wanted too: as that of an image which has its border inside.
            current = match self.border {
                Border::Zeros => convolve(&current, &layer.backward, None),
                Border::Mirrored => {
                    convolve(&current.widened(), &layer.backward, None).folded_back()
                }
            };
            if let (Some(pooled), true) = (&tape.pooled[i], i > 0) {
                current = pool_backward(&tape.outputs[i - 1], pooled, &current);
            }
        }
        let mut result = Vec::with_capacity(current.pixels() * 3);
        for y in 0..current.height {
            result.extend(current.row(y).iter().map(|g| g * self.input_scale));
        }
        result
    }
}
