//! A few rays at a time through all layers and back.

use super::super::composite::{self, CompositeLayout, RaySpan, SpanGrads, Step};
use super::super::mlp::Tape;
use super::super::product::Start;
use super::{CHANNELS, Outputs, PackedVolume, PieceSums, RadianceSpec, Volume, VolumeSpec, ranges};
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Samples that go through the layers together: their activations fit the second-level cache.
const TILE: usize = 128;

/// Neighbouring rays, and where the gradients of their encodings and their densities go.
pub(super) struct Piece<'a> {
    pub(super) spec: &'a RadianceSpec,
    pub(super) packed: [&'a PackedVolume<'a>; 2],
    pub(super) volumes: &'a [Volume<&'a [f32]>; 2],
    pub(super) first_ray: usize,
    pub(super) rays: &'a [RaySpan],
    pub(super) out: Outputs<'a>,
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
        (encoded, encoded_grad): (&[f32], &mut [f32]),
        densities: &[f32],
        (density_grad, colour_grad): (&[f32], &[f32]),
        grads: &mut Volume<Vec<f32>>,
    ) {
        let rows = density_grad.len();
        let (width, inputs) = (packed.base.spec.outputs(), packed.app.spec.inputs());
        let input_grad = &mut self.app_input_grad[..rows * inputs];
        let input = &self.app_input[..rows * inputs];
        let app = (input, colour_grad);
        self.app.backward(
            simd,
            &packed.app,
            app,
            &mut grads.app,
            (input_grad, Start::Zero),
        );
        let feature_grad = &mut self.feature_grad[..rows * width];
        let parts = input_grad.chunks_exact(inputs);
        for (to, from) in feature_grad.chunks_exact_mut(width).zip(parts) {
            to.copy_from_slice(&from[..width]);
        }
        let raw_grad = &mut self.raw_grad[..rows];
        let raws = self.geo.output(packed.geo.spec).iter().zip(densities);
        for ((to, g), (raw, density)) in raw_grad.iter_mut().zip(density_grad).zip(raws) {
            *to = g * packed.density.slope(*raw, *density);
        }
        let features = &self.base.output(packed.base.spec)[..rows * width];
        let geo = (features, &*raw_grad);
        self.geo.backward(
            simd,
            &packed.geo,
            geo,
            &mut grads.geo,
            (feature_grad, Start::Sum),
        );
        let base = (encoded, &*feature_grad);
        let encoded_grad = (encoded_grad, Start::Zero);
        self.base
            .backward(simd, &packed.base, base, &mut grads.base, encoded_grad);
    }
}

impl<'a> Piece<'a> {
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
            let out = (&mut densities[part], colours);
            scratch[v].forward(simd, self.packed[v], encoded[v], views(v), out);
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
        let passed = composite::transmittances(&layout.deltas, densities);
        let samples = (&*passed, colours);
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
