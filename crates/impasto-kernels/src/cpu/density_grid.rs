//! A coarse memory of a field's density over the unit cube, by which samples are placed (after
//! the occupancy grids of Müller et al. 2022, §E.2; here it holds densities, one byte each).

use super::math::{exp, ln};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Density of level 1; anything thinner is level 0, nothing.
pub(crate) const THINNEST: f32 = 1e-2;
/// ln of the ratio of two neighbouring levels' densities: 255 levels reach 1e5.
pub(crate) const RATIO: f32 = 0.0635;
/// Beyond this, opacities are no longer told apart.
pub(crate) const MOST_OPACITY: f32 = 1.0 - 1e-6;
/// Cells of one task.
const CHUNK: usize = 1 << 16;
/// How far one look moves what is remembered of a cell: looks go to random places of it.
pub(crate) const RATE: f32 = 0.15;

/// Remembered densities of a cubic grid, logarithmic, one byte a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityGrid {
    resolution: usize,
    levels: Vec<u8>,
    /// Mean opacity of a cell's width; empty until something is observed.
    opacity: Vec<f32>,
}

impl DensityGrid {
    /// A grid of `resolution³` cells of one density.
    pub fn new(resolution: usize, density: f32) -> Self {
        let cells = resolution * resolution * resolution;
        Self {
            resolution,
            levels: vec![Self::level_of(density); cells],
            opacity: Vec::new(),
        }
    }

    /// A grid from stored levels, x fastest; `None` if their number is no cube of 1 to 512.
    pub fn from_levels(levels: Vec<u8>) -> Option<Self> {
        let resolution = (1..=512).find(|r| r * r * r == levels.len())?;
        Some(Self {
            resolution,
            levels,
            opacity: Vec::new(),
        })
    }

    /// With what was observed of every cell, as [`Self::observed`] gives it; `None` if that is
    /// neither one finite opacity a cell nor nothing at all.
    pub fn with_observed(mut self, opacity: Vec<f32>) -> Option<Self> {
        let whole = opacity.is_empty() || opacity.len() == self.cells();
        if !whole || !opacity.iter().all(|o| o.is_finite()) {
            return None;
        }
        self.opacity = opacity;
        Some(self)
    }

    /// Mean opacity of each cell's width, x fastest, observations since the last [`Self::settle`]
    /// included; empty if there never was one.
    pub fn observed(&self) -> &[f32] {
        &self.opacity
    }

    /// One level per cell, x fastest.
    pub fn levels(&self) -> &[u8] {
        &self.levels
    }

    /// Mean opacity of each cell's width, of what was observed or else of what the levels say.
    pub fn opacities(&self) -> Vec<f32> {
        if self.opacity.is_empty() {
            let opacity = |level: &u8| opacity(Self::density_of(*level), self.resolution);
            return self.levels.iter().map(opacity).collect();
        }
        self.opacity.clone()
    }

