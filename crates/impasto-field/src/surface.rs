//! A ray's samples merged to one per volume.

use crate::encoding::matrix;
use crate::render::{Geometry, host};
use crate::sampling::{Samples, VolumeSamples};
use burn::tensor::{Device, Tensor};
use impasto_kernels::cpu::composite::{LEAST_SHARE, OPAQUE};
use impasto_kernels::cpu::passes;
use impasto_kernels::{CompositeLayout, RaySpan};
use std::ops::Range;
use std::sync::Arc;

impl Geometry {
    /// The same rays with one sample per volume: the mean, weighted by contribution, of features
    /// and positions. The inner one is as opaque as all of them together; the outer one takes what
    /// light is left, and is left out where that is nothing. No gradients.
    ///
    /// `weights` are the samples' contributions, as of [`Self::weights`].
    pub(crate) fn merged(self, weights: &[f32]) -> Self {
        let device = self.density.device();
        let features = [self.inner, self.outer].map(|features| {
            let width = features.as_ref().map_or(1, |f| f.dims()[1]);
            (features.map(host).unwrap_or_default(), width)
        });
        let features = features.each_ref().map(|(f, width)| (f.as_slice(), *width));
        Self::merged_of((&self.samples, None), features, weights, &device)
    }

    /// [`Self::merged`] of samples with features of the inner and of the outer volume, and how wide
    /// those are. `views` are the rays' where samples do not know them.
    pub(crate) fn merged_of(
        (samples, views): (&Samples, Option<&[[f32; 3]]>),
        features: [(&[f32], usize); 2],
        weights: &[f32],
        device: &Device,
    ) -> Self {
        let split = samples.inner.len();
        let layout = &samples.layout;
        let (mut inner, mut outer) = (Vec::new(), Vec::new());
        let (mut parts, mut optical) = (Vec::new(), Vec::new());
        for (ray, span) in layout.rays.iter().enumerate() {
            let sum = |range: &Range<usize>| weights[range.clone()].iter().sum::<f32>();
            let (near, far) = (sum(&span.inner), sum(&span.outer));
            let share = near / (near + far).max(1e-12);
            let before = [inner.len(), outer.len()];
            let opaque = share > 1.0 - LEAST_SHARE;
            if share >= LEAST_SHARE {
                let depth = -(1.0 - share).ln();
                optical.push(if opaque { OPAQUE } else { depth });
                inner.push((ray, span.inner.clone()));
            }
            if !opaque {
                outer.push((ray, span.outer.start - split..span.outer.end - split));
            }
            parts.push([before[0]..inner.len(), before[1]..outer.len()]);
        }
        let (in_front, behind) = (inner.len(), outer.len());
        optical.extend(std::iter::repeat_n(OPAQUE, behind));
        let rays = parts.into_iter().map(|[inner, outer]| RaySpan {
            inner,
            outer: in_front + outer.start..in_front + outer.end,
        });
        let rays = rays.collect();
        let volume = |source, dimensions, rows: Range<usize>, features, rays: &[_]| {
            let steps = [&layout.depths, &layout.distances].map(|all| &all[rows.clone()]);
            let merging = Merging::new(rays, &weights[rows]);
            merging.merged((source, dimensions), features, steps, views)
        };
        let inner = volume(&samples.inner, 3, 0..split, features[0], &inner);
        let outer = volume(&samples.outer, 4, split..weights.len(), features[1], &outer);
        let layout = CompositeLayout {
            rays,
            deltas: vec![1.0; optical.len()],
            depths: [inner.depths, outer.depths].concat(),
            distances: [inner.distances, outer.distances].concat(),
        };
        Self {
            inner: (in_front > 0).then(|| matrix(inner.rows, features[0].1, device)),
            outer: (behind > 0).then(|| matrix(outer.rows, features[1].1, device)),
            density: Tensor::from_data(optical.as_slice(), device),
            samples: Samples {
                inner: inner.samples,
                outer: outer.samples,
                layout: Arc::new(layout),
            },
        }
    }
}

/// Rays that have samples in a volume, and what of each of these samples is in the mean.
struct Merging<'a> {
    /// Numbers of rays, and the volume's samples that are theirs.
    rays: &'a [(usize, Range<usize>)],
    /// Of each sample of the volume; those of a ray sum to one.
    shares: Vec<f32>,
}

