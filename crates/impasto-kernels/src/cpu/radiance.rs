//! From encoded samples to a photometric loss and back, a few rays at a time: `base`, `geo`, `app`
//! and compositing forward, the loss, then all of it backward while every activation is still in
//! cache. Nothing is computed twice.

use super::composite::{self, CompositeLayout, RaySpan, SpanGrads, Step};
use super::math::exp;
use super::mlp::{MlpSpec, Packed, Tape};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// How the last number of `geo` becomes a density.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Density {
    /// `e^x`, with x limited to ±15.
    Exp,
    /// `|x|`.
    Abs,
}

impl Density {
    #[inline(always)]
    fn of(self, x: f32) -> f32 {
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

const LIMIT: f32 = 15.0;

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
/// Samples that go through the layers together: their activations fit the second-level cache.
const TILE: usize = 128;
/// Most pieces the rays are cut into; fixed, so that sums do not depend on the number of threads.
const PIECES: usize = 8;

/// `mean((colour − target)²) + depth · mean(Σ w·depth) + distortion · mean(distortion)` over all
/// rays, and its gradients for encodings and parameters of both volumes.
///
/// # Panics
/// If slices do not have their stated lengths or samples are packed otherwise.
pub fn loss(spec: &RadianceSpec, volumes: &[Volume<&[f32]>; 2]) -> Radiance {
    let rays = &spec.layout.rays;
    let counts = check(spec, volumes);
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

/// Samples of both volumes.
fn check(spec: &RadianceSpec, volumes: &[Volume<&[f32]>; 2]) -> [usize; 2] {
    let rays = &spec.layout.rays;
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
    for ((volume, spec), n) in volumes.iter().zip(&spec.volumes).zip(counts) {
        assert_eq!(
            volume.encoded.len(),
            n * spec.base.inputs(),
            "encoded samples"
        );
    }
    for values in [
        &spec.layout.deltas,
        &spec.layout.depths,
        &spec.layout.distances,
    ] {
        assert_eq!(values.len(), counts[0] + counts[1], "samples of a layout");
    }
    assert_eq!(spec.targets.len(), rays.len() * CHANNELS, "wanted colours");
    for volume in &spec.volumes {
        let view = volume.app.inputs() - volume.base.outputs();
        assert_eq!(spec.views.len(), rays.len() * view, "encoded views");
        assert_eq!((volume.geo.outputs(), volume.app.outputs()), (1, CHANNELS));
    }
    counts
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

/// Neighbouring rays, and where the gradients of their encodings and their densities go.
struct Piece<'a> {
    spec: &'a RadianceSpec,
    packed: [&'a PackedVolume<'a>; 2],
    volumes: &'a [Volume<&'a [f32]>; 2],
    first_ray: usize,
    rays: &'a [RaySpan],
    out: Outputs<'a>,
}

impl WithSimd for Piece<'_> {
    type Output = PieceSums;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> PieceSums {
        let mut sums = PieceSums::new(self.spec);
        let tiles = tiles(self.rays);
        let most = tiles.iter().flat_map(|t| ranges(&self.rays[t.clone()]));
        let most = most.map(|r| r.len()).max().unwrap_or(0);
        let mut scratch = [0, 1].map(|v| VolumeScratch::new(&self.spec.volumes[v], most));
        for tile in tiles {
            self.tile(simd, tile, &mut scratch, &mut sums);
        }
        sums
    }
}

/// Cuts rays into groups of about [`TILE`] samples.
fn tiles(rays: &[RaySpan]) -> Vec<Range<usize>> {
    let mut tiles = Vec::new();
    let (mut start, mut samples) = (0, 0);
    for (i, span) in rays.iter().enumerate() {
        samples += span.inner.len() + span.outer.len();
        if samples >= TILE || i + 1 == rays.len() {
            tiles.push(start..i + 1);
            (start, samples) = (i + 1, 0);
        }
    }
    tiles
}

/// One volume's activations and gradients in a tile.
struct VolumeScratch {
    base: Tape,
    geo: Tape,
    app: Tape,
    app_input: Vec<f32>,
    app_input_grad: Vec<f32>,
    feature_grad: Vec<f32>,
    raw_grad: Vec<f32>,
}

impl VolumeScratch {
    fn new(spec: &VolumeSpec, rows: usize) -> Self {
        let zeros = |width: usize| vec![0.0; rows * width];
        Self {
            base: Tape::new(&spec.base, rows),
            geo: Tape::new(&spec.geo, rows),
            app: Tape::new(&spec.app, rows),
            app_input: zeros(spec.app.inputs()),
            app_input_grad: zeros(spec.app.inputs()),
            feature_grad: zeros(spec.base.outputs()),
            raw_grad: zeros(1),
        }
    }