    /// Cells along an axis.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.levels.len()
    }

    /// The level whose density is nearest. What is not finite counts as the densest.
    pub fn level_of(density: f32) -> u8 {
        if density < THINNEST {
            return 0;
        }
        let level = (density / THINNEST).ln() / RATIO + 1.5;
        if level < 255.0 { level as u8 } else { 255 }
    }

    /// The density of a level.
    pub fn density_of(level: u8) -> f32 {
        match level {
            0 => 0.0,
            level => THINNEST * (RATIO * f32::from(level - 1)).exp(),
        }
    }

    /// Position in the unit cube of a cell, at `offset` (in `[0, 1)³`) inside it.
    pub fn position(&self, cell: usize, offset: [f32; 3]) -> [f32; 3] {
        let r = self.resolution;
        let index = [cell % r, cell / r % r, cell / (r * r)];
        std::array::from_fn(|axis| (index[axis] as f32 + offset[axis]) / r as f32)
    }

    /// The cell around a point; `None` outside the cube and for what is no number.
    #[inline(always)]
    pub fn cell(&self, point: [f32; 3]) -> Option<usize> {
        let r = self.resolution as f32;
        let mut cell = 0;
        for axis in (0..3).rev() {
            let x = point[axis] * r;
            // Written so that NaN is refused too.
            if !(x >= 0.0 && x < r) {
                return None;
            }
            cell = cell * self.resolution + x as usize;
        }
        Some(cell)
    }

    /// Level of the cell around a point; 0 outside the cube.
    pub fn level(&self, point: [f32; 3]) -> u8 {
        self.cell(point).map_or(0, |cell| self.levels[cell])
    }

    /// Levels at many points, given axis by axis. Points outside the cube, and what is no number,
    /// count as the nearest cell's, or any.
    ///
    /// # Panics
    /// If the axes differ in length.
    pub fn levels_at(&self, points: &[Vec<f32>; 3], levels: &mut Vec<u8>) {
        let [xs, ys, zs] = points;
        assert!(
            xs.len() == ys.len() && ys.len() == zs.len(),
            "axes of points"
        );
        levels.clear();
        let mut cells = [0; GROUP];
        for start in (0..xs.len()).step_by(GROUP) {
            let group = start..(start + GROUP).min(xs.len());
            Arch::new().dispatch(Cells {
                resolution: self.resolution,
                points: [&xs[group.clone()], &ys[group.clone()], &zs[group.clone()]],
                cells: &mut cells,
            });
            levels.extend(
                cells[..group.len()]
                    .iter()
                    .map(|c| self.levels[*c as usize]),
            );
        }
    }

    /// Takes note of the density at a point. Levels change with the next [`Self::settle`].
    pub fn observe(&mut self, point: [f32; 3], density: f32) {
        if let Some(cell) = self.cell(point) {
            if self.opacity.is_empty() {
                self.opacity = self.opacities();
            }
            let seen = opacity(density, self.resolution);
            // What cannot be measured counts as opaque, so that it is not skipped.
            let seen = if seen.is_finite() { seen } else { 1.0 };
            self.opacity[cell] += RATE * (seen - self.opacity[cell]);
        }
    }

    /// Sets every cell's level to what was observed.
    pub fn settle(&mut self) {
        let chunks = self.levels.par_chunks_mut(CHUNK);
        chunks
            .zip(self.opacity.par_chunks(CHUNK))
            .for_each(|(levels, opacity)| {
                Arch::new().dispatch(Settle {
                    cells: self.resolution as f32,
                    opacity,
                    levels,
                });
            });
    }

    /// Empties every cell that `allowed` (one flag per cell) does not name, and forgets what was
    /// observed since the last [`Self::settle`].
    pub fn keep_only(&mut self, allowed: &[bool]) {
        let cells = self.levels.iter_mut().zip(allowed);
        for (level, _) in cells.filter(|(_, allowed)| !**allowed) {
            *level = 0;
        }
        self.opacity.clear();
    }
}

/// Points whose cells are found together.
const GROUP: usize = 64;

/// Finds the cells of up to [`GROUP`] points.
struct Cells<'a> {
    resolution: usize,
    points: [&'a [f32]; 3],
    cells: &'a mut [u32; GROUP],
}

impl WithSimd for Cells<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (scale, last) = (self.resolution as f32, self.resolution as f32 - 1.0);
        let side = self.resolution as u32;
        let [xs, ys, zs] = self.points;
        // NaN counts as 0. A conversion that checks would do so number by number.
        let index = |x: f32| {
            let x = if x > 0.0 { x * scale } else { 0.0 };
            let x = if x < last { x } else { last };
            // SAFETY: from −1 to `last`, a side of what is in memory.
            unsafe { x.to_int_unchecked::<i32>() as u32 }
        };
        for (cell, ((x, y), z)) in self.cells.iter_mut().zip(xs.iter().zip(ys).zip(zs)) {
            *cell = index(*x) + side * (index(*y) + side * index(*z));
        }
    }
}

/// Rebuilds levels from opacities.
struct Settle<'a> {
    cells: f32,
    opacity: &'a [f32],
    levels: &'a mut [u8],
}

