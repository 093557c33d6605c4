//! The painter: a style model that belongs to no scene.

use crate::config::TrainConfig;
use crate::hypernetworks::{CodeNormalisation, StyleModel};
use burn::tensor::{Device, Tensor};
use impasto_field::encoding::vector;
use impasto_field::{Field, Parameters, host};
use impasto_style::{StyleCode, StyleError, TensorFile, write_f16};

/// Names of what normalises codes.
pub(crate) const CODE_MEAN: &str = "code.mean";
pub(crate) const CODE_SCALE: &str = "code.scale";

/// The shipped weights, made by `impasto train-painter`; docs/painter.md says of what.
static SHIPPED: &[u8] = include_bytes!("../../../assets/painter_f16.safetensors");

impl TrainConfig {
    /// Whether the shipped painter is made for this configuration's codes and sizes.
    pub fn fits_shipped_painter(&self) -> bool {
        let known = |config: &Self| {
            let Self {
                style, style_app, ..
            } = config;
            (
                (style.shading, style.perceptual, style_app.clone()),
                (style.hyper_width, style.predicted_layers),
                (
                    style.weigh_codes,
                    style.pictures.side,
                    style.pictures.canonical,
                ),
                config.field.levels(),
            )
        };
        known(self) == known(&Self::fast())
    }
}

impl StyleModel {
    /// The painter that every model of this configuration comes with; `None` where it is made for others.
    ///
    /// # Errors
    /// If the asset is damaged.
    pub fn shipped(config: &TrainConfig, device: &Device) -> Result<Option<Self>, StyleError> {
        let fits = config.fits_shipped_painter();
        let read = || Self::from_bytes("painter_f16.safetensors", SHIPPED, config, device);
        fits.then(read).transpose()
    }

    /// Its weights in half precision.
    ///
    /// # Errors
    /// If safetensors refuses them.
    pub fn to_bytes(&self) -> Result<Vec<u8>, StyleError> {
        let named: Vec<(String, Vec<f32>)> = self
            .named()
            .into_iter()
            .map(|(name, tensor)| (name, host(tensor)))
            .collect();
        let named = named.iter();
        let named = named.map(|(name, numbers)| (name.as_str(), numbers.as_slice()));
        let scale = [self.codes.scale];
        let codes: [(&str, &[f32]); 2] = [(CODE_MEAN, &self.codes.mean), (CODE_SCALE, &scale)];
        write_f16(&named.chain(codes).collect::<Vec<_>>())
    }

    /// Reads stored weights of the sizes that a configuration gives; `name` is for messages.
    ///
    /// # Errors
    /// If a tensor is missing or has another length.
    pub fn from_bytes(
        name: &str,
        bytes: &[u8],
        config: &TrainConfig,
        device: &Device,
    ) -> Result<Self, StyleError> {
        let file = TensorFile::open(name, bytes)?;
        let like = Self::zeros(&Field::new(config.field.clone()), config, &Device::flex());
        let read = like.try_map(&mut |key, tensor: &Tensor<1>| {
            let numbers = file.floats_of(key, tensor.dims()[0])?;
            Ok::<_, StyleError>(vector(numbers, device))
        })?;
        let codes = CodeNormalisation {
            mean: file.floats_of(CODE_MEAN, StyleCode::LEN)?,
            scale: file.floats_of(CODE_SCALE, 1)?[0],
        };
        Ok(Self { codes, ..read })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    #[test]
    fn the_preset_has_its_painter_and_others_have_none() {
        let device = Device::flex();
        let shipped = |config: &TrainConfig| StyleModel::shipped(config, &device).unwrap();
        let fast = TrainConfig::fast();
        assert!(shipped(&fast).is_some_and(|painter| painter.codes.scale > 0.0));
        assert!(shipped(&TrainConfig::paper()).is_none());
        let mut other = fast;
        other.style_app.hidden = vec![64, 65];
        assert!(shipped(&other).is_none());
        assert!(SHIPPED.len() <= 4 << 20, "{} bytes", SHIPPED.len());
    }

    #[test]
    fn a_painter_comes_back_from_its_file() {
        let (config, device) = (TrainConfig::fast(), Device::flex());
        let field = Field::new(config.field.clone());
        let mut rng = Pcg64::seed_from_u64(1);
        let painter = StyleModel {
            codes: CodeNormalisation {
                mean: (0..StyleCode::LEN).map(|i| i as f32 / 64.0).collect(),
                scale: 1.5,
            },
            ..StyleModel::init(&field, &config, &mut rng, &device)
        };
        let bytes = painter.to_bytes().unwrap();
        let read = StyleModel::from_bytes("p", &bytes, &config, &device).unwrap();
        assert_eq!(read.codes, painter.codes);
        for ((name, one), (_, other)) in painter.named().into_iter().zip(read.named()) {
            let far = host(one).into_iter().zip(host(other));
            let far = far.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(far < 2e-3, "{name}: {far}");
        }
        let mut other = config;
        other.style_app.hidden = vec![32, 32];
        assert!(StyleModel::from_bytes("p", &bytes, &other, &device).is_err());
    }
}
