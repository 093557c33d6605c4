//! The G-buffer: all that `app` sees of rays and that no style changes. Below it something knows
//! geometry and fills it; above it paint is shaded, any number of times.

use crate::appearance::Appearance;
use crate::config::AppearanceConfig;
use crate::encoding::{frequencies, matrix};
use crate::volrend::accumulate::MergedRays;
use burn::tensor::{Device, Tensor};
use impasto_kernels::{CompositeLayout, HashGridSpec, RaySpan, ops};
use std::sync::Arc;

/// Samples of rays, or what they were accumulated to, with everything that `app` of one
/// configuration needs of them.
#[derive(Debug, Clone)]
pub struct GBuffer {
    pub(crate) layout: Arc<CompositeLayout>,
    /// Inner and outer volume, absent when no ray has a sample there.
    pub(crate) volumes: [Option<VolumeBuffer>; 2],
    pub(crate) density: Tensor<1>,
}

/// One volume's part.
#[derive(Debug, Clone)]
pub(crate) struct VolumeBuffer {
    /// `[n, width]`.
    pub(crate) features: Tensor<2>,
    /// Encoded view directions, where `app` sees them.
    pub(crate) views: Option<Tensor<2>>,
    pub(crate) canvas: Option<CanvasPoints>,
}

/// Where on the canvas samples are.
#[derive(Debug, Clone)]
pub(crate) struct CanvasPoints {
    grid: HashGridSpec,
    /// `[n, 3]`, in the unit cube.
    points: Tensor<2>,
    /// What is left of the grid's levels there.
    attenuation: Tensor<2>,
}

impl CanvasPoints {
    /// Mean points, `[n, 3]`, in the unit cube, with their footprints, `[n]`.
    pub(crate) fn new(grid: HashGridSpec, points: Tensor<2>, footprint: Tensor<1>) -> Self {
        Self {
            attenuation: attenuation(&grid, footprint),
            points,
            grid,
        }
    }

    /// What is painted there.
    fn encode(&self, canvas: &Tensor<1>) -> Tensor<2> {
        let strokes = ops::hash_encode(self.points.clone(), canvas.clone(), self.grid);
        strokes * self.attenuation.clone()
    }
}

/// How much of a canvas is left for a ray whose light comes from a stretch of it: what is finer than
/// the stretch would average out, and read at the mean place instead it is something else for every
/// view. Half of a level is left where the standard deviation of the stretch is one of its cells.
///
/// # Shapes
/// `footprint`: `[n]`, in the unit cube; result: `[n, levels × features]` in `(0, 1]`. Constants:
/// nothing flows back to where light comes from.
fn attenuation(grid: &HashGridSpec, footprint: Tensor<1>) -> Tensor<2> {
    let cells = (0..grid.levels)
        .flat_map(|level| std::iter::repeat_n(grid.resolution(level), grid.features));
    let cells = matrix(cells.collect(), grid.outputs(), &footprint.device());
    let stretch = footprint.unsqueeze_dim::<2>(1) * cells;
    (stretch.square() + 1.0).recip()
}

/// Encoded directions of the rays that samples belong to, `[n, …]`, where `app` sees them.
fn encoded_views<'a>(
    views: &[f32],
    rays: impl Iterator<Item = usize> + 'a,
    config: &AppearanceConfig,
    device: &Device,
) -> Option<Tensor<2>> {
    let bands = config.app.view_bands?;
    let width = 3 * (1 + 2 * bands);
    let encoded = frequencies(views, 3, bands);
    let rows = rays.flat_map(|ray| &encoded[ray * width..(ray + 1) * width]);
    Some(matrix(rows.copied().collect(), width, device))
}

impl VolumeBuffer {
    fn numbers(&self) -> usize {
        let canvas = self.canvas.iter().flat_map(|c| [&c.points, &c.attenuation]);
        let all = canvas.chain(&self.views).chain([&self.features]);
        all.map(|rows| rows.dims().iter().product::<usize>()).sum()
    }

    fn map(self, f: &impl Fn(Tensor<2>) -> Tensor<2>) -> Self {
        Self {
            features: f(self.features),
            views: self.views.map(f),
            canvas: self.canvas.map(|canvas| CanvasPoints {
                points: f(canvas.points),
                attenuation: f(canvas.attenuation),
                ..canvas
            }),
        }
    }

