//! The loss of rays, in one operation.

use super::step::LossWeights;
use crate::encoding::frequencies;
use crate::field::{Field, RadianceField};
use crate::rays::contracted_distance;
use crate::sampling::Samples;
use burn::tensor::Tensor;
use impasto_kernels::{CompositeLayout, RadianceSpec, ops};
use std::sync::Arc;

/// Replaces the samples' depths by their distance from the surface that is known on their ray, or
/// by zero: the composite's expected depth becomes the expected distance from that surface.
pub(crate) fn measure_from_surfaces(samples: &mut Samples, surfaces: &[Option<f32>]) {
    let CompositeLayout {
        rays,
        depths,
        distances,
        ..
    } = Arc::make_mut(&mut samples.layout);
    depths.fill(0.0);
    for (span, surface) in rays.iter().zip(surfaces) {
        let Some(surface) = surface.map(contracted_distance) else {
            continue;
        };
        for i in span.inner.clone().chain(span.outer.clone()) {
            depths[i] = (distances[i] - surface).abs();
        }
    }
}

impl Field {
    /// Loss of samples' rays against their colours (`rays × 3`), of which the first number has
    /// gradients: the loss, its mean squared difference of colours, then each sample's density. The
    /// samples' depths count by the weight of surfaces.
    ///
    /// Every sample is shaded: `app` must be of [`crate::Shading::Samples`].
    pub fn loss(
        &self,
        level: &RadianceField,
        samples: &Samples,
        colours: Vec<f32>,
        weights: LossWeights,
    ) -> Tensor<1> {
        let RadianceField {
            weights: field,
            app,
        } = level;
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
            targets: colours,
            depth: weights.surface,
            distortion: weights.distortion,
            learned_from: weights.learned_from,
        };
        let folded = |i: usize, weights| networks[i].folded(weights, app.latent.as_ref());
        let latent = field.latent.as_ref();
        let (inner, outer) = (samples.inner.positions(3), samples.outer.positions(4));
        let volumes = [
            self.inner
                .volume(&field.inner, latent, &inner, folded(0, &app.inner)),
            self.outer
                .volume(&field.outer, latent, &outer, folded(1, &app.outer)),
        ];
        ops::radiance_loss(volumes, Arc::new(spec))
    }
}
