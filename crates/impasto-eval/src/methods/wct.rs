//! Whitening and colouring at four levels (Li et al. 2017), through small distilled encoders and
//! decoders (Wang et al. 2020).

use super::pictures::{map_of, padded, picture_of, reduced};
use super::{Stylizer, Transfer, bytes_of};
use image::RgbImage;
use impasto_kernels::{ConvChain, ConvLayer, FeatureMap, Resample};
use impasto_style::{StyleError, TensorFile};
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};
use std::path::Path;

/// How far features go from the picture's to the painting's, at every level (Li et al.'s choice).
const STRENGTH: f64 = 0.6;
/// Variance under which a direction of features counts as empty.
const LEAST_VARIANCE: f64 = 1e-5;

/// Convolutions of the encoder of level 4 in order, with their output channels; those of the
/// levels before end with `conv11`, `conv21` and `conv31`.
const CONVOLUTIONS: [(&str, usize); 9] = [
    ("conv11", 16),
    ("conv12", 16),
    ("conv21", 32),
    ("conv22", 32),
    ("conv31", 64),
    ("conv32", 64),
    ("conv33", 64),
    ("conv34", 64),
    ("conv41", 128),
];
/// Number of convolutions of each level.
const LENGTHS: [usize; 4] = [1, 3, 5, 9];
/// Channels of the only convolution of level 1, which is wider than in the other levels.
const FIRST_LEVEL: usize = 24;

struct Level {
    encoder: ConvChain,
    decoder: ConvChain,
}

/// The method with its networks.
pub struct Wct {
    /// Deepest first.
    levels: Vec<Level>,
}

impl Wct {
    /// Reads encoders `enc1` … `enc4` and decoders `dec1` … `dec4` from a safetensors file.
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
        let file = TensorFile::open(name, bytes)?;
        let levels = (1..=4).rev().map(|level| read_level(&file, level));
        Ok(Self {
            levels: levels.collect::<Result<_, _>>()?,
        })
    }
}

/// Names and channels of a level's convolutions, from the picture inwards.
fn convolutions(level: usize) -> Vec<(&'static str, usize)> {
    let mut all = CONVOLUTIONS[..LENGTHS[level - 1]].to_vec();
    if level == 1 {
        all[0].1 = FIRST_LEVEL;
    }
    all
}

/// How resolution changes between a convolution and the one before it, counted inwards: by
/// `change`, if it does.
fn resample(name: &str, change: Resample) -> Resample {
    match name {
        "conv21" | "conv31" | "conv41" => change,
        _ => Resample::Keep,
    }
}

fn read_level(file: &TensorFile<'_>, level: usize) -> Result<Level, StyleError> {
    let inwards = convolutions(level);
    let tensors = |part: &str, name: &str, outputs: usize, inputs: usize| {
        let weight = file.floats_of(
            &format!("{part}{level}.{name}.weight"),
            outputs * inputs * 9,
        )?;
        let bias = file.floats_of(&format!("{part}{level}.{name}.bias"), outputs)?;
        Ok::<_, StyleError>((weight, bias))
    };
    let (mut encoder, mut decoder) = (Vec::new(), Vec::new());
    let mut inputs = 3;
    for (name, outputs) in &inwards {
        let (mut weight, mut bias) = tensors("enc", name, *outputs, inputs)?;
        if encoder.is_empty() {
            let first = file.floats_of(&format!("enc{level}.conv0.weight"), 9)?;
            let shift = file.floats_of(&format!("enc{level}.conv0.bias"), 3)?;
            fold(&mut weight, &mut bias, &first, &shift);
        }
        let resample = resample(name, Resample::Halve);
        encoder.push((resample, ConvLayer::new(&weight, bias, false, false)));
        // Back from these channels to those that the encoder had before.
        let (weight, bias) = tensors("dec", name, inputs, *outputs)?;
        decoder.push((name, ConvLayer::new(&weight, bias, false, false)));
        inputs = *outputs;
    }
    let mut after = None::<&str>;
    let outwards = decoder.into_iter().rev().map(|(name, layer)| {
        let after = after.replace(*name).unwrap_or_default();
        (resample(after, Resample::Double), layer)
    });
    Ok(Level {
        decoder: ConvChain::new(outwards.collect()),
        encoder: ConvChain::new(encoder),
    })
}