    fn join(parts: Vec<Self>) -> Option<Self> {
        let cat = |all: Vec<Tensor<2>>| (!all.is_empty()).then(|| Tensor::cat(all, 0));
        let (mut features, mut views, mut canvas) =
            (Vec::new(), Vec::new(), [const { Vec::new() }; 2]);
        let grid = parts.first()?.canvas.as_ref().map(|canvas| canvas.grid);
        for part in parts {
            features.push(part.features);
            views.extend(part.views);
            if let Some(own) = part.canvas {
                canvas[0].push(own.points);
                canvas[1].push(own.attenuation);
            }
        }
        let [points, attenuation] = canvas.map(cat);
        Some(Self {
            features: cat(features)?,
            views: cat(views),
            canvas: grid
                .zip(points)
                .zip(attenuation)
                .map(|((grid, points), attenuation)| CanvasPoints {
                    grid,
                    points,
                    attenuation,
                }),
        })
    }
}

impl GBuffer {
    /// Of samples that are all shaded: features of each volume, `[n, width]`, densities, `[n]`, and
    /// unit directions of the rays, `rays × 3`.
    pub(crate) fn of_samples(
        layout: Arc<CompositeLayout>,
        features: [Option<Tensor<2>>; 2],
        density: Tensor<1>,
        views: &[f32],
        config: &AppearanceConfig,
    ) -> Self {
        let device = density.device();
        let mut volume = 0;
        let volumes = features.map(|features| {
            let outer = volume == 1;
            volume += 1;
            let rays = layout.rays.iter().enumerate().flat_map(move |(ray, span)| {
                let own = if outer { &span.outer } else { &span.inner };
                std::iter::repeat_n(ray, own.len())
            });
            Some(VolumeBuffer {
                features: features?,
                views: encoded_views(views, rays, config, &device),
                canvas: None,
            })
        });
        Self {
            layout,
            volumes,
            density,
        }
    }

    /// Of rays that were accumulated to one sample a volume, with their unit directions.
    pub(crate) fn of_merged(
        merged: MergedRays,
        views: &[f32],
        config: &AppearanceConfig,
        device: &Device,
    ) -> Self {
        let grid = config.shading.canvas();
        let volumes = merged.volumes.map(|own| {
            let width = own.features.len().checked_div(own.rays.len())?;
            let footprint = || Tensor::from_data(own.footprint.as_slice(), device);
            Some(VolumeBuffer {
                canvas: grid.map(|grid| {
                    CanvasPoints::new(*grid, matrix(own.cube.clone(), 3, device), footprint())
                }),
                views: encoded_views(views, own.rays.iter().copied(), config, device),
                features: matrix(own.features, width, device),
            })
        });
        Self {
            layout: Arc::new(merged.layout),
            volumes,
            density: Tensor::from_data(merged.density.as_slice(), device),
        }
    }

    /// Those of one batch of rays after the other as one. `None` of none.
    pub(crate) fn join(mut parts: Vec<Self>) -> Option<Self> {
        if parts.len() < 2 {
            return parts.pop();
        }
        let split = |part: &Self| part.layout.rays.iter().map(|span| span.inner.len()).sum();
        let splits: Vec<usize> = parts.iter().map(split).collect();
        let mut at = [0, splits.iter().sum()];
        let mut layout = CompositeLayout::default();
        let mut halves: [[Vec<f32>; 3]; 2] = Default::default();
        let mut density = [const { Vec::new() }; 2];
        for (part, split) in parts.iter().zip(&splits) {
            let own = &part.layout;
            let steps = [&own.deltas, &own.depths, &own.distances];
            let [length] = part.density.dims();
            for (volume, rows) in [0..*split, *split..length].into_iter().enumerate() {
                let all = halves[volume].iter_mut().zip(steps);
                all.for_each(|(all, own)| all.extend(&own[rows.clone()]));
                if !rows.is_empty() {
                    density[volume].push(part.density.clone().slice_dim(0, rows));
                }
            }
            let from = [0, *split];
            let moved = |range: &std::ops::Range<usize>, v: usize| {
                range.start - from[v] + at[v]..range.end - from[v] + at[v]
            };
            layout.rays.extend(own.rays.iter().map(|span| RaySpan {
                inner: moved(&span.inner, 0),
                outer: moved(&span.outer, 1),
            }));
            at = [at[0] + split, at[1] + length - split];
        }
        let [inner, outer] = halves;
        let mut steps = inner
            .into_iter()
            .zip(outer)
            .map(|(inner, outer)| [inner, outer].concat());
        let mut next = || steps.next().unwrap_or_default();
        (layout.deltas, layout.depths, layout.distances) = (next(), next(), next());
        let mut volumes: [Vec<VolumeBuffer>; 2] = Default::default();
        for part in parts {
            let own = volumes.iter_mut().zip(part.volumes);
            own.for_each(|(all, own)| all.extend(own));
        }
        Some(Self {
            layout: Arc::new(layout),
            volumes: volumes.map(VolumeBuffer::join),
            density: Tensor::cat(density.concat(), 0),
        })
    }

