//! A few rays at a time through all layers and back.

use super::spec::{
    CHANNELS, DEPTH, DISTORTION, Density, OUTPUTS, RadianceSpec, Volume, VolumeSpec, ranges,
};
use crate::cpu::composite::{CompositeLayout, RaySpan, ShadedSamples, SpanGrads, Step};
use crate::cpu::mlp::{InputGrad, Packed, Tape};
use crate::cpu::product::Start;
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Samples that go through the layers together: their activations fit the second-level cache.
const TILE: usize = 128;

/// Where the gradients of a piece's encodings and its densities go, of both volumes.
pub(super) type Outputs<'a> = [(&'a mut [f32], &'a mut [f32]); 2];

/// One volume's layers with their parameters.
pub(super) struct PackedVolume<'a> {
    pub(super) base: Packed<'a>,
    geo: Packed<'a>,
    app: Packed<'a>,
    density: Density,
}

impl<'a> PackedVolume<'a> {
    pub(super) fn new(spec: &'a VolumeSpec, volume: &Volume<&'a [f32]>) -> Self {
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
pub(super) struct PieceSums {
    pub(super) error: f64,
    pub(super) depth: f64,
    pub(super) distortion: f64,
    /// Parameters only.
    pub(super) grads: [Volume<Vec<f32>>; 2],
}

impl PieceSums {
    pub(super) fn new(spec: &RadianceSpec) -> Self {
        let zeros = |v: usize| Volume {
            encoded: Vec::new(),
            base: vec![0.0; spec.volumes[v].base.params()],
            geo: vec![0.0; spec.volumes[v].geo.params()],
            app: vec![0.0; spec.volumes[v].app.params()],
        };
        Self {
            error: 0.0,
            depth: 0.0,
            distortion: 0.0,
            grads: [0, 1].map(zeros),
        }
    }

    pub(super) fn add(&mut self, other: Self) {
        self.error += other.error;
        self.depth += other.depth;
        self.distortion += other.distortion;
        for (sum, other) in self.grads.iter_mut().zip(other.grads) {
            let own = [&mut sum.base, &mut sum.geo, &mut sum.app];
            for (sum, other) in own.into_iter().zip([other.base, other.geo, other.app]) {
                sum.iter_mut().zip(other).for_each(|(s, o)| *s += o);
            }
        }
    }
}

/// Neighbouring rays, and where the gradients of their encodings and their densities go.
pub(super) struct RayPiece<'a> {
    pub(super) spec: &'a RadianceSpec,
    pub(super) packed: [&'a PackedVolume<'a>; 2],
    pub(super) volumes: &'a [Volume<&'a [f32]>; 2],
    pub(super) first_ray: usize,
    pub(super) rays: &'a [RaySpan],
    pub(super) out: Outputs<'a>,
}

impl WithSimd for RayPiece<'_> {
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
        densities: &mut [f32],
        colours: &mut [f32],
    ) {
        let rows = densities.len();
        let width = packed.base.spec.outputs();
        self.base.forward(simd, &packed.base, encoded);
        let features = &self.base.output(packed.base.spec)[..rows * width];
        self.geo.forward(simd, &packed.geo, features);
        for (density, raw) in densities.iter_mut().zip(self.geo.output(packed.geo.spec)) {
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
        colours.copy_from_slice(&self.app.output(packed.app.spec)[..rows * CHANNELS]);
    }

    /// The way back, for the block that went through last.
    #[inline(always)]
    fn backward<S: Simd>(
        &mut self,
        simd: S,
        packed: &PackedVolume<'_>,
        block: BlockGrads<'_>,
        grads: &mut Volume<Vec<f32>>,
    ) {
        let BlockGrads {
            encoded,
            densities,
            density_grad,
            colour_grad,
            encoded_grad,
        } = block;
        let rows = density_grad.len();
        let (width, inputs) = (packed.base.spec.outputs(), packed.app.spec.inputs());
        let input = &self.app_input[..rows * inputs];
        let input_grad = &mut self.app_input_grad[..rows * inputs];
        let to = InputGrad(input_grad, Start::Zero);
        let sums = &mut grads.app;
        self.app
            .backward(simd, &packed.app, input, colour_grad, sums, to);
        let feature_grad = &mut self.feature_grad[..rows * width];
        let parts = self.app_input_grad.chunks_exact(inputs);
        for (to, from) in feature_grad.chunks_exact_mut(width).zip(parts) {
            to.copy_from_slice(&from[..width]);
        }
        let raw_grad = &mut self.raw_grad[..rows];
        let raws = self.geo.output(packed.geo.spec).iter().zip(densities);
        for ((to, g), (raw, density)) in raw_grad.iter_mut().zip(density_grad).zip(raws) {
            *to = g * packed.density.slope(*raw, *density);
        }
        let features = &self.base.output(packed.base.spec)[..rows * width];
        let to = InputGrad(feature_grad, Start::Sum);
        let sums = &mut grads.geo;
        self.geo
            .backward(simd, &packed.geo, features, raw_grad, sums, to);
        let feature_grad = &self.feature_grad[..rows * width];
        let to = InputGrad(encoded_grad, Start::Zero);
        let sums = &mut grads.base;
        self.base
            .backward(simd, &packed.base, encoded, feature_grad, sums, to);
    }
}

