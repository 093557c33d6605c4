//! The field: two branches and their density grids.

use crate::branch::{Branch, BranchWeights, vector};
use crate::config::FieldConfig;
use crate::encoding::Positions;
use crate::sampling::Samples;
use crate::sphere::{dot, from_outer_cube};
use burn::tensor::Device;
use impasto_kernels::DensityGrid;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

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
    /// The cascade's first field, of the same sizes, where there is a cascade.
    pub coarse: Option<Box<FieldWeights>>,
}

/// Where in space light is to be expected.
#[derive(Debug, Clone)]
pub struct Grids {
    /// Over [`crate::sphere::inner_cube`]; densities per scene unit.
    pub(crate) inner: DensityGrid,
    /// Over [`crate::sphere::outer_cube`]; densities per unit of inverse radius.
    pub(crate) outer: DensityGrid,
    /// The same on a GPU, once that was asked for.
    #[cfg(feature = "gpu")]
    pub(crate) resident: std::sync::OnceLock<crate::resident::Copied>,
}

/// Cells that a camera may see. The others start empty and are looked at only where training rays
/// pass. One flag per cell of each grid.
#[derive(Debug, Clone)]
pub struct Visible {
    pub(crate) inner: Vec<bool>,
    pub(crate) outer: Vec<bool>,
}

/// Optical depth of a cell from which on it is looked at more often.
pub(crate) const DENSE: f32 = 0.03;
/// Cells of one task of an update; fixed, so that its random places do not depend on the number of
/// threads.
const CELLS: usize = 1 << 15;

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
        let cascade = self.config.cascade.is_some();
        let coarse = cascade.then(|| Box::new(self.init_level(rng, device)));
        FieldWeights {
            coarse,
            ..self.init_level(rng, device)
        }
    }

    fn init_level(&self, rng: &mut Pcg64, device: &Device) -> FieldWeights {
        let latent = self.inner.latent().map(|length| {
            // Of length one at first, however long.
            let size = (3.0 / length as f32).sqrt();
            let numbers = (0..length).map(|_| rng.random_range(-size..size));
            vector(numbers.collect(), device)
        });
        FieldWeights {
            inner: self.inner.init(rng, device, latent.clone()),
            outer: self.outer.init(rng, device, latent),
            coarse: None,
        }
    }

    /// The cells whose centre `sees` accepts: `[x, y, z, 1]` inside the unit ball,
    /// `[x', y', z', 1/r]` outside.
    pub fn visible(&self, sees: impl Fn([f32; 4]) -> bool + Sync) -> Visible {
        let sampling = &self.config.sampling;
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
        Visible {
            inner: flags(sampling.inner_grid, false),
            outer: flags(sampling.outer_grid, true),
        }
    }

    /// Grids of one density in all cells, or in the visible ones.
    pub fn grids(&self, density: f32, visible: Option<&Visible>) -> Grids {
        let sampling = &self.config.sampling;
        let mut grids = Grids::new(
            DensityGrid::new(sampling.inner_grid, density),
            DensityGrid::new(sampling.outer_grid, density),
        );
        if let Some(visible) = visible {
            grids.inner.keep_only(&visible.inner);
            grids.outer.keep_only(&visible.outer);
        }
        grids
    }

    /// Looks at a random place in `shares[0]` of the visible cells that seem empty and in
    /// `shares[1]` of those that seem to hold something, and updates the grids.
    pub fn update_grids(
        &self,
        grids: &mut Grids,
        weights: &FieldWeights,
        visible: &Visible,
        shares: [f32; 2],
        rng: &mut Pcg64,
    ) {
        grids.forget_copy();
        let jobs = [
            (
                &mut grids.inner,
                &visible.inner,
                &self.inner,
                &weights.inner,
            ),
            (
                &mut grids.outer,
                &visible.outer,
                &self.outer,
                &weights.outer,
            ),
        ];
        for (grid, visible, branch, weights) in jobs {
            let outer = branch.dimensions() == 4;
            let (raw, cube) = places(grid, visible, shares, outer, rng.random());
            if !cube.is_empty() {
                let positions = Positions {
                    raw: &raw,
                    dimensions: branch.dimensions(),
                    cube: &cube,
                };
                let (_, density) = branch.geometry(weights, &positions);
                let (points, _) = cube.as_chunks::<3>();
                for (point, density) in points.iter().zip(crate::render::host(density)) {
                    grid.observe(*point, density);
                }
            }
            // Also what training rays observed.
            grid.settle();
        }
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

impl Grids {
    /// Grids of the inner and the outer volume.
    pub fn new(inner: DensityGrid, outer: DensityGrid) -> Self {
        Self {
            inner,
            outer,
            #[cfg(feature = "gpu")]
            resident: std::sync::OnceLock::new(),
        }
    }

    /// Over [`crate::sphere::inner_cube`]; densities per scene unit.
    pub fn inner(&self) -> &DensityGrid {
        &self.inner
    }

    /// Over [`crate::sphere::outer_cube`]; densities per unit of inverse radius.
    pub fn outer(&self) -> &DensityGrid {
        &self.outer
    }

    /// What was copied to a GPU is no longer what is here.
    fn forget_copy(&mut self) {
        #[cfg(feature = "gpu")]
        self.resident.take();
    }

    /// Takes note of the densities of samples, in layout order, until the next update.
    pub fn observe(&mut self, samples: &Samples, densities: &[f32]) {
        self.forget_copy();
        let (inner, outer) = densities.split_at(samples.inner.len());
        for (grid, cube, densities) in [
            (&mut self.inner, &samples.inner.cube, inner),
            (&mut self.outer, &samples.outer.cube, outer),
        ] {
            let (points, _) = cube.as_chunks::<3>();
            for (point, density) in points.iter().zip(densities) {
                grid.observe(*point, *density);
            }
        }
    }
}