    /// Number of samples, accumulated ones where it was made for surfaces.
    pub fn samples(&self) -> usize {
        self.layout.depths.len()
    }

    /// Number of rays.
    pub fn rays(&self) -> usize {
        self.layout.rays.len()
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        let volumes = self.volumes.iter().flatten().map(VolumeBuffer::numbers);
        // Of each ray two ranges; of each sample a density and a length, two depths.
        let layout = 4 * self.layout.depths.len() + 8 * self.rays();
        (volumes.sum::<usize>() + layout) * size_of::<f32>()
    }

    /// The same as constants of an autodiff graph, for training `app` on frozen geometry.
    #[must_use]
    pub fn lifted(self) -> Self {
        Self {
            volumes: self
                .volumes
                .map(|volume| volume.map(|volume| volume.map(&Tensor::from_inner))),
            density: Tensor::from_inner(self.density),
            layout: self.layout,
        }
    }

    /// Shades and composites: deferred shading, where there is one sample a volume.
    ///
    /// # Shapes
    /// Result: `[rays, 6]` as of [`ops::composite`]. The appearance must be of the configuration
    /// that the buffer was made for.
    pub fn shade(&self, appearance: &Appearance) -> Tensor<2> {
        self.composite(self.colours(appearance, None))
    }

    /// Colour of every sample, or `known` ones, of another graph, with the gradients that
    /// computing them would have.
    ///
    /// # Shapes
    /// Result and `known`: `[samples, 3]`, inner ones first.
    pub fn colours(&self, appearance: &Appearance, known: Option<&Tensor<2>>) -> Tensor<2> {
        let mut start = 0;
        let canvas = appearance.canvas.as_ref();
        let weights = [
            (&appearance.inner, canvas.map(|c| &c.inner)),
            (&appearance.outer, canvas.map(|c| &c.outer)),
        ];
        let mut colours = Vec::new();
        for (volume, (app, canvas)) in self.volumes.iter().zip(weights) {
            let Some(volume) = volume else { continue };
            let [samples, width] = volume.features.dims();
            let range = start..start + samples;
            start = range.end;
            let known = known.map(|colours| colours.clone().slice_dim(0, range));
            let points = volume.canvas.iter().zip(canvas);
            let strokes = points.map(|(points, canvas)| points.encode(canvas));
            let others = volume.views.iter().cloned().chain(strokes);
            let inputs = [volume.features.clone()]
                .into_iter()
                .chain(others)
                .collect();
            let network = appearance.config.network(width);
            let weights = network.folded(app, appearance.latent.as_ref());
            colours.push(network.forward(inputs, weights, known));
        }
        match colours.len() {
            1 => colours.remove(0),
            _ => Tensor::cat(colours, 0),
        }
    }

    /// Composites samples of given colours, `[samples, 3]`; result as of [`Self::shade`].
    pub fn composite(&self, colours: Tensor<2>) -> Tensor<2> {
        ops::composite(self.density.clone(), colours, Arc::clone(&self.layout))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::host;

    #[test]
    fn fine_levels_fade_before_coarse_ones() {
        let grid = HashGridSpec {
            levels: 2,
            features: 2,
            log2_entries: 8,
            coarsest: 10.0,
            finest: 100.0,
        };
        let footprint = Tensor::from_floats([0.0, 0.01, 0.1], &Device::flex());
        let found = attenuation(&grid, footprint);
        assert_eq!(found.dims(), [3, 4]);
        let wanted = [
            [1.0; 4],
            [1.0 / 1.01, 1.0 / 1.01, 0.5, 0.5],
            [0.5, 0.5, 1.0 / 101.0, 1.0 / 101.0],
        ];
        for (found, wanted) in host(found).iter().zip(wanted.as_flattened()) {
            assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
        }
    }
}
