//! Rays made ready for any number of paints: all that `app` looks at and that no style changes.

use crate::appearance::{Appearance, AppearanceConfig};
use crate::config::EncodingConfig;
use crate::encoding::{frequencies, matrix};
use crate::render::Geometry;
use crate::sampling::VolumeSamples;
use burn::tensor::{Device, Tensor};
use impasto_kernels::{CompositeLayout, HashGridSpec, ops};
use std::sync::Arc;

/// Samples of rays with everything that `app` of one configuration needs of them.
#[derive(Debug, Clone)]
pub struct Paintable {
    pub(crate) layout: Arc<CompositeLayout>,
    /// Inner and outer volume, absent when no ray has a sample there.
    pub(crate) volumes: [Option<PaintableVolume>; 2],
    pub(crate) density: Tensor<1>,
}

/// One volume's samples.
#[derive(Debug, Clone)]
pub(crate) struct PaintableVolume {
    /// `[n, width]`.
    pub(crate) features: Tensor<2>,
    /// Encoded view directions, where `app` sees them.
    pub(crate) views: Option<Tensor<2>>,
    pub(crate) canvas: Option<CanvasPlaces>,
}

/// Where on the canvas samples are.
#[derive(Debug, Clone)]
pub(crate) struct CanvasPlaces {
    /// Points in the unit cube for a hash grid; encoded already where there is none, and nothing to
    /// learn.
    rows: Tensor<2>,
    grid: Option<HashGridSpec>,
    /// What is left of the grid's levels there.
    left: Option<Tensor<2>>,
}

impl CanvasPlaces {
    /// On a grid; `spreads`, `n`, where the places are means.
    pub(crate) fn on_grid(
        grid: HashGridSpec,
        points: Tensor<2>,
        spreads: Option<Tensor<1>>,
    ) -> Self {
        Self {
            rows: points,
            grid: Some(grid),
            left: spreads.map(|spreads| faded(&grid, spreads)),
        }
    }

    /// What is painted there.
    fn strokes(&self, canvas: &Tensor<1>) -> Tensor<2> {
        let rows = self.rows.clone();
        let strokes = match self.grid {
            Some(grid) => ops::hash_encode(rows, canvas.clone(), grid),
            None => rows,
        };
        match &self.left {
            Some(left) => strokes * left.clone(),
            None => strokes,
        }
    }

    fn map(self, f: &impl Fn(Tensor<2>) -> Tensor<2>) -> Self {
        Self {
            rows: f(self.rows),
            left: self.left.map(f),
            ..self
        }
    }
}

/// How much of a canvas is left for a ray whose light comes from a stretch of it: what is finer than
/// the stretch would average out, and read at the mean place instead it is something else for every
/// view. Half of a level is left where the standard deviation of the stretch is one of its cells.
///
/// # Shapes
/// `spreads`: `[n]`, in the unit cube; result: `[n, levels × features]` in `(0, 1]`. Constants:
/// nothing flows back to where light comes from.
fn faded(grid: &HashGridSpec, spreads: Tensor<1>) -> Tensor<2> {
    let cells = (0..grid.levels)
        .flat_map(|level| std::iter::repeat_n(grid.resolution(level), grid.features));
    let cells = matrix(cells.collect(), grid.outputs(), &spreads.device());
    let stretch = spreads.unsqueeze_dim::<2>(1) * cells;
    (stretch.square() + 1.0).recip()
}

impl PaintableVolume {
    fn new(
        features: Tensor<2>,
        samples: &VolumeSamples,
        dimensions: usize,
        config: &AppearanceConfig,
        device: &Device,
    ) -> Self {
        let views = config.view_bands.map(|bands| {
            let rows = frequencies(&samples.views, 3, bands);
            matrix(rows, 3 * (1 + 2 * bands), device)
        });
        let canvas = config.canvas.as_ref();
        let canvas = canvas.map(|encoding| match (encoding, encoding.hash_grid()) {
            (EncodingConfig::Frequency { bands }, _) => {
                let rows = frequencies(&samples.raw, dimensions, *bands);
                CanvasPlaces {
                    rows: matrix(rows, encoding.outputs(dimensions), device),
                    grid: None,
                    left: None,
                }
            }
            (_, Some(grid)) => {
                let points = matrix(samples.cube.clone(), 3, device);
                let spreads = samples.spreads.as_slice();
                let spreads = (!spreads.is_empty()).then(|| Tensor::from_data(spreads, device));
                CanvasPlaces::on_grid(grid, points, spreads)
            }
            (EncodingConfig::HashGrid { .. }, None) => unreachable!("hash grids have a spec"),
        });
        Self {
            features,
            views,
            canvas,
        }
    }

