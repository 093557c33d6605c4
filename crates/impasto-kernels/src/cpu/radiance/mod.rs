//! From encoded samples to a photometric loss and back, a few rays at a time: `base`, `geo`, `app`
//! and compositing forward, the loss, then all of it backward while every activation is still in
//! cache. Nothing is computed twice.

pub(crate) mod spec;
mod tile;

pub use spec::{Density, RadianceSpec, Volume, VolumeSpec};

use super::composite::RaySpan;
use pulp::Arch;
use rayon::prelude::*;
use spec::{CHANNELS, ranges};
use tile::{Outputs, PackedVolume, PieceSums, RayPiece};

/// A loss and what it depends on.
#[derive(Debug, Clone)]
pub struct Radiance {
    /// The loss.
    pub loss: f32,
    /// Its part that is the mean squared difference of colours.
    pub error: f32,
    /// Density of each sample, in layout order.
    pub densities: Vec<f32>,
    /// Gradients of the loss, inner and outer volume.
    pub grads: [Volume<Vec<f32>>; 2],
}

/// Most pieces the rays are cut into; fixed, so that sums do not depend on the number of threads.
const PIECES: usize = 8;

/// `mean((colour − target)²) + depth · mean(Σ w·depth) + distortion · mean(distortion)` over all
/// rays, and its gradients for encodings and parameters of both volumes.
///
/// # Panics
/// If slices do not have their stated lengths or samples are packed otherwise.
pub fn loss(spec: &RadianceSpec, volumes: &[Volume<&[f32]>; 2]) -> Radiance {
    let rays = &spec.layout.rays;
    let counts = spec.check([0, 1].map(|v| volumes[v].encoded.len()));
    let [inner, outer] = [0, 1].map(|v| PackedVolume::new(&spec.volumes[v], &volumes[v]));
    let packed = [&inner, &outer];
    let mut encoded = [0, 1].map(|v| vec![0.0; counts[v] * packed[v].base.spec.inputs()]);
    let mut densities = counts.map(|n| vec![0.0; n]);
    let per_piece = rays.len().div_ceil(PIECES).max(1);
    let widths = packed.map(|p| p.base.spec.inputs());
    let parts: Vec<PieceSums> =
        outputs(rays.chunks(per_piece), widths, &mut encoded, &mut densities)
            .into_par_iter()
            .enumerate()
            .map(|(i, (rays, out))| {
                Arch::new().dispatch(RayPiece {
                    spec,
                    packed,
                    volumes,
                    first_ray: i * per_piece,
                    rays,
                    out,
                })
            })
            .collect();

    let mut total = PieceSums::new(spec);
    parts.into_iter().for_each(|part| total.add(part));
    let n = rays.len().max(1) as f64;
    let error = total.error / (n * CHANNELS as f64);
    let loss = error
        + f64::from(spec.depth) * total.depth / n
        + f64::from(spec.distortion) * total.distortion / n;
    for (grads, encoded) in total.grads.iter_mut().zip(encoded) {
        grads.encoded = encoded;
    }
    Radiance {
        loss: loss as f32,
        error: error as f32,
        densities: densities.concat(),
        grads: total.grads,
    }
}

/// Cuts what is written per sample into what belongs to each piece of rays.
fn outputs<'a>(
    pieces: impl Iterator<Item = &'a [RaySpan]>,
    widths: [usize; 2],
    encoded: &'a mut [Vec<f32>; 2],
    densities: &'a mut [Vec<f32>; 2],
) -> Vec<(&'a [RaySpan], Outputs<'a>)> {
    let ([inner_e, outer_e], [inner_d, outer_d]) = (encoded, densities);
    let mut left: Outputs<'a> = [(inner_e, inner_d), (outer_e, outer_d)];
    let pieces = pieces.map(|rays| {
        let ranges = ranges(rays);
        let own = [0, 1].map(|v| {
            let (encoded, densities) = std::mem::take(&mut left[v]);
            let count = ranges[v].len();
            let (own_e, rest_e) = encoded.split_at_mut(count * widths[v]);
            let (own_d, rest_d) = densities.split_at_mut(count);
            left[v] = (rest_e, rest_d);
            (own_e, own_d)
        });
        (rays, own)
    });
    pieces.collect()
}