    /// Densities and colours of a block of samples, given how many rows each ray has and the
    /// encoded views of the rays.
    #[inline(always)]
    fn forward<'a, S: Simd>(
        &mut self,
        simd: S,
        packed: &PackedVolume<'_>,
        encoded: &[f32],
        views: impl Iterator<Item = (usize, &'a [f32])>,
        (densities, colours): (&mut [f32], &mut [f32]),
    ) {
        let rows = densities.len();
        let width = packed.base.spec.outputs();
        self.base.forward(simd, &packed.base, encoded);
        let features = &self.base.output()[..rows * width];
        self.geo.forward(simd, &packed.geo, features);
        for (density, raw) in densities.iter_mut().zip(self.geo.output()) {
            *density = packed.density.of(*raw);
        }
        let inputs = packed.app.spec.inputs();
        let mut input = self.app_input.chunks_exact_mut(inputs);
        let mut features = features.chunks_exact(width);
        for (rows, view) in views {
            for (input, features) in input.by_ref().zip(features.by_ref()).take(rows) {
                input[..width].copy_from_slice(features);
                input[width..].copy_from_slice(view);
            }
        }
        self.app
            .forward(simd, &packed.app, &self.app_input[..rows * inputs]);
        colours.copy_from_slice(&self.app.output()[..rows * CHANNELS]);
    }

    /// The way back, for the block that went through last.
    #[inline(always)]
    fn backward<S: Simd>(
        &mut self,
        simd: S,
        packed: &PackedVolume<'_>,
        (encoded, encoded_grad): (&[f32], &mut [f32]),
        densities: &[f32],
        (density_grad, colour_grad): (&[f32], &[f32]),
        grads: &mut Volume<Vec<f32>>,
    ) {
        let rows = density_grad.len();
        let (width, inputs) = (packed.base.spec.outputs(), packed.app.spec.inputs());
        let input_grad = &mut self.app_input_grad[..rows * inputs];
        input_grad.fill(0.0);
        let input = &self.app_input[..rows * inputs];
        let app = (input, colour_grad);
        self.app
            .backward(simd, &packed.app, app, &mut grads.app, input_grad);
        let feature_grad = &mut self.feature_grad[..rows * width];
        let parts = input_grad.chunks_exact(inputs);
        for (to, from) in feature_grad.chunks_exact_mut(width).zip(parts) {
            to.copy_from_slice(&from[..width]);
        }
        let raw_grad = &mut self.raw_grad[..rows];
        let raws = self.geo.output().iter().zip(densities);
        for ((to, g), (raw, density)) in raw_grad.iter_mut().zip(density_grad).zip(raws) {
            *to = g * packed.density.slope(*raw, *density);
        }
        let features = &self.base.output()[..rows * width];
        let geo = (features, &*raw_grad);
        self.geo
            .backward(simd, &packed.geo, geo, &mut grads.geo, feature_grad);
        let base = (encoded, &*feature_grad);
        self.base
            .backward(simd, &packed.base, base, &mut grads.base, encoded_grad);
    }
}

impl Piece<'_> {
    #[inline(always)]
    fn tile<S: Simd>(
        &mut self,
        simd: S,
        tile: Range<usize>,
        scratch: &mut [VolumeScratch; 2],
        sums: &mut PieceSums,
    ) {
        let rays = &self.rays[tile.clone()];
        let global = ranges(rays);
        let split = global[0].len();
        let count = split + global[1].len();
        let layout = self.layout(rays, &global);
        let (mut densities, mut colours) = (vec![0.0; count], vec![0.0; count * CHANNELS]);
        let (spec, first) = (self.spec, self.first_ray + tile.start);
        let ray_views = |v: usize| {
            let width = spec.views.len() / spec.layout.rays.len();
            rays.iter().enumerate().map(move |(i, span)| {
                let rows = [span.inner.len(), span.outer.len()][v];
                (rows, &spec.views[(first + i) * width..][..width])
            })
        };
        let encoded = [0, 1].map(|v| {
            let width = self.packed[v].base.spec.inputs();
            let before = if v == 0 { 0 } else { self.outer_start() };
            let rows = global[v].start - before..global[v].end - before;
            &self.volumes[v].encoded[rows.start * width..rows.end * width]
        });
        for v in 0..2 {
            let part = [0..split, split..count][v].clone();
            if part.is_empty() {
                continue;
            }
            let colours = &mut colours[part.start * CHANNELS..part.end * CHANNELS];
            let out = (&mut densities[part], colours);
            scratch[v].forward(simd, self.packed[v], encoded[v], ray_views(v), out);
        }
        let (density_grad, colour_grad) =
            self.composite(&tile, &layout, (&densities, &colours), sums);
        let first = ranges(self.rays);
        for v in 0..2 {
            let part = [0..split, split..count][v].clone();
            if part.is_empty() {
                continue;
            }
            let own = global[v].start - first[v].start..global[v].end - first[v].start;
            let width = self.packed[v].base.spec.inputs();
            let (encoded_grad, kept) = &mut self.out[v];
            let encoded_grad = &mut encoded_grad[own.start * width..own.end * width];
            kept[own].copy_from_slice(&densities[part.clone()]);
            scratch[v].backward(
                simd,
                self.packed[v],
                (encoded[v], encoded_grad),
                &densities[part.clone()],
                (
                    &density_grad[part.clone()],
                    &colour_grad[part.start * CHANNELS..part.end * CHANNELS],
                ),
                &mut sums.grads[v],
            );
        }
    }