/// Makes the first convolution do what a 1×1 one before it does: mirrored borders commute with it.
fn fold(weight: &mut [f32], bias: &mut [f32], first: &[f32], shift: &[f32]) {
    for (filter, bias) in weight.as_chunks_mut::<27>().0.iter_mut().zip(bias) {
        let old = *filter;
        for (i, new) in filter.iter_mut().enumerate() {
            let (input, tap) = (i / 9, i % 9);
            *new = (0..3)
                .map(|m| old[m * 9 + tap] * first[m * 3 + input])
                .sum();
        }
        *bias += (0..27).map(|i| old[i] * shift[i / 9]).sum::<f32>();
    }
}

impl Stylizer for Wct {
    fn name(&self) -> &'static str {
        "wct"
    }

    fn transfer<'a>(&'a self, painting: &RgbImage) -> Transfer<'a> {
        let small = map_of(&reduced(painting));
        let colours = self.levels.iter().map(|level| {
            let features = level.encoder.forward(&small);
            (level, Moments::of(&features))
        });
        let colours: Vec<(&Level, Moments)> = colours.collect();
        Box::new(move |picture| {
            padded(picture, |large| {
                colours.iter().fold(large, |current, (level, painting)| {
                    let mut features = level.encoder.forward(&map_of(&current));
                    recolour(&mut features, painting);
                    picture_of(&level.decoder.forward(&features))
                })
            })
        })
    }
}

/// Mean of features, and square root and inverse square root of their covariance.
struct Moments {
    mean: DVector<f64>,
    root: DMatrix<f64>,
    inverse_root: DMatrix<f64>,
}

impl Moments {
    fn of(features: &FeatureMap) -> Self {
        let channels = features.channels;
        let count = (features.data.len() / channels).max(1) as f64;
        let mut mean = DVector::<f64>::zeros(channels);
        for pixel in features.data.chunks_exact(channels) {
            for (sum, x) in mean.iter_mut().zip(pixel) {
                *sum += f64::from(*x) / count;
            }
        }
        let centred = DMatrix::from_fn(channels, features.data.len() / channels, |c, i| {
            f64::from(features.data[i * channels + c]) - mean[c]
        });
        let covariance: DMatrix<f64> = &centred * centred.transpose() / (count - 1.0).max(1.0);
        let eigen: SymmetricEigen<f64, Dyn> = SymmetricEigen::new(covariance);
        let power = |exponent: f64| {
            let kept = |v: f64| Some(v).filter(|v| *v > LEAST_VARIANCE);
            let scales = eigen
                .eigenvalues
                .map(|v| kept(v).map_or(0.0, |v| v.powf(exponent)));
            &eigen.eigenvectors * DMatrix::from_diagonal(&scales) * eigen.eigenvectors.transpose()
        };
        Self {
            root: power(0.5),
            inverse_root: power(-0.5),
            mean,
        }
    }
}

