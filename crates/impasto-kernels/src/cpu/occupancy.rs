//! A density grid over the unit cube, for skipping empty space (Müller et al. 2022, §E.2).

/// Running maxima of opacity on a cubic grid, thresholded into one flag per cell.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    resolution: usize,
    opacity: Vec<f32>,
    occupied: Vec<bool>,
}

impl OccupancyGrid {
    /// A grid of `resolution³` cells, all occupied.
    pub fn full(resolution: usize) -> Self {
        let cells = resolution * resolution * resolution;
        Self {
            resolution,
            opacity: vec![f32::MAX; cells],
            occupied: vec![true; cells],
        }
    }

    /// A grid from stored flags, one per cell, x fastest; `None` if their number is no cube.
    pub fn from_flags(occupied: Vec<bool>) -> Option<Self> {
        let resolution = (1..=512).find(|r| r * r * r == occupied.len())?;
        Some(Self {
            resolution,
            opacity: occupied
                .iter()
                .map(|o| if *o { f32::MAX } else { 0.0 })
                .collect(),
            occupied,
        })
    }

    /// One flag per cell, x fastest.
    pub fn flags(&self) -> &[bool] {
        &self.occupied
    }

    /// Cells along an axis.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.occupied.len()
    }

    /// Share of occupied cells, in `[0, 1]`.
    pub fn occupancy(&self) -> f32 {
        self.occupied.iter().filter(|o| **o).count() as f32 / self.occupied.len().max(1) as f32
    }

    /// Position in the unit cube of a cell, at `offset` (in `[0, 1)³`) inside it.
    pub fn position(&self, cell: usize, offset: [f32; 3]) -> [f32; 3] {
        let r = self.resolution;
        let index = [cell % r, cell / r % r, cell / (r * r)];
        std::array::from_fn(|axis| (index[axis] as f32 + offset[axis]) / r as f32)
    }

    /// Whether the cell around a point is occupied. Outside the cube nothing is.
    #[inline(always)]
    pub fn is_occupied(&self, point: [f32; 3]) -> bool {
        let r = self.resolution as f32;
        let mut cell = 0;
        for axis in (0..3).rev() {
            let x = point[axis] * r;
            // Written so that NaN is refused too.
            if !(x >= 0.0 && x < r) {
                return false;
            }
            cell = cell * self.resolution + x as usize;
        }
        self.occupied[cell]
    }

    /// Lets every cell's memory fade by `decay` and raises it to what was just measured.
    ///
    /// `measured` holds pairs of cell and opacity of one marching step there. Cells never
    /// measured keep their initial "occupied".
    pub fn observe(&mut self, measured: impl IntoIterator<Item = (usize, f32)>, decay: f32) {
        for (cell, opacity) in measured {
            let Some(memory) = self.opacity.get_mut(cell) else {
                continue;
            };
            let faded = if *memory == f32::MAX {
                0.0
            } else {
                *memory * decay
            };
            *memory = faded.max(if opacity.is_finite() { opacity } else { 1.0 });
        }
    }

    /// Clears the flag of every cell that `allowed` (one flag per cell) does not name.
    pub fn keep_only(&mut self, allowed: &[bool]) {
        for (flag, allowed) in self.occupied.iter_mut().zip(allowed) {
            *flag &= *allowed;
        }
    }

    /// Sets each cell's flag: occupied where the remembered opacity exceeds `threshold`, or the
    /// mean over the grid where that is lower, so that a field that has not formed yet is kept.
    pub fn rebuild(&mut self, threshold: f32) {
        let known: Vec<f32> = self
            .opacity
            .iter()
            .copied()
            .filter(|o| *o != f32::MAX)
            .collect();
        let mean = known.iter().map(|o| f64::from(*o)).sum::<f64>() / known.len().max(1) as f64;
        let threshold = threshold.min(mean as f32);
        for (flag, opacity) in self.occupied.iter_mut().zip(&self.opacity) {
            *flag = *opacity > threshold;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_only_cells_with_opacity() {
        let mut grid = OccupancyGrid::full(4);
        grid.observe((0..64).map(|c| (c, if c == 21 { 0.9 } else { 0.0 })), 0.95);
        grid.rebuild(0.01);
        assert_eq!(grid.flags().iter().filter(|f| **f).count(), 1);
        assert!(grid.is_occupied(grid.position(21, [0.5; 3])));
        assert!(!grid.is_occupied(grid.position(22, [0.5; 3])));
    }

    #[test]
    fn poisoned_points_and_opacities() {
        let mut grid = OccupancyGrid::full(2);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.1, 1.0] {
            assert!(!grid.is_occupied([0.5, bad, 0.5]));
        }
        grid.observe([(0, f32::NAN), (99, 1.0)], 0.9);
        grid.rebuild(0.01);
        assert!(
            grid.is_occupied([0.1; 3]),
            "an unmeasurable cell stays occupied"
        );
    }
}
