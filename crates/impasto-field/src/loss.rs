//! The loss of the geometry stage (PAPER §4), in one operation where all networks are plain
//! chains.

use crate::appearance::Appearance;
use crate::branch::BranchWeights;
use crate::encoding::{frequencies, matrix};
use crate::field::{Field, FieldWeights};
use crate::sampling::Samples;
use burn::tensor::Tensor;
use impasto_kernels::{RadianceSpec, Volume, VolumeSpec, ops};
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
        let volumes = [&self.inner, &self.outer].map(|branch| branch.volume_spec(&app.config));
        match volumes {
            [Some(inner), Some(outer)] => {
                self.fused_loss((weights, app), samples, wanted, [inner, outer])
            }
            _ => self.composed_loss((weights, app), samples, wanted),
        }
    }

    /// Of any networks, operation by operation.
    fn composed_loss(
        &self,
        (weights, app): (&FieldWeights, &Appearance),
        samples: &Samples,
        wanted: Wanted,
    ) -> Tensor<1> {
        let geometry = self.geometry(weights, samples.clone());
        let densities = geometry.densities();
        let pixels = geometry.composite(app);
        let colours = matrix(wanted.colours, 3, &pixels.device());
        let error = (pixels.clone().slice_dim(1, 0..3) - colours)
            .square()
            .mean();
        let mean = |column| pixels.clone().slice_dim(1, column..column + 1).mean();
        let loss = error.clone() + mean(4) * wanted.depth + mean(5) * wanted.distortion;
        Tensor::cat(vec![loss, error, densities], 0)
    }

    fn fused_loss(
        &self,
        (weights, app): (&FieldWeights, &Appearance),
        samples: &Samples,
        wanted: Wanted,
        volumes: [VolumeSpec; 2],
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
        let spec = RadianceSpec {
            volumes,
            layout: Arc::clone(&samples.layout),
            views: views.unwrap_or_default(),
            targets: wanted.colours,
            depth: wanted.depth,
            distortion: wanted.distortion,
        };
        let volume = |encoded: Tensor<2>, weights: &BranchWeights, app: &Tensor<1>| {
            let [rows, width] = encoded.dims();
            Volume {
                encoded: encoded.reshape([rows * width]),
                base: weights.base.clone(),
                geo: weights.geo.clone(),
                app: app.clone(),
            }
        };
        let inner = self
            .inner
            .encode(&weights.inner, &samples.inner.positions(3));
        let outer = self
            .outer
            .encode(&weights.outer, &samples.outer.positions(4));
        let volumes = [
            volume(inner, &weights.inner, &app.inner),
            volume(outer, &weights.outer, &app.outer),
        ];
        ops::radiance_loss(volumes, Arc::new(spec))
    }
}
