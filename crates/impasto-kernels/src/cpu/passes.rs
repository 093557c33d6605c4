//! Rays without gradients, in two passes: features and densities of all samples, then colours of
//! those that matter. A tile of samples goes through all layers of a pass while it is in cache.
//! Runs on the calling thread: who renders has rays for all threads.

use super::composite::{CompositeLayout, steps, transmittances};
use super::hash_grid::{self, HashGridSpec};
use super::mlp::{MlpSpec, Packed, Tape};
use super::radiance::Density;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Samples encoded together: neighbours on their rays share cells of the hash grid.
const TILE: usize = 256;
/// Rows that go through a network together.
const BLOCK: usize = 64;
/// Colours.
const CHANNELS: usize = 3;

/// One volume's way from positions to features and densities.
pub struct GeometryPass<'a> {
    grid: HashGridSpec,
    table: &'a [f32],
    base: Packed<'a>,
    geo: Packed<'a>,
    density: Density,
}

impl<'a> GeometryPass<'a> {
    /// A hash grid with its table, and networks with their parameters.
    ///
    /// # Panics
    /// If parameters are not as many as their specification says, or widths do not fit each other.
    pub fn new(
        (grid, table): (HashGridSpec, &'a [f32]),
        (base, base_params): (&'a MlpSpec, &'a [f32]),
        (geo, geo_params): (&'a MlpSpec, &'a [f32]),
        density: Density,
    ) -> Self {
        assert_eq!(table.len(), grid.params(), "table of a hash grid");
        let widths = [base.inputs(), geo.inputs(), geo.outputs()];
        let wanted = [grid.outputs(), base.outputs(), 1];
        assert_eq!(widths, wanted, "widths of a geometry pass");
        Self {
            grid,
            table,
            base: Packed::new(base, base_params, usize::MAX),
            geo: Packed::new(geo, geo_params, usize::MAX),
            density,
        }
    }

    /// Features and densities at points in the unit cube.
    ///
    /// # Shapes
    /// `points`: `n × 3`; results: `n × outputs of base`, and `n`.
    ///
    /// # Panics
    /// If points are no triples.
    pub fn run(&self, points: &[f32]) -> (Vec<f32>, Vec<f32>) {
        assert_eq!(points.len() % 3, 0, "points of a hash grid are triples");
        Arch::new().dispatch(Geometry { pass: self, points })
    }
}

struct Geometry<'a> {
    pass: &'a GeometryPass<'a>,
    points: &'a [f32],
}

impl WithSimd for Geometry<'_> {
    type Output = (Vec<f32>, Vec<f32>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (Vec<f32>, Vec<f32>) {
        let GeometryPass {
            grid,
            table,
            base,
            geo,
            density,
        } = self.pass;
        let count = self.points.len() / 3;
        let (inputs, width) = (base.spec.inputs(), base.spec.outputs());
        let rows = BLOCK.min(count);
        let (mut base_tape, mut geo_tape) = (Tape::new(base.spec, rows), Tape::new(geo.spec, rows));
        let mut encoded = vec![0.0; TILE.min(count) * inputs];
        let mut features = Vec::with_capacity(count * width);
        let mut densities = Vec::with_capacity(count);
        for points in self.points.chunks(TILE * 3) {
            let encoded = &mut encoded[..points.len() / 3 * inputs];
            hash_grid::encode(simd, grid, points, table, encoded);
            for encoded in encoded.chunks(BLOCK * inputs) {
                let rows = encoded.len() / inputs;
                base_tape.forward(simd, base, encoded);
                let found = &base_tape.output(base.spec)[..rows * width];
                features.extend_from_slice(found);
                geo_tape.forward(simd, geo, found);
                let raw = &geo_tape.output(geo.spec)[..rows];
                densities.extend(raw.iter().map(|raw| density.of(*raw)));
            }
        }
        (features, densities)
    }
}

/// What both volumes' samples are coloured with: from features, then the ray's encoded view, to a
/// colour.
pub struct ShadingPass<'a> {
    app: [Packed<'a>; 2],
    view: usize,
}

/// Samples of rays, for [`ShadingPass::run`].
#[derive(Debug, Clone, Copy)]
pub struct ShadingSamples<'a> {
    /// Samples, packed ray by ray: all inner ones first, then all outer ones.
    pub layout: &'a CompositeLayout,
    /// Density of each.
    pub densities: &'a [f32],
    /// Features of the inner and of the outer ones.
    pub features: [&'a [f32]; 2],
    /// Whether each is shaded. The others are as if they were not there.
    pub keep: &'a [bool],
    /// Encoded view of each ray; empty if `app` does not see it.
    pub views: &'a [f32],
}

impl<'a> ShadingPass<'a> {
    /// `app` with its parameters in the inner and in the outer volume, whose features have these
    /// widths.
    ///
    /// # Panics
    /// If parameters are not as many as their specification says, or the two see views of different
    /// widths.
    pub fn new(app: [(&'a MlpSpec, &'a [f32]); 2], features: [usize; 2]) -> Self {
        let view = [0, 1].map(|v| app[v].0.inputs() - features[v]);
        assert_eq!(view[0], view[1], "encoded views");
        let channels = app.map(|(spec, _)| spec.outputs());
        assert_eq!(channels, [CHANNELS; 2], "colours of a shading pass");
        Self {
            app: app.map(|(spec, params)| Packed::new(spec, params, usize::MAX)),
            view: view[0],
        }
    }

