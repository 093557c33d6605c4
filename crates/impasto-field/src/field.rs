//! The field: two branches and their density grids.

use crate::branch::{Branch, BranchWeights};
use crate::config::FieldConfig;
use crate::encoding::Positions;
use crate::sphere::from_outer_cube;
use burn::tensor::Device;
use impasto_kernels::OccupancyGrid;
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sizes of a field. Holds no weights.
#[derive(Debug, Clone)]
pub struct Field {
    /// The configuration it was made from.
    pub config: FieldConfig,
    /// Unit ball.
    pub inner: Branch,
    /// Beyond.
    pub outer: Branch,
}

/// Weights of both branches.
#[derive(Debug, Clone)]
pub struct FieldWeights {
    /// Unit ball.
    pub inner: BranchWeights,
    /// Beyond.
    pub outer: BranchWeights,
}

/// Which parts of space are worth sampling.
#[derive(Debug, Clone)]
pub struct Grids {
    /// Over [`crate::sphere::inner_cube`].
    pub inner: OccupancyGrid,
    /// Over [`crate::sphere::outer_cube`].
    pub outer: OccupancyGrid,
}

/// Opacity of a marching step under which a cell counts as empty.
const EMPTY: f32 = 0.01;
/// How much of a cell's opacity is remembered between two looks.
const MEMORY: f32 = 0.6;

impl Field {
    /// A field of the given sizes.
    pub fn new(config: FieldConfig) -> Self {
        Self {
            inner: Branch::new(config.inner.clone(), 3),
            outer: Branch::new(config.outer.clone(), 4),
            config,
        }
    }

    /// Widths of the features of both volumes.
    pub fn features(&self) -> [usize; 2] {
        [self.inner.features(), self.outer.features()]
    }

    /// Random weights.
    pub fn init(&self, rng: &mut Pcg64, device: &Device) -> FieldWeights {
        FieldWeights {
            inner: self.inner.init(rng, device),
            outer: self.outer.init(rng, device),
        }
    }

    /// Grids with every cell occupied whose centre `sees` accepts: `[x, y, z, 1]` inside the unit
    /// ball, `[x', y', z', 1/r]` outside.
    pub fn visible_grids(&self, sees: impl Fn([f32; 4]) -> bool + Sync) -> Grids {
        use rayon::prelude::*;
        let sampling = &self.config.sampling;
        let flags = |resolution: usize, outer: bool| {
            let full = OccupancyGrid::full(resolution);
            let flags = (0..full.cells())
                .into_par_iter()
                .map(|cell| {
                    let cube = full.position(cell, [0.5; 3]);
                    let ball = cube.map(|c| 2.0 * c - 1.0);
                    let point = if outer {
                        from_outer_cube(cube)
                    } else {
                        Some([ball[0], ball[1], ball[2], 1.0])
                    };
                    // Cells cut by a boundary have centres outside of it: kept.
                    point.is_none_or(&sees)
                })
                .collect();
            OccupancyGrid::from_flags(flags).unwrap_or(full)
        };
        Grids {
            inner: flags(sampling.inner_grid, false),
            outer: flags(sampling.outer_grid, true),
        }
    }

    /// Measures the density in `share` of all cells (of the candidates of each grid) and updates
    /// the flags.
    pub fn update_grids(
        &self,
        grids: &mut Grids,
        weights: &FieldWeights,
        candidates: &Grids,
        share: f32,
        rng: &mut Pcg64,
    ) {
        let inner_step = self.config.sampling.inner_step;
        let outer_step = 1.0 / self.config.sampling.outer_steps as f32;
        let jobs = [
            (
                &mut grids.inner,
                &candidates.inner,
                &self.inner,
                &weights.inner,
                inner_step,
            ),
            (
                &mut grids.outer,
                &candidates.outer,
                &self.outer,
                &weights.outer,
                outer_step,
            ),
        ];
        for (grid, candidates, branch, weights, step) in jobs {
            let outer = branch.dimensions() == 4;
            let (mut cells, mut raw, mut cube) = (Vec::new(), Vec::new(), Vec::new());
            for cell in (0..grid.cells()).filter(|c| candidates.flags()[*c]) {
                if rng.random::<f32>() >= share {
                    continue;
                }
                let position = grid.position(cell, std::array::from_fn(|_| rng.random()));
                if outer {
                    let Some(point) = from_outer_cube(position) else {
                        continue;
                    };
                    raw.extend(point);
                } else {
                    raw.extend(position.map(|c| 2.0 * c - 1.0));
                }
                cube.extend(position);
                cells.push(cell);
            }
            if cells.is_empty() {
                continue;
            }
            let positions = Positions {
                raw: &raw,
                dimensions: branch.dimensions(),
                cube: &cube,
            };
            let (_, density) = branch.geometry(weights, &positions);
            let density = crate::render::host(density);
            let opacity = density.iter().map(|d| 1.0 - (-d * step).exp());
            grid.observe(cells.into_iter().zip(opacity), MEMORY);
            grid.rebuild(EMPTY);
            grid.keep_only(candidates.flags());
        }
    }
}