/// One volume's merged samples.
struct Merged {
    rows: Vec<f32>,
    samples: VolumeSamples,
    depths: Vec<f32>,
    distances: Vec<f32>,
}

impl<'a> Merging<'a> {
    fn new(rays: &'a [(usize, Range<usize>)], weights: &[f32]) -> Self {
        let mut shares = weights.to_vec();
        for (_, span) in rays {
            normalise(&mut shares[span.clone()]);
        }
        Self { rays, shares }
    }

    fn means(&self, (data, width): (&[f32], usize)) -> Vec<f32> {
        let spans = self.rays.iter().map(|(_, span)| span.clone());
        passes::means((data, width), spans, &self.shares)
    }

    fn merged(
        &self,
        (source, dimensions): (&VolumeSamples, usize),
        features: (&[f32], usize),
        [depths, distances]: [&[f32]; 2],
        views: Option<&[[f32; 3]]>,
    ) -> Merged {
        let cube = self.means((&source.cube, 3));
        let (means, _) = cube.as_chunks::<3>();
        let spreads = means.iter().zip(self.rays).map(|(mean, (_, span))| {
            let points = &source.cube[3 * span.start..3 * span.end];
            let own = source.spreads.get(span.clone()).unwrap_or_default();
            spread((points, own), mean, &self.shares[span.clone()])
        });
        let spreads = spreads.collect();
        Merged {
            rows: self.means(features),
            samples: VolumeSamples {
                raw: match source.raw.is_empty() {
                    true => Vec::new(),
                    false => self.means((&source.raw, dimensions)),
                },
                views: match views {
                    Some(views) => self.rays.iter().flat_map(|(ray, _)| views[*ray]).collect(),
                    None => self.means((&source.views, 3)),
                },
                cube,
                spreads,
            },
            depths: self.means((depths, 1)),
            distances: self.means((distances, 1)),
        }
    }
}

/// Standard deviation of points, `n × 3`, about their weighted mean; of points that were merged
/// before, with their own, `n`.
fn spread((points, own): (&[f32], &[f32]), mean: &[f32], weights: &[f32]) -> f32 {
    let own = own.iter().copied().chain(std::iter::repeat(0.0));
    let squares = points.chunks_exact(3).zip(own).map(|(point, own)| {
        let off = point.iter().zip(mean).map(|(x, mean)| (x - mean).powi(2));
        off.sum::<f32>() + own.powi(2)
    });
    let weighed = squares.zip(weights).map(|(square, weight)| weight * square);
    weighed.sum::<f32>().sqrt()
}

/// Makes weights sum to one; all on the last, the farthest, if none carries light.
fn normalise(weights: &mut [f32]) {
    let sum: f32 = weights.iter().sum();
    if sum > 1e-9 {
        weights.iter_mut().for_each(|w| *w /= sum);
    } else {
        weights.fill(0.0);
        weights.iter_mut().rev().take(1).for_each(|w| *w = 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_one_place_has_no_spread() {
        // Along x at 0, 0.2 and 0.4.
        let points = [0.0, 0.5, 0.5, 0.2, 0.5, 0.5, 0.4, 0.5, 0.5];
        let of = |own: &[f32], weights: [f32; 3], mean: f32| {
            spread((&points, own), &[mean, 0.5, 0.5], &weights)
        };
        let found = |weights: [f32; 3], mean: f32| of(&[], weights, mean);
        assert!(found([0.0, 1.0, 0.0], 0.2).abs() < 1e-6);
        assert!((found([0.5, 0.0, 0.5], 0.2) - 0.2).abs() < 1e-6);
        // 0.25 * 0.15² + 0.5 * 0.05² + 0.25 * 0.25², about 0.15.
        let uneven = (0.25 * 0.0225 + 0.5 * 0.0025 + 0.25 * 0.0625_f32).sqrt();
        assert!((found([0.25, 0.5, 0.25], 0.15) - uneven).abs() < 1e-6);
        // Merged before: their own spread remains, and adds to the one between them.
        assert!((of(&[0.0, 0.3, 0.0], [0.0, 1.0, 0.0], 0.2) - 0.3).abs() < 1e-6);
        let both = of(&[0.3, 0.0, 0.3], [0.5, 0.0, 0.5], 0.2);
        assert!((both - (0.04 + 0.09_f32).sqrt()).abs() < 1e-6);
    }
}
