//! A field in training (PAPER §4): the loss of rays with its gradients, and the density grids that
//! learn along.

use crate::encoding::frequencies;
use crate::field::{Field, RadianceField};
use crate::sampling::Samples;
use burn::tensor::Tensor;
use impasto_kernels::{RadianceSpec, ops};
use std::sync::Arc;

/// What a batch of rays should look like, and what else counts.
#[derive(Debug, Clone)]
pub struct RayTargets {
    /// `rays × 3`.
    pub colours: Vec<f32>,
    /// Weight of the mean `Σ weight · depth`.
    pub depth: f32,
    /// Weight of the mean distortion (Barron et al. 2022).
    pub distortion: f32,
}

impl Field {
    /// Loss of rays against their targets, of which the first number has gradients: the loss, its
    /// mean squared difference of colours, then each sample's density.
    ///
    /// Every sample is shaded: `app` must be of [`crate::Shading::Samples`].
    pub fn loss(&self, level: &RadianceField, samples: &Samples, targets: RayTargets) -> Tensor<1> {
        let RadianceField { weights, app } = level;
        let bands = app.config.app.view_bands;
        let networks =
            [&self.inner, &self.outer].map(|branch| app.config.network(branch.features()));
        let spec = RadianceSpec {
            volumes: [
                self.inner.volume_spec(&networks[0]),
                self.outer.volume_spec(&networks[1]),
            ],
            layout: Arc::clone(&samples.layout),
            views: bands.map_or_else(Vec::new, |bands| frequencies(&samples.views, 3, bands)),
            targets: targets.colours,
            depth: targets.depth,
            distortion: targets.distortion,
        };
        let folded = |i: usize, weights| networks[i].folded(weights, app.latent.as_ref());
        let latent = weights.latent.as_ref();
        let (inner, outer) = (samples.inner.positions(3), samples.outer.positions(4));
        let volumes = [
            self.inner
                .volume(&weights.inner, latent, &inner, folded(0, &app.inner)),
            self.outer
                .volume(&weights.outer, latent, &outer, folded(1, &app.outer)),
        ];
        ops::radiance_loss(volumes, Arc::new(spec))
    }
}
