//! What predicts stylised appearances.

use crate::config::TrainConfig;
use burn::tensor::{Device, Tensor};
use impasto_field::{Appearance, CanvasWeights, Field, Parameters};
use impasto_style::{Hypernetwork, HypernetworkWeights, StyleCode};
use rand_pcg::Pcg64;

/// Everything that predicts a stylised appearance.
#[derive(Debug, Clone)]
pub struct StyleModel {
    /// Hypernetworks of the inner and the outer `app`.
    pub hyper: [Hypernetwork; 2],
    /// Their weights, after those for the first field of a cascade, where there is one.
    pub levels: Vec<[HypernetworkWeights; 2]>,
    /// The canvas encoding, where the appearance has one.
    pub canvas: Option<CanvasWeights>,
}

/// The hypernetworks' sizes for a configuration.
pub fn hypernetworks(field: &Field, config: &TrainConfig) -> [Hypernetwork; 2] {
    let (app, settings) = (config.style_appearance(), &config.style);
    field.features().map(|features| {
        Hypernetwork::new(
            StyleCode::LEN,
            settings.hyper_width,
            app.network(features).layers(),
            settings.predicted_layers,
        )
    })
}

impl StyleModel {
    /// Random weights.
    pub fn init(field: &Field, config: &TrainConfig, rng: &mut Pcg64, device: &Device) -> Self {
        let hyper = hypernetworks(field, config);
        let levels =
            (0..config.field.levels()).map(|_| hyper.each_ref().map(|h| h.init(rng, device)));
        let levels = levels.collect();
        let app = config.style_appearance();
        Self {
            hyper,
            levels,
            canvas: Appearance::init(app, field.features(), rng, device).canvas,
        }
    }

    /// Zero weights, for reading.
    pub fn zeros(field: &Field, config: &TrainConfig, device: &Device) -> Self {
        let hyper = hypernetworks(field, config);
        let zeros = |h: &Hypernetwork| {
            let layers = h.lengths().into_iter().map(|n| Tensor::zeros([n], device));
            HypernetworkWeights(layers.collect())
        };
        let level = || hyper.each_ref().map(zeros);
        Self {
            levels: (0..config.field.levels()).map(|_| level()).collect(),
            canvas: Appearance::zeros(config.style_appearance(), field.features(), device).canvas,
            hyper,
        }
    }

    /// The appearances that belong to a style code, level by level: the field's is the last.
    pub fn appearances(
        &self,
        config: &TrainConfig,
        code: &StyleCode,
        device: &Device,
    ) -> Vec<Appearance> {
        let code = code.tensor(device);
        let levels = self.levels.iter().map(|[inner, outer]| Appearance {
            config: config.style_appearance(),
            inner: self.hyper[0].predict(inner, &code),
            outer: self.hyper[1].predict(outer, &code),
            canvas: self.canvas.clone(),
            latent: None,
        });
        levels.collect()
    }
}

impl Parameters for StyleModel {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        let mut levels = Vec::new();
        for (i, [inner, outer]) in self.levels.iter().enumerate() {
            // The field's level is the last, a cascade's first field comes before it.
            let level = if i + 1 < self.levels.len() {
                "coarse."
            } else {
                ""
            };
            let mut volume = |volume: &str, weights: &HypernetworkWeights| {
                let layers = weights.0.iter().enumerate();
                let layers =
                    layers.map(|(l, t)| f(&format!("{level}{volume}.hypernetwork.{l}"), t));
                Ok(HypernetworkWeights(layers.collect::<Result<_, E>>()?))
            };
            levels.push([volume("inner", inner)?, volume("outer", outer)?]);
        }
        Ok(Self {
            hyper: self.hyper.clone(),
            levels,
            canvas: self.canvas.as_ref().map(|c| c.try_map(f)).transpose()?,
        })
    }
}