/// Gives features the painting's mean and covariance, to a share of [`STRENGTH`].
fn recolour(features: &mut FeatureMap, painting: &Moments) {
    let own = Moments::of(features);
    let matrix = &painting.root * &own.inverse_root;
    let channels = features.channels;
    for pixel in features.data.chunks_exact_mut(channels) {
        let centred = DVector::from_fn(channels, |c, _| f64::from(pixel[c]) - own.mean[c]);
        let coloured = &matrix * centred + &painting.mean;
        for (x, coloured) in pixel.iter_mut().zip(coloured.iter()) {
            *x = (f64::from(*x) * (1.0 - STRENGTH) + coloured * STRENGTH) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(
        clippy::unwrap_used,
        clippy::print_stdout,
        reason = "a test may panic and say why"
    )]

    use super::*;
    use image::Rgb;
    use image::imageops::{FilterType, resize};

    fn features(seed: u32, spread: f32) -> FeatureMap {
        let value = |i: u32| {
            let random = (i + seed * 7919).wrapping_mul(2_654_435_761) >> 16;
            (random % 1000) as f32 / 1000.0
        };
        // Channels that depend on each other.
        let pixels = (0..400).flat_map(|i| {
            let [a, b, c] = [0, 1, 2].map(|c| value(3 * i + c));
            [a * spread, (a + b) * 0.5, c + 0.3 * a]
        });
        FeatureMap {
            height: 20,
            width: 20,
            channels: 3,
            data: pixels.collect(),
        }
    }

    #[test]
    fn features_go_their_share_of_the_way_to_the_paintings_moments() {
        let (mut own, painting) = (features(1, 2.0), features(2, 0.5));
        let before = Moments::of(&own);
        let wanted = Moments::of(&painting);
        recolour(&mut own, &wanted);
        let found = Moments::of(&own);
        let mean = &before.mean * (1.0 - STRENGTH) + &wanted.mean * STRENGTH;
        assert!((&found.mean - mean).amax() < 1e-5);
        // The blended features are one linear map of the old ones.
        let map = &wanted.root * &before.inverse_root * STRENGTH
            + DMatrix::identity(3, 3) * (1.0 - STRENGTH);
        let covariance = &map * &before.root * &before.root * map.transpose();
        let differs = (&found.root * &found.root - covariance).amax();
        assert!(differs < 1e-5, "{differs}");
    }

    #[test]
    fn a_1x1_convolution_folds_into_the_next() {
        let first = [0.0, 0.0, 2.0, 0.0, 3.0, 0.0, 4.0, 0.0, 0.0];
        let shift = [1.0, -1.0, 0.5];
        let mut weight = vec![0.0; 27];
        // Sums the middle of all three channels.
        for i in [4, 13, 22] {
            weight[i] = 1.0;
        }
        let mut bias = vec![0.1];
        fold(&mut weight, &mut bias, &first, &shift);
        assert_eq!([weight[4], weight[13], weight[22]], [4.0, 3.0, 2.0]);
        assert!((bias[0] - 0.6).abs() < 1e-6);
    }

    fn shared(path: &str) -> Option<std::path::PathBuf> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../../shared/data")
            .join(path);
        if path.exists() {
            return Some(path);
        }
        println!("skipped: there is no {}", path.display());
        None
    }

    #[test]
    fn decoders_undo_their_encoders_as_well_as_published() {
        let (Some(weights), Some(photos)) = (
            shared("weights/wct_small16x_levels1-4_f32.safetensors"),
            shared("scenes/fox/images"),
        ) else {
            return;
        };
        let wct = Wct::open(&weights).unwrap();
        let mut photos: Vec<_> = std::fs::read_dir(photos).unwrap().collect();
        photos.sort_by_key(|entry| entry.as_ref().unwrap().path());
        let photo = image::open(photos[0].as_ref().unwrap().path()).unwrap();
        let photo = resize(&photo.to_rgb8(), 160, 280, FilterType::Triangle);
        // Published, of another photo: 23.7, 28.0, 32.4 and 47.5 dB.
        for (level, least) in wct.levels.iter().zip([22.0, 26.0, 29.0, 40.0]) {
            let found = level
                .decoder
                .forward(&level.encoder.forward(&map_of(&photo)));
            let psnr = impasto_scene::metrics::psnr(&found.data, &map_of(&photo).data);
            assert!(psnr > least, "{psnr:.1} dB instead of {least}");
        }
    }

    #[test]
    fn a_painted_picture_keeps_its_size_and_takes_the_paintings_colours() {
        let Some(weights) = shared("weights/wct_small16x_levels1-4_f32.safetensors") else {
            return;
        };
        let wct = Wct::open(&weights).unwrap();
        let wave = |x: u32, y: u32| (f64::from(x) * 0.3).sin() * (f64::from(y) * 0.2).cos();
        let picture = RgbImage::from_fn(45, 38, |x, y| {
            Rgb([(128.0 + 80.0 * wave(x, y)) as u8, 120, 90])
        });
        let painting = RgbImage::from_fn(300, 280, |x, y| {
            Rgb([30, 40, (160.0 + 60.0 * wave(y, x)) as u8])
        });
        let painted = wct.transfer(&painting)(&picture);
        assert_eq!(painted.dimensions(), picture.dimensions());
        let blueness = |image: &RgbImage| {
            let sum = image
                .pixels()
                .map(|p| f64::from(p.0[2]) - f64::from(p.0[0]));
            sum.sum::<f64>() / f64::from(image.width() * image.height())
        };
        assert!(blueness(&painted) > 60.0 && blueness(&picture) < 0.0);
    }

    #[test]
    fn files_that_are_no_networks_are_refused() {
        for bytes in [&b""[..], b"{}", &[0; 64]] {
            let error = Wct::from_bytes("x.safetensors", bytes).err().unwrap();
            assert!(error.to_string().contains("x.safetensors"));
        }
    }
}
