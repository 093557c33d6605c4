//! What a photometric loss of rays is made of.

use crate::cpu::composite::{CompositeLayout, RaySpan};
use crate::cpu::math::exp;
use crate::cpu::mlp::MlpSpec;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Colours.
pub(crate) const CHANNELS: usize = 3;
/// Numbers of a composited ray, and which of them are its depth and its distortion.
pub(crate) const OUTPUTS: usize = CompositeLayout::outputs(CHANNELS);
pub(crate) const DEPTH: usize = CHANNELS + 1;
pub(crate) const DISTORTION: usize = CHANNELS + 2;

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
    pub(crate) fn slope(self, x: f32, density: f32) -> f32 {
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
    /// Distance from which on samples get their whole gradient; see
    /// [`learned`](crate::cpu::composite::learned).
    pub learned_from: f32,
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
    pub fn map<U>(self, f: impl FnMut(T) -> U) -> Volume<U> {
        Volume::from_array(self.into_array().map(f))
    }
}

/// Inner and outer samples of neighbouring rays.
pub(super) fn ranges(rays: &[RaySpan]) -> [Range<usize>; 2] {
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
