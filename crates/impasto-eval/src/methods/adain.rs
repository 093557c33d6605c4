//! Adaptive instance normalisation (Huang & Belongie 2017): a picture's relu4_1 features take the
//! painting's mean and deviation, channel by channel, and a decoder makes a picture of them.
//!
//! The encoder is the shipped VGG-16, where the paper has VGG-19; the decoder mirrors it.

pub(crate) mod decoder;

use super::pictures::{padded, picture_of, reduced};
use super::{Stylizer, Transfer, bytes_of};
use decoder::{CHANNELS, Decoder};
use image::RgbImage;
use impasto_kernels::{ConvChain, FeatureMap};
use impasto_style::{Features, Perceptual, Statistics, StyleError, picture};
use std::path::Path;

const SHIPPED_FILE: &str = "adain_decoder_f16.safetensors";
static SHIPPED: &[u8] = include_bytes!("../../../../assets/adain_decoder_f16.safetensors");
/// How many times smaller features are than their picture.
const REDUCTION: usize = 8;

/// The method with its networks.
pub struct AdaIn {
    encoder: Perceptual,
    decoder: ConvChain,
}

impl AdaIn {
    /// With the built-in decoder, which `impasto train-baseline adain` made.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn shipped() -> Result<Self, StyleError> {
        Self::from_bytes(SHIPPED_FILE, SHIPPED)
    }

    /// With a decoder from a file that `impasto train-baseline adain` wrote.
    ///
    /// # Errors
    /// If the file cannot be read, or lacks a tensor of the expected size.
    pub fn open(path: &Path) -> Result<Self, StyleError> {
        Self::from_bytes(&path.display().to_string(), &bytes_of(path)?)
    }

    /// The same from memory; `name` is for messages.
    ///
    /// # Errors
    /// If a tensor is missing or has another size.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, StyleError> {
        Ok(Self {
            encoder: Perceptual::vgg16()?,
            decoder: Decoder::from_bytes(name, bytes)?.chain(),
        })
    }
}

impl Stylizer for AdaIn {
    fn name(&self) -> &'static str {
        "adain"
    }

    fn transfer<'a>(&'a self, painting: &RgbImage) -> Transfer<'a> {
        let painting = features(&self.encoder, &reduced(painting));
        Box::new(move |picture| {
            padded(picture, |large| {
                match (&painting, features(&self.encoder, &large)) {
                    (Ok(painting), Ok(own)) => {
                        let size = [large.height(), large.width()].map(|side| side as usize);
                        let repainted = renormalised(&own, &painting.statistics, size);
                        picture_of(&self.decoder.forward(&repainted))
                    }
                    // Only of pictures below 8×8 pixels is nothing known, and none is here.
                    _ => large,
                }
            })
        })
    }
}

pub(crate) fn features(encoder: &Perceptual, image: &RgbImage) -> Result<Features, StyleError> {
    let (width, height) = image.dimensions();
    encoder.features(&picture(image), height as usize, width as usize)
}

/// Features of a picture of this height and width with the painting's mean and deviation.
pub(crate) fn renormalised(own: &Features, painting: &Statistics, size: [usize; 2]) -> FeatureMap {
    let (from, to) = (moments(&own.statistics), moments(painting));
    let mut data = own.content.clone();
    for pixel in data.chunks_exact_mut(CHANNELS) {
        for (c, x) in pixel.iter_mut().enumerate() {
            *x = (*x - from[c]) / from[CHANNELS + c] * to[CHANNELS + c] + to[c];
        }
    }
    FeatureMap {
        height: size[0] / REDUCTION,
        width: size[1] / REDUCTION,
        channels: CHANNELS,
        data,
    }
}

/// Means and deviations of relu4_1; deviations are never zero, see [`Statistics`].
fn moments(statistics: &Statistics) -> &[f32] {
    &statistics.0[Statistics::LEN - 2 * CHANNELS..]
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use image::Rgb;

    pub(crate) fn waves(width: u32, height: u32, colour: [f64; 3], scale: f64) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            let wave = (f64::from(x) * scale).sin() * (f64::from(y) * scale * 0.7).cos();
            Rgb(colour.map(|c| (c + 60.0 * wave) as u8))
        })
    }

    #[test]
    fn features_take_the_paintings_mean_and_deviation() {
        let vgg = Perceptual::vgg16().unwrap();
        let own = features(&vgg, &waves(48, 40, [90.0, 120.0, 150.0], 0.3)).unwrap();
        let painting = features(&vgg, &waves(64, 64, [160.0, 90.0, 60.0], 0.9)).unwrap();
        let found = renormalised(&own, &painting.statistics, [40, 48]);
        assert_eq!(
            [found.height, found.width, found.channels],
            [5, 6, CHANNELS]
        );
        let wanted = moments(&painting.statistics);
        let fires = moments(&own.statistics)[CHANNELS..].iter();
        let mut compared = 0;
        for (c, own) in fires.enumerate() {
            let values = found.data.iter().skip(c).step_by(CHANNELS);
            let values: Vec<f64> = values.map(|v| f64::from(*v)).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
            let deviation = (square / (values.len() - 1) as f64).sqrt();
            assert!((mean - f64::from(wanted[c])).abs() < 1e-3, "mean {c}");
            // A channel that never fires has nothing to spread.
            if *own > 0.1 {
                let wanted = f64::from(wanted[CHANNELS + c]);
                assert!((deviation - wanted).abs() < 1e-2 * wanted + 1e-2, "{c}");
                compared += 1;
            }
        }
        assert!(compared > 100, "{compared}");
    }

    #[test]
    fn a_painted_picture_keeps_its_size_and_takes_the_paintings_colours() {
        let adain = AdaIn::shipped().unwrap();
        let picture = waves(45, 38, [150.0, 120.0, 90.0], 0.3);
        let painting = waves(300, 280, [40.0, 60.0, 170.0], 0.2);
        let painted = adain.transfer(&painting)(&picture);
        assert_eq!(painted.dimensions(), picture.dimensions());
        let blueness = |image: &RgbImage| {
            let pixels = image
                .pixels()
                .map(|p| f64::from(p.0[2]) - f64::from(p.0[0]));
            pixels.sum::<f64>() / f64::from(image.width() * image.height())
        };
        let (painted, before) = (blueness(&painted), blueness(&picture));
        assert!(painted > before + 60.0, "from {before:.0} to {painted:.0}");
    }

    #[test]
    fn files_that_are_no_decoder_are_refused() {
        for bytes in [&b""[..], b"{}", &[0; 64]] {
            let error = AdaIn::from_bytes("x.safetensors", bytes).err().unwrap();
            assert!(error.to_string().contains("x.safetensors"));
        }
    }
}
