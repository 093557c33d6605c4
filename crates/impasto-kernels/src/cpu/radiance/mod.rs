//! From encoded samples to a photometric loss and back, a few rays at a time: `base`, `geo`, `app`
//! and compositing forward, the loss, then all of it backward while every activation is still in
//! cache. Nothing is computed twice.

mod tile;

use super::composite::{CompositeLayout, RaySpan};
use super::math::exp;
use super::mlp::{MlpSpec, Packed};
use pulp::Arch;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;
use tile::Piece;

/// How the last number of `geo` becomes a density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Density {
    /// `e^x`, with x limited to ±15.
    Exp,
    /// `|x|`, the paper's.
    Abs,
}

impl Density {
    #[inline(always)]
    pub(crate) fn of(self, x: f32) -> f32 {
        match self {
            Self::Exp => exp(limited(x)),
            Self::Abs => x.abs(),
        }
    }

    /// Derivative at `x`, where the density is `density`.
    #[inline(always)]
    fn slope(self, x: f32, density: f32) -> f32 {
        match self {
            Self::Exp if x.abs() <= LIMIT => density,
            Self::Exp => 0.0,
            Self::Abs if x > 0.0 => 1.0,
            Self::Abs if x < 0.0 => -1.0,
            Self::Abs => 0.0,
        }
    }
}

pub(crate) const LIMIT: f32 = 15.0;

/// Written so that NaN stays NaN.
#[inline(always)]
fn limited(x: f32) -> f32 {
    let x = if x < -LIMIT { -LIMIT } else { x };
    if x > LIMIT { LIMIT } else { x }
}

/// Layers of one volume.
#[derive(Debug, Clone)]
pub struct VolumeSpec {
    /// From encoding to features.
    pub base: MlpSpec,
    /// From features to one number.
    pub geo: MlpSpec,
    /// What that number says.
    pub density: Density,
    /// From features, then the ray's encoded view, to colour.
    pub app: MlpSpec,
}

/// Everything about a batch of rays that is not differentiated.
#[derive(Debug, Clone)]
pub struct RadianceSpec {
    /// Inner, then outer volume.
    pub volumes: [VolumeSpec; 2],
    /// Samples, packed ray by ray: all inner ones first, then all outer ones, no gaps.
    pub layout: Arc<CompositeLayout>,
    /// Encoded view of each ray; empty if `app` does not see it.
    pub views: Vec<f32>,
    /// Wanted colour of each ray.
    pub targets: Vec<f32>,
    /// Weight of the mean `Σ weight · depth`.
    pub depth: f32,
    /// Weight of the mean distortion.
    pub distortion: f32,
}

/// One volume's numbers: what goes in, or its gradient.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Volume<T> {
    /// Encoded samples, `n × inputs of base`.
    pub encoded: T,
    /// Parameters of `base`.
    pub base: T,
    /// Parameters of `geo`.
    pub geo: T,
    /// Parameters of `app`.
    pub app: T,
}

impl<T> Volume<T> {
    /// From encoding, base, geo and app.
    pub fn from_array([encoded, base, geo, app]: [T; 4]) -> Self {
        Self {
            encoded,
            base,
            geo,
            app,
        }
    }

    /// The inverse of [`Self::from_array`].
    pub fn into_array(self) -> [T; 4] {
        [self.encoded, self.base, self.geo, self.app]
    }

    /// The same by reference.
    pub fn as_ref(&self) -> Volume<&T> {
        Volume {
            encoded: &self.encoded,
            base: &self.base,
            geo: &self.geo,
            app: &self.app,
        }
    }

    /// The same of something else.
    pub fn map<U>(self, mut f: impl FnMut(T) -> U) -> Volume<U> {
        Volume {
            encoded: f(self.encoded),
            base: f(self.base),
            geo: f(self.geo),
            app: f(self.app),
        }
    }
}

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