impl WithSimd for Settle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (level, opacity) in self.levels.iter_mut().zip(self.opacity) {
            let passed = 1.0 - opacity.min(MOST_OPACITY);
            let density = -ln(passed) * self.cells;
            let found = ln(density.max(1e-20) * THINNEST.recip()) * RATIO.recip() + 1.5;
            let found = if density < THINNEST {
                0.0
            } else {
                found.min(255.0)
            };
            *level = found as u8;
        }
    }
}

/// Opacity of one cell's width; NaN stays NaN.
fn opacity(density: f32, resolution: usize) -> f32 {
    let density = if density < 0.0 { 0.0 } else { density };
    1.0 - exp(-density / resolution as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_densities_within_their_ratio() {
        for density in [0.011, 0.5, 1.0, 37.0, 1e4] {
            let kept = DensityGrid::density_of(DensityGrid::level_of(density));
            assert!(
                (kept / density).ln().abs() <= 0.51 * RATIO,
                "{density} became {kept}"
            );
        }
        assert_eq!(DensityGrid::density_of(DensityGrid::level_of(0.0)), 0.0);
        let levels = (0..=255).map(|l| DensityGrid::level_of(DensityGrid::density_of(l)));
        assert!(levels.eq(0..=255));
    }

    #[test]
    fn learns_what_is_there_and_forgets_what_is_not() {
        let mut grid = DensityGrid::new(4, 0.0);
        let at = grid.position(21, [0.5; 3]);
        let mut look = |density: f32| {
            (0..80).for_each(|_| grid.observe(at, density));
            grid.settle();
            (
                grid.level(at),
                grid.levels().iter().filter(|l| **l > 0).count(),
            )
        };
        let (level, others) = look(5.0);
        assert!(level.abs_diff(DensityGrid::level_of(5.0)) <= 1 && others == 1);
        assert_eq!(look(0.0), (0, 0));
        assert_eq!(
            look(f32::NAN).1,
            1,
            "what cannot be measured is not skipped"
        );
    }

    #[test]
    fn what_is_stored_is_what_is_read() {
        let Some(mut grid) = DensityGrid::from_levels((0..27).collect()) else {
            unreachable!("27 is a cube");
        };
        assert!(grid.levels().iter().copied().eq(0..27));
        grid.settle();
        assert!(
            grid.levels().iter().copied().eq(0..27),
            "nothing was observed"
        );
        let last = grid.position(26, [0.5; 3]);
        grid.observe(last, DensityGrid::density_of(26));
        grid.settle();
        assert!(
            grid.levels().iter().copied().eq(0..27),
            "nothing new was observed"
        );
        assert_eq!(DensityGrid::from_levels(vec![0; 26]), None);
    }

    #[test]
    fn many_points_at_once_are_many_points() {
        let levels = (0..=255).cycle().take(9 * 9 * 9).collect();
        let Some(grid) = DensityGrid::from_levels(levels) else {
            unreachable!("729 is a cube");
        };
        let mut levels = Vec::new();
        for count in [0, 1, 63, 64, 65, 200] {
            let axis = |a: usize| -> Vec<f32> {
                (0..count)
                    .map(|i| (i as f32 * 0.37 + a as f32 * 0.21).fract())
                    .collect()
            };
            let points = [axis(0), axis(1), axis(2)];
            grid.levels_at(&points, &mut levels);
            let wanted = (0..count).map(|i| grid.level([0, 1, 2].map(|a| points[a][i])));
            assert!(levels.iter().copied().eq(wanted), "{count} points");
        }
        let outside = [-3.0, 1.0, f32::INFINITY, f32::NAN].to_vec();
        grid.levels_at(&[outside, vec![0.5; 4], vec![0.5; 4]], &mut levels);
        let edge = |x: f32| grid.level([x, 0.5, 0.5]);
        assert_eq!(levels[..3], [edge(0.0), edge(0.999), edge(0.999)]);
    }

    #[test]
    fn poisoned_points() {
        let mut grid = DensityGrid::new(2, 1.0);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.1, 1.0] {
            assert_eq!(grid.cell([0.5, bad, 0.5]), None);
            grid.observe([0.5, bad, 0.5], 9.0);
        }
        assert_eq!(grid, DensityGrid::new(2, 1.0));
    }
}