    /// Composited colours of the rays.
    ///
    /// # Shapes
    /// Result: `rays × 3`.
    ///
    /// # Panics
    /// If slices do not have their stated lengths.
    pub fn run(&self, samples: &ShadingSamples<'_>) -> Vec<f32> {
        let rays = samples.layout.rays.len();
        let count = samples.keep.len();
        let layout = samples.layout;
        assert_eq!(
            [samples.densities.len(), layout.deltas.len()],
            [count; 2],
            "samples of a shading pass"
        );
        assert_eq!(samples.views.len(), rays * self.view, "encoded views");
        Arch::new().dispatch(Shading {
            pass: self,
            samples,
        })
    }

    fn features(&self, volume: usize) -> usize {
        self.app[volume].spec.inputs() - self.view
    }
}

struct Shading<'a> {
    pass: &'a ShadingPass<'a>,
    samples: &'a ShadingSamples<'a>,
}

impl WithSimd for Shading<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let (pass, samples) = (self.pass, self.samples);
        let rays = &samples.layout.rays;
        let passed = transmittances(&samples.layout.deltas, samples.densities);
        let mut colours = vec![0.0; CHANNELS * samples.keep.len()];
        let mut first = 0;
        for (v, packed) in pass.app.iter().enumerate() {
            let width = pass.features(v);
            let inputs = packed.spec.inputs();
            let features = samples.features[v];
            let mut block = Block {
                packed,
                tape: Tape::new(packed.spec, BLOCK),
                input: Vec::with_capacity(BLOCK * inputs),
                rows: Vec::with_capacity(BLOCK),
            };
            for (span, view) in rays.iter().zip(rows(samples.views, pass.view)) {
                let span = if v == 0 { &span.inner } else { &span.outer };
                for i in span.clone().filter(|i| samples.keep[*i]) {
                    block
                        .input
                        .extend_from_slice(&features[(i - first) * width..][..width]);
                    block.input.extend_from_slice(view);
                    block.rows.push(i);
                    if block.rows.len() == BLOCK {
                        block.shade(simd, &mut colours);
                    }
                }
            }
            block.shade(simd, &mut colours);
            first += features.len() / width;
        }
        let mut out = Vec::with_capacity(CHANNELS * rays.len());
        for span in rays {
            let mut sum = [0.0; CHANNELS];
            let kept = span.samples().filter(|i| samples.keep[*i]);
            for step in steps(kept, &passed) {
                for (sum, colour) in sum.iter_mut().zip(&colours[CHANNELS * step.index..]) {
                    *sum += step.weight * colour;
                }
            }
            out.extend(sum);
        }
        out
    }
}

/// A row for every ray, however narrow.
fn rows(all: &[f32], width: usize) -> impl Iterator<Item = &[f32]> {
    (0..).map(move |row| all.get(row * width..(row + 1) * width).unwrap_or_default())
}

/// Samples on their way through `app`.
struct Block<'a> {
    packed: &'a Packed<'a>,
    tape: Tape,
    input: Vec<f32>,
    /// Which samples they are.
    rows: Vec<usize>,
}

impl Block<'_> {
    #[inline(always)]
    fn shade<S: Simd>(&mut self, simd: S, colours: &mut [f32]) {
        if self.rows.is_empty() {
            return;
        }
        self.tape.forward(simd, self.packed, &self.input);
        let found = self.tape.output(self.packed.spec).chunks_exact(CHANNELS);
        for (i, colour) in self.rows.drain(..).zip(found) {
            colours[CHANNELS * i..][..CHANNELS].copy_from_slice(colour);
        }
        self.input.clear();
    }
}

/// Weighted sums of rows, one of every span: means, where a span's weights sum to one.
///
/// # Shapes
/// `data`: `n × width`, with the width; `weights`: `n`; result: `spans × width`.
///
/// # Panics
/// If a span ends behind the rows.
pub fn means(
    data: (&[f32], usize),
    spans: impl Iterator<Item = Range<usize>>,
    weights: &[f32],
) -> Vec<f32> {
    Arch::new().dispatch(Means {
        data,
        spans,
        weights,
    })
}

struct Means<'a, I> {
    data: (&'a [f32], usize),
    spans: I,
    weights: &'a [f32],
}

impl<I: Iterator<Item = Range<usize>>> WithSimd for Means<'_, I> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f32> {
        let (data, width) = self.data;
        let mut out = Vec::with_capacity(self.spans.size_hint().0 * width);
        for span in self.spans {
            let at = out.len();
            out.resize(at + width, 0.0);
            let (sum, weights) = (&mut out[at..], &self.weights[span.clone()]);
            match width {
                1 => add_rows::<1>(sum, &data[span], weights),
                3 => add_rows::<3>(sum, &data[3 * span.start..3 * span.end], weights),
                32 => add_rows::<32>(sum, &data[32 * span.start..32 * span.end], weights),
                _ => {
                    let rows = &data[width * span.start..width * span.end];
                    for (row, weight) in rows.chunks_exact(width).zip(weights) {
                        let pairs = sum.iter_mut().zip(row);
                        pairs.for_each(|(sum, x)| *sum += weight * x);
                    }
                }
            }
        }
        out
    }
}

/// For widths that are known, whose sum stays in registers.
#[inline(always)]
fn add_rows<const W: usize>(out: &mut [f32], rows: &[f32], weights: &[f32]) {
    let mut sum = [0.0; W];
    for (row, weight) in rows.as_chunks::<W>().0.iter().zip(weights) {
        for i in 0..W {
            sum[i] += weight * row[i];
        }
    }
    out.copy_from_slice(&sum);
}