/// Colours.
const CHANNELS: usize = 3;
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
                Arch::new().dispatch(Piece {
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
    let [inner, outer] = total.grads;
    let [inner_encoded, outer_encoded] = encoded;
    Radiance {
        loss: loss as f32,
        error: error as f32,
        densities: densities.concat(),
        grads: [
            Volume {
                encoded: inner_encoded,
                ..inner
            },
            Volume {
                encoded: outer_encoded,
                ..outer
            },
        ],
    }
}

/// Where the gradients of a piece's encodings and its densities go, of both volumes.
type Outputs<'a> = [(&'a mut [f32], &'a mut [f32]); 2];

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

/// Inner and outer samples of neighbouring rays.
fn ranges(rays: &[RaySpan]) -> [Range<usize>; 2] {
    match (rays.first(), rays.last()) {
        (Some(first), Some(last)) => [
            first.inner.start..last.inner.end,
            first.outer.start..last.outer.end,
        ],
        _ => [0..0, 0..0],
    }
}

impl RadianceSpec {
    /// Samples of both volumes, given the lengths of their encodings.
    ///
    /// # Panics
    /// If lengths do not fit each other or samples are packed otherwise.
    pub(crate) fn check(&self, encoded: [usize; 2]) -> [usize; 2] {
        let rays = &self.layout.rays;
        let [inner, outer] = ranges(rays);
        for pair in rays.windows(2) {
            let packed = |a: &Range<usize>, b: &Range<usize>| a.end == b.start;
            assert!(
                packed(&pair[0].inner, &pair[1].inner) && packed(&pair[0].outer, &pair[1].outer),
                "samples of a radiance loss are packed ray by ray"
            );
        }
        assert!(
            inner.start == 0 && outer.start == inner.end,
            "inner samples come first"
        );
        let counts = [inner.len(), outer.len()];
        for ((encoded, spec), n) in encoded.into_iter().zip(&self.volumes).zip(counts) {
            assert_eq!(encoded, n * spec.base.inputs(), "encoded samples");
        }
        let steps = &self.layout;
        for values in [&steps.deltas, &steps.depths, &steps.distances] {
            assert_eq!(values.len(), counts[0] + counts[1], "samples of a layout");
        }
        assert_eq!(self.targets.len(), rays.len() * CHANNELS, "wanted colours");
        for volume in &self.volumes {
            let view = volume.app.inputs() - volume.base.outputs();
            assert_eq!(self.views.len(), rays.len() * view, "encoded views");
            assert_eq!((volume.geo.outputs(), volume.app.outputs()), (1, CHANNELS));
        }
        counts
    }
}

struct PackedVolume<'a> {
    base: Packed<'a>,
    geo: Packed<'a>,
    app: Packed<'a>,
    density: Density,
}

impl<'a> PackedVolume<'a> {
    fn new(spec: &'a VolumeSpec, volume: &Volume<&'a [f32]>) -> Self {
        let rows = volume.encoded.len() / spec.base.inputs();
        Self {
            base: Packed::new(&spec.base, volume.base, rows),
            geo: Packed::new(&spec.geo, volume.geo, rows),
            app: Packed::new(&spec.app, volume.app, rows),
            density: spec.density,
        }
    }
}

/// What a piece of rays adds up to.
struct PieceSums {
    error: f64,
    depth: f64,
    distortion: f64,
    /// Parameters only.
    grads: [Volume<Vec<f32>>; 2],
}

impl PieceSums {
    fn new(spec: &RadianceSpec) -> Self {
        let zeros = |spec: &VolumeSpec| Volume {
            encoded: Vec::new(),
            base: vec![0.0; spec.base.params()],
            geo: vec![0.0; spec.geo.params()],
            app: vec![0.0; spec.app.params()],
        };
        Self {
            error: 0.0,
            depth: 0.0,
            distortion: 0.0,
            grads: [zeros(&spec.volumes[0]), zeros(&spec.volumes[1])],
        }
    }

    fn add(&mut self, other: Self) {
        self.error += other.error;
        self.depth += other.depth;
        self.distortion += other.distortion;
        for (sum, other) in self.grads.iter_mut().zip(other.grads) {
            for (sum, other) in [
                (&mut sum.base, other.base),
                (&mut sum.geo, other.geo),
                (&mut sum.app, other.app),
            ] {
                sum.iter_mut().zip(other).for_each(|(s, o)| *s += o);
            }
        }
    }
}