/// What the way back needs of one volume's samples in a tile, and where it leaves the gradient of
/// their encodings.
struct BlockGrads<'a> {
    encoded: &'a [f32],
    densities: &'a [f32],
    density_grad: &'a [f32],
    colour_grad: &'a [f32],
    encoded_grad: &'a mut [f32],
}

impl<'a> RayPiece<'a> {
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
        let width = spec.views.len() / spec.layout.rays.len();
        let views = |v: usize| {
            rays.iter().enumerate().map(move |(i, span)| {
                let rows = [span.inner.len(), span.outer.len()][v];
                (rows, &spec.views[(first + i) * width..][..width])
            })
        };
        let encoded = [0, 1].map(|v| self.encoded(v, &global[v]));
        for v in 0..2 {
            let part = [0..split, split..count][v].clone();
            if part.is_empty() {
                continue;
            }
            let colours = &mut colours[part.start * CHANNELS..part.end * CHANNELS];
            let densities = &mut densities[part];
            scratch[v].forward(
                simd,
                self.packed[v],
                encoded[v],
                views(v),
                densities,
                colours,
            );
        }
        let (density_grad, colour_grad) =
            self.composite(first, &layout, &densities, &colours, sums);
        let first = ranges(self.rays);
        for v in 0..2 {
            let part = [0..split, split..count][v].clone();
            if part.is_empty() {
                continue;
            }
            let own = global[v].start - first[v].start..global[v].end - first[v].start;
            let width = self.packed[v].base.spec.inputs();
            let (encoded_grad, kept) = &mut self.out[v];
            let block = BlockGrads {
                encoded: encoded[v],
                densities: &densities[part.clone()],
                density_grad: &density_grad[part.clone()],
                colour_grad: &colour_grad[part.start * CHANNELS..part.end * CHANNELS],
                encoded_grad: &mut encoded_grad[own.start * width..own.end * width],
            };
            kept[own].copy_from_slice(block.densities);
            scratch[v].backward(simd, self.packed[v], block, &mut sums.grads[v]);
        }
    }

    /// Encodings of some of a volume's samples, given by their places in the layout.
    fn encoded(&self, volume: usize, samples: &Range<usize>) -> &'a [f32] {
        let width = self.packed[volume].base.spec.inputs();
        let before = ranges(&self.spec.layout.rays)[volume].start;
        &self.volumes[volume].encoded[(samples.start - before) * width..][..samples.len() * width]
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

    /// Adds a tile's losses, whose rays begin with `first`; returns their gradients for densities
    /// and colours.
    fn composite(
        &self,
        first: usize,
        layout: &CompositeLayout,
        densities: &[f32],
        colours: &[f32],
        sums: &mut PieceSums,
    ) -> (Vec<f32>, Vec<f32>) {
        let mut density_grad = vec![0.0; densities.len()];
        let mut colour_grad = vec![0.0; colours.len()];
        let samples = ShadedSamples::new(layout, densities, colours, CHANNELS)
            .learned_from(self.spec.learned_from);
        let rays = self.spec.layout.rays.len() as f32;
        let mut steps: Vec<Step> = Vec::new();
        for (i, span) in layout.rays.iter().enumerate() {
            let target = &self.spec.targets[(first + i) * CHANNELS..][..CHANNELS];
            let mut out = [0.0; OUTPUTS];
            samples.forward(span, &mut out);
            let mut grad = [0.0; OUTPUTS];
            for c in 0..CHANNELS {
                let error = out[c] - target[c];
                sums.error += f64::from(error * error);
                grad[c] = 2.0 * error / (rays * CHANNELS as f32);
            }
            sums.depth += f64::from(out[DEPTH]);
            sums.distortion += f64::from(out[DISTORTION]);
            grad[DEPTH] = self.spec.depth / rays;
            grad[DISTORTION] = self.spec.distortion / rays;
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
            samples.backward(span, &grad, &mut steps, &mut own);
        }
        (density_grad, colour_grad)
    }
}