    /// Index of the first outer sample of all rays.
    fn outer_start(&self) -> usize {
        self.spec.layout.rays.first().map_or(0, |r| r.outer.start)
    }

    /// The layout of some rays alone.
    fn layout(&self, rays: &[RaySpan], global: &[Range<usize>; 2]) -> CompositeLayout {
        let [inner, outer] = global;
        let all = &self.spec.layout;
        let pick = |data: &[f32]| [&data[inner.clone()], &data[outer.clone()]].concat();
        let local = |range: &Range<usize>, start: usize, to: usize| {
            range.start - start + to..range.end - start + to
        };
        CompositeLayout {
            rays: rays
                .iter()
                .map(|span| RaySpan {
                    inner: local(&span.inner, inner.start, 0),
                    outer: local(&span.outer, outer.start, inner.len()),
                })
                .collect(),
            deltas: pick(&all.deltas),
            depths: pick(&all.depths),
            distances: pick(&all.distances),
        }
    }

    /// Adds a tile's losses; returns their gradients for densities and colours.
    fn composite(
        &self,
        tile: &Range<usize>,
        layout: &CompositeLayout,
        (densities, colours): (&[f32], &[f32]),
        sums: &mut PieceSums,
    ) -> (Vec<f32>, Vec<f32>) {
        const WIDTH: usize = CompositeLayout::outputs(CHANNELS);
        let (mut density_grad, mut colour_grad) =
            (vec![0.0; densities.len()], vec![0.0; colours.len()]);
        let opacities = composite::opacities(&layout.deltas, densities);
        let samples = (&*opacities, colours);
        let rays = self.spec.layout.rays.len() as f32;
        let mut steps: Vec<Step> = Vec::new();
        for (i, span) in layout.rays.iter().enumerate() {
            let ray = self.first_ray + tile.start + i;
            let target = &self.spec.targets[ray * CHANNELS..][..CHANNELS];
            let mut out = [0.0; WIDTH];
            composite::ray_forward(layout, span, samples, CHANNELS, &mut out);
            let mut grad = [0.0; WIDTH];
            for c in 0..CHANNELS {
                let error = out[c] - target[c];
                sums.error += f64::from(error * error);
                grad[c] = 2.0 * error / (rays * CHANNELS as f32);
            }
            sums.depth += f64::from(out[CHANNELS + 1]);
            sums.distortion += f64::from(out[CHANNELS + 2]);
            grad[CHANNELS + 1] = self.spec.depth / rays;
            grad[CHANNELS + 2] = self.spec.distortion / rays;
            // Inner samples of a tile come first: two cuts give a ray's own.
            let (inner_d, outer_d) = density_grad.split_at_mut(span.outer.start);
            let (inner_c, outer_c) = colour_grad.split_at_mut(span.outer.start * CHANNELS);
            let colours = |r: &Range<usize>| r.start * CHANNELS..r.end * CHANNELS;
            let outer = 0..span.outer.len();
            let mut own = [
                SpanGrads {
                    sigma: &mut inner_d[span.inner.clone()],
                    colours: &mut inner_c[colours(&span.inner)],
                },
                SpanGrads {
                    sigma: &mut outer_d[outer.clone()],
                    colours: &mut outer_c[colours(&outer)],
                },
            ];
            composite::ray_backward(layout, span, samples, CHANNELS, &grad, &mut steps, &mut own);
        }
        (density_grad, colour_grad)
    }
}