    fn numbers(&self) -> usize {
        let canvas = self.canvas.as_ref();
        let canvas = canvas.map(|c| [Some(&c.rows), c.left.as_ref()]);
        let rows = canvas.into_iter().flatten().flatten();
        let all = rows.chain(&self.views).chain([&self.features]);
        all.map(|rows| rows.dims().iter().product::<usize>()).sum()
    }

    fn map(self, f: &impl Fn(Tensor<2>) -> Tensor<2>) -> Self {
        Self {
            features: f(self.features),
            views: self.views.map(f),
            canvas: self.canvas.map(|canvas| canvas.map(f)),
        }
    }
}

impl Paintable {
    pub(crate) fn new(geometry: Geometry, config: &AppearanceConfig) -> Self {
        let device = geometry.density.device();
        let Geometry {
            samples,
            inner,
            outer,
            density,
        } = geometry;
        let volume = |features: Option<Tensor<2>>, samples: &VolumeSamples, dimensions| {
            Some(PaintableVolume::new(
                features?, samples, dimensions, config, &device,
            ))
        };
        Self {
            volumes: [
                volume(inner, &samples.inner, 3),
                volume(outer, &samples.outer, 4),
            ],
            layout: samples.layout,
            density,
        }
    }

    /// Number of rays.
    pub fn rays(&self) -> usize {
        self.layout.rays.len()
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        let volumes = self.volumes.iter().flatten().map(PaintableVolume::numbers);
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
            ..self
        }
    }

    /// Colours every sample with `appearance`, of the configuration that this was made for, and
    /// composites.
    ///
    /// # Shapes
    /// Result: `[rays, 6]` = RGB, opacity, Σ weight·depth, distortion; the last two are zero for
    /// samples that were merged on a GPU, whose depths stay there.
    pub fn composite(&self, appearance: &Appearance) -> Tensor<2> {
        self.composite_colours(self.colours(appearance, None))
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
            (&appearance.inner, canvas.map(|c| &c.inner), 3),
            (&appearance.outer, canvas.map(|c| &c.outer), 4),
        ];
        let mut colours = Vec::new();
        for (volume, (app, canvas, dimensions)) in self.volumes.iter().zip(weights) {
            let Some(volume) = volume else { continue };
            let [samples, width] = volume.features.dims();
            let range = start..start + samples;
            start = range.end;
            let known = known.map(|colours| colours.clone().slice_dim(0, range));
            let places = volume.canvas.iter().zip(canvas);
            let strokes = places.map(|(places, canvas)| places.strokes(canvas));
            let others = volume.views.iter().cloned().chain(strokes).collect();
            let network = appearance.config.network(width, dimensions);
            let weights = (app, appearance.latent.as_ref());
            colours.push(network.forward(volume.features.clone(), others, weights, known));
        }
        match colours.len() {
            1 => colours.remove(0),
            _ => Tensor::cat(colours, 0),
        }
    }

    /// Composites samples of given colours, `[samples, 3]`; result as of [`Self::composite`].
    pub fn composite_colours(&self, colours: Tensor<2>) -> Tensor<2> {
        ops::composite(self.density.clone(), colours, Arc::clone(&self.layout))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::host;

    #[test]
    fn fine_levels_fade_before_coarse_ones() {
        let grid = HashGridSpec {
            levels: 2,
            features: 2,
            log2_entries: 8,
            coarsest: 10.0,
            finest: 100.0,
        };
        let spreads = Tensor::from_floats([0.0, 0.01, 0.1], &Device::flex());
        let found = faded(&grid, spreads);
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
