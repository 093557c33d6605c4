//! Density grids of both volumes: where in space light is to be expected.

use crate::branch::{Branch, BranchWeights};
use crate::encoding::{Positions, host};
use crate::field::{Field, FieldWeights};
use crate::sampling::Samples;
use crate::sphere::{dot, from_outer_cube};
use impasto_kernels::{DensityGrid, OccupancySpec};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Where in space light is to be expected.
#[derive(Debug, Clone)]
pub struct OccupancyGrids {
    pub(crate) inner: DensityGrid,
    pub(crate) outer: DensityGrid,
}

/// Cells that a camera may see. The others start empty and are queried only where training rays
/// pass. One flag per cell of each grid.
#[derive(Debug, Clone)]
pub struct VisibleCells {
    pub(crate) inner: Vec<bool>,
    pub(crate) outer: Vec<bool>,
}

/// Optical depth of a cell from which on it is queried more often.
pub(crate) const DENSE: f32 = 0.03;
/// Cells of one task of an update; fixed, so that its random places do not depend on the number of
/// threads.
const CELLS: usize = 1 << 15;

impl VisibleCells {
    /// The cells whose centre `sees` accepts: `[x, y, z, 1]` inside the unit ball,
    /// `[x', y', z', 1/r]` outside.
    pub fn new(spec: &OccupancySpec, sees: impl Fn([f32; 4]) -> bool + Sync) -> Self {
        let flags = |resolution: usize, outer: bool| {
            let grid = DensityGrid::new(resolution, 0.0);
            (0..grid.cells())
                .into_par_iter()
                .map(|cell| {
                    let cube = grid.position(cell, [0.5; 3]);
                    let ball = cube.map(|c| 2.0 * c - 1.0);
                    let point = if outer {
                        from_outer_cube(cube)
                    } else {
                        Some([ball[0], ball[1], ball[2], 1.0])
                    };
                    // Cells cut by a boundary may have centres outside of it: kept. Inner cells
                    // wholly outside the ball are never sampled.
                    let reach = 1.0 + 3f32.sqrt() / resolution as f32;
                    let sampled = outer || dot(ball, ball) <= reach * reach;
                    sampled && point.is_none_or(&sees)
                })
                .collect()
        };
        Self {
            inner: flags(spec.inner_grid, false),
            outer: flags(spec.outer_grid, true),
        }
    }
}

impl OccupancyGrids {
    /// Grids of the inner and the outer volume.
    pub fn new(inner: DensityGrid, outer: DensityGrid) -> Self {
        Self { inner, outer }
    }

    /// Grids of one density in all cells.
    pub fn uniform(spec: &OccupancySpec, density: f32) -> Self {
        Self::new(
            DensityGrid::new(spec.inner_grid, density),
            DensityGrid::new(spec.outer_grid, density),
        )
    }

    /// The same with nothing but in visible cells.
    #[must_use]
    pub fn only(mut self, visible: &VisibleCells) -> Self {
        self.inner.keep_only(&visible.inner);
        self.outer.keep_only(&visible.outer);
        self
    }

    /// Over [`crate::sphere::inner_cube`]; densities per scene unit.
    pub fn inner(&self) -> &DensityGrid {
        &self.inner
    }

    /// Over [`crate::sphere::outer_cube`]; densities per unit of inverse radius.
    pub fn outer(&self) -> &DensityGrid {
        &self.outer
    }

    /// Takes note of the densities of samples, in layout order, until the next update.
    pub fn observe(&mut self, samples: &Samples, densities: &[f32]) {
        let (inner, outer) = densities.split_at(samples.inner.len());
        observe(&mut self.inner, &samples.inner.cube, inner);
        observe(&mut self.outer, &samples.outer.cube, outer);
    }

    /// Evaluates the field at a random place in `shares[0]` of the visible cells that seem empty and
    /// in `shares[1]` of those that seem to hold something, and updates the grids.
    pub fn update(
        &mut self,
        field: &Field,
        weights: &FieldWeights,
        visible: &VisibleCells,
        shares: [f32; 2],
        rng: &mut Pcg64,
    ) {
        let latent = weights.latent.as_ref();
        let mut update =
            |grid: &mut DensityGrid, visible: &[bool], branch: &Branch, own: &BranchWeights| {
                let outer = branch.dimensions() == 4;
                let (raw, cube) = places(grid, visible, shares, outer, rng.random());
                if !cube.is_empty() {
                    let positions = Positions {
                        raw: &raw,
                        dimensions: branch.dimensions(),
                        cube: &cube,
                    };
                    let (_, density) = branch.evaluate(own, latent, &positions);
                    observe(grid, &cube, &host(density));
                }
                // Also what training rays observed.
                grid.settle();
            };
        update(
            &mut self.inner,
            &visible.inner,
            &field.inner,
            &weights.inner,
        );
        update(
            &mut self.outer,
            &visible.outer,
            &field.outer,
            &weights.outer,
        );
    }
}

fn observe(grid: &mut DensityGrid, cube: &[f32], densities: &[f32]) {
    let (points, _) = cube.as_chunks::<3>();
    for (point, density) in points.iter().zip(densities) {
        grid.observe(*point, *density);
    }
}

/// A random place in some of a grid's cells: coordinates in its volume, and in the unit cube.
fn places(
    grid: &DensityGrid,
    visible: &[bool],
    shares: [f32; 2],
    outer: bool,
    seed: u64,
) -> (Vec<f32>, Vec<f32>) {
    let dense = DensityGrid::level_of(DENSE * grid.resolution() as f32);
    let parts: Vec<(Vec<f32>, Vec<f32>)> = (0..grid.cells().div_ceil(CELLS))
        .into_par_iter()
        .map(|part| {
            let mut rng = Pcg64::seed_from_u64(seed ^ part as u64);
            let (mut raw, mut cube) = (Vec::new(), Vec::new());
            for cell in part * CELLS..((part + 1) * CELLS).min(grid.cells()) {
                let share = shares[usize::from(grid.levels()[cell] >= dense)];
                if !visible[cell] || rng.random::<f32>() >= share {
                    continue;
                }
                let position = grid.position(cell, std::array::from_fn(|_| rng.random()));
                if !outer {
                    raw.extend(position.map(|c| 2.0 * c - 1.0));
                } else if let Some(point) = from_outer_cube(position) {
                    raw.extend(point);
                } else {
                    continue;
                }
                cube.extend(position);
            }
            (raw, cube)
        })
        .collect();
    let (raw, cube): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    (raw.concat(), cube.concat())
}
