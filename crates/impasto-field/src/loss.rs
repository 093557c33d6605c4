//! The loss of the geometry stage (PAPER §4), in one operation.

use crate::appearance::Appearance;
use crate::encoding::frequencies;
use crate::field::{Field, FieldWeights};
use crate::sampling::Samples;
use burn::tensor::Tensor;
use impasto_kernels::{RadianceSpec, ops};
use std::sync::Arc;

/// What a batch of rays should look like, and what else counts.
#[derive(Debug, Clone)]
pub struct Wanted {
    /// `rays × 3`.
    pub colours: Vec<f32>,
    /// Weight of the mean `Σ contribution · depth`.
    pub depth: f32,
    /// Weight of the mean distortion (Barron et al. 2022).
    pub distortion: f32,
}

impl Field {
    /// Loss of rays against their wanted colours, of which the first number has gradients: the
    /// loss, its mean squared difference of colours, then each sample's density.
    ///
    /// Every sample is shaded: `app` must be of [`crate::Shading::Samples`] and has no canvas.
    pub fn loss(
        &self,
        weights: &FieldWeights,
        app: &Appearance,
        samples: &Samples,
        wanted: Wanted,
    ) -> Tensor<1> {
        let split = samples.inner.len();
        let (views, _) = samples.outer.views.as_chunks::<3>();
        let directions = samples.layout.rays.iter().flat_map(|span| {
            // Every ray has a farthest sample in the outer volume.
            views[span.outer.end - 1 - split]
        });
        let views = app
            .config
            .view_bands
            .map(|bands| frequencies(&directions.collect::<Vec<_>>(), 3, bands));
        let networks = [(&self.inner, 3), (&self.outer, 4)]
            .map(|(branch, dimensions)| app.config.network(branch.features(), dimensions));
        let spec = RadianceSpec {
            volumes: [
                self.inner.volume_spec(&networks[0]),
                self.outer.volume_spec(&networks[1]),
            ],
            layout: Arc::clone(&samples.layout),
            views: views.unwrap_or_default(),
            targets: wanted.colours,
            depth: wanted.depth,
            distortion: wanted.distortion,
        };
        let latent = app.latent.as_ref();
        let (inner, outer) = (samples.inner.positions(3), samples.outer.positions(4));
        let volumes = [
            self.inner
                .volume(&weights.inner, &inner, (&networks[0], &app.inner), latent),
            self.outer
                .volume(&weights.outer, &outer, (&networks[1], &app.outer), latent),
        ];
        ops::radiance_loss(volumes, Arc::new(spec))
    }
}
