//! What predicts stylised appearances.

use crate::config::TrainConfig;
use burn::tensor::{Device, Tensor};
use impasto_field::encoding::vector;
use impasto_field::{Appearance, Brushwork, Field, Palette, Parameters, StrokeSettings};
use impasto_style::{Hypernetwork, HypernetworkWeights, StyleCode};
use rand_pcg::Pcg64;

/// How style codes are normalised before hypernetworks see them: those of paintings whose palettes were taken
/// out lie close together, far from zero.
#[derive(Debug, Clone, PartialEq)]
pub struct CodeNormalisation {
    /// The mean code.
    pub mean: Vec<f32>,
    /// What is left is multiplied with this.
    pub scale: f32,
}

/// Mean squared length of normalised codes.
const LENGTH: f32 = 256.0;

impl CodeNormalisation {
    /// Codes as they are.
    pub fn none() -> Self {
        Self {
            mean: vec![0.0; StyleCode::LEN],
            scale: 1.0,
        }
    }

    /// That of a set of codes; as they are if there are fewer than two.
    pub fn of(codes: &[StyleCode]) -> Self {
        let count = codes.len() as f32;
        let mut mean = vec![0.0; StyleCode::LEN];
        for code in codes {
            mean.iter_mut()
                .zip(&code.0)
                .for_each(|(m, c)| *m += c / count);
        }
        let square = |code: &StyleCode| {
            let off = code.0.iter().zip(&mean).map(|(c, m)| (c - m).powi(2));
            off.sum::<f32>() / count
        };
        let variance: f32 = codes.iter().map(square).sum();
        match variance > 0.0 {
            true => Self {
                scale: (LENGTH / variance).sqrt(),
                mean,
            },
            false => Self::none(),
        }
    }

    /// A code as hypernetworks see it.
    pub fn apply(&self, code: &StyleCode) -> StyleCode {
        let numbers = code.0.iter().zip(&self.mean);
        StyleCode(numbers.map(|(c, m)| (c - m) * self.scale).collect())
    }
}

/// What an appearance is predicted from.
#[derive(Debug, Clone, Copy)]
pub struct PaintingInputs<'a> {
    /// The style code.
    pub code: &'a StyleCode,
    /// The painting's own detail, see [`exemplar`](crate::exemplar).
    pub exemplar: &'a [f32],
    /// From the scene's colours to the painting's.
    pub palette: Palette,
}

/// Everything that predicts a stylised appearance.
#[derive(Debug, Clone)]
pub struct StyleModel {
    /// What comes before the hypernetworks; not trained.
    pub codes: CodeNormalisation,
    /// Hypernetworks of the inner and the outer `app`, or one for both where they see the same things.
    pub hyper: Vec<Hypernetwork>,
    /// Their weights, after those for the first field of a cascade, where there is one.
    pub levels: Vec<Vec<HypernetworkWeights>>,
}

/// The hypernetworks' sizes for a configuration.
pub fn hypernetworks(field: &Field, config: &TrainConfig) -> Vec<Hypernetwork> {
    let (app, settings) = (config.style_appearance(), &config.style);
    let one = |features: &usize| {
        Hypernetwork::new(
            StyleCode::LEN,
            settings.hyper_width,
            app.network(*features).layers(),
            settings.predicted_layers,
        )
    };
    let volumes = field.features();
    // A painter sees the same in both volumes.
    let apart = app.shading.paint().map_or(volumes.len(), |_| 1);
    volumes[..apart].iter().map(one).collect()
}

impl StyleModel {
    /// Random weights.
    pub fn init(field: &Field, config: &TrainConfig, rng: &mut Pcg64, device: &Device) -> Self {
        let hyper = hypernetworks(field, config);
        let levels = (0..config.field.levels())
            .map(|_| hyper.iter().map(|h| h.init(rng, device)).collect())
            .collect();
        Self {
            codes: CodeNormalisation::none(),
            hyper,
            levels,
        }
    }

    /// Zero weights, for reading.
    pub fn zeros(field: &Field, config: &TrainConfig, device: &Device) -> Self {
        let hyper = hypernetworks(field, config);
        let zeros = |h: &Hypernetwork| {
            let layers = h.lengths().into_iter().map(|n| Tensor::zeros([n], device));
            HypernetworkWeights(layers.collect())
        };
        Self {
            codes: CodeNormalisation::none(),
            levels: (0..config.field.levels())
                .map(|_| hyper.iter().map(zeros).collect())
                .collect(),
            hyper,
        }
    }

    /// The appearances of a painting, level by level: the field's is the last.
    pub fn appearances(
        &self,
        config: &TrainConfig,
        painting: &PaintingInputs<'_>,
        device: &Device,
    ) -> Vec<Appearance> {
        let code = self.codes.apply(painting.code).tensor(device);
        let app = config.style_appearance();
        let paint = app.shading.paint().map(|_| Brushwork {
            exemplar: vector(painting.exemplar.to_vec(), device),
            palette: painting.palette,
            strokes: StrokeSettings::default(),
        });
        let of_level = |weights: &Vec<HypernetworkWeights>| {
            let networks = self.hyper.iter().zip(weights);
            let mut apps = networks.map(|(network, own)| network.predict(own, &code));
            let inner = apps.next()?;
            Some(Appearance {
                config: app.clone(),
                outer: apps.next().unwrap_or_else(|| inner.clone()),
                inner,
                paint: paint.clone(),
                latent: None,
            })
        };
        self.levels.iter().filter_map(of_level).collect()
    }
}

impl Parameters for StyleModel {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        let mut levels = Vec::new();
        for (i, weights) in self.levels.iter().enumerate() {
            // The field's level is the last, a cascade's first field comes before it.
            let level = match i + 1 < self.levels.len() {
                true => "coarse.",
                false => "",
            };
            let volumes: &[&str] = match weights.len() {
                1 => &[""],
                _ => &["inner.", "outer."],
            };
            let mut volume = |(volume, weights): (&&str, &HypernetworkWeights)| {
                let layers = weights.0.iter().enumerate();
                let layers = layers.map(|(l, t)| f(&format!("{level}{volume}hypernetwork.{l}"), t));
                Ok(HypernetworkWeights(layers.collect::<Result<_, E>>()?))
            };
            let volumes = volumes.iter().zip(weights);
            levels.push(volumes.map(&mut volume).collect::<Result<_, E>>()?);
        }
        Ok(Self {
            codes: self.codes.clone(),
            hyper: self.hyper.clone(),
            levels,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalised_codes_lie_around_zero() {
        let code = |x: f32| StyleCode((0..StyleCode::LEN).map(|i| 7.0 + x * i as f32).collect());
        let codes: Vec<_> = [0.1, 0.2, 0.6].map(code).into_iter().collect();
        let normalisation = CodeNormalisation::of(&codes);
        let found: Vec<_> = codes.iter().map(|c| normalisation.apply(c)).collect();
        for i in 0..StyleCode::LEN {
            let mean = found.iter().map(|c| c.0[i]).sum::<f32>() / 3.0;
            assert!(mean.abs() < 1e-3, "{mean}");
        }
        let lengths = found.iter().map(|c| c.0.iter().map(|x| x * x).sum::<f32>());
        assert!((lengths.sum::<f32>() / 3.0 / LENGTH - 1.0).abs() < 1e-3);
        // Nothing is known of one alone.
        let alone = CodeNormalisation::of(&codes[..1]);
        assert_eq!(alone, CodeNormalisation::none());
        assert_eq!(alone.apply(&codes[0]), codes[0]);
    }
}
