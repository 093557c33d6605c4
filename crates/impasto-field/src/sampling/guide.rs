//! What light a density grid expects along a ray.

use impasto_kernels::DensityGrid;

/// What a grid says of one step, by level.
pub(super) struct Table {
    /// Share of light that passes.
    passed: [f32; 256],
}

impl Table {
    pub(super) fn new(step: f32) -> Self {
        let passed = |level| (-DensityGrid::density_of(level as u8) * step).exp();
        Self {
            passed: std::array::from_fn(passed),
        }
    }
}

/// How much light each step along one volume's part of a ray is expected to give.
#[derive(Default)]
pub(super) struct Guide {
    /// Where the grid is looked at, in the unit cube, axis by axis.
    points: [Vec<f32>; 3],
    levels: Vec<u8>,
    pub(super) light: Vec<f32>,
    /// Light up to and including each step, evenly spread samples included.
    sums: Vec<f32>,
}

impl Guide {
    /// Looks at the grid at `count` points, with `transmittance` before the first; returns what is
    /// left.
    #[inline(always)]
    pub(super) fn look(
        &mut self,
        count: usize,
        mut transmittance: f32,
        (grid, table): (&DensityGrid, &Table),
        point: impl Fn(usize) -> [f32; 3],
    ) -> f32 {
        self.points.iter_mut().for_each(|p| p.resize(count, 0.0));
        let [xs, ys, zs] = &mut self.points;
        for (i, ((x, y), z)) in xs.iter_mut().zip(ys).zip(zs).enumerate() {
            [*x, *y, *z] = point(i);
        }
        grid.levels_at(&self.points, &mut self.levels);
        self.light.clear();
        for level in &self.levels {
            let after = transmittance * table.passed[usize::from(*level)];
            self.light.push(transmittance - after);
            transmittance = after;
        }
        transmittance
    }

    /// Widens every step's light to its neighbours', since a grid's cells are coarse, adds `even`
    /// spread evenly, and returns the sum.
    #[inline(always)]
    pub(super) fn sum(&mut self, even: f32) -> f32 {
        let count = self.light.len();
        let even = even / count.max(1) as f32;
        let (mut sum, mut before) = (0.0, 0.0f32);
        self.sums.clear();
        for i in 0..count {
            let (own, next) = (self.light[i], self.light[(i + 1).min(count - 1)]);
            sum += 0.5 * (own.max(before) + own.max(next)) + even;
            before = own;
            self.sums.push(sum);
        }
        sum
    }

    /// Cuts the steps into `parts` of equal light; calls `part` with start and end of each, in
    /// steps.
    #[inline(always)]
    pub(super) fn cut(&self, parts: usize, mut part: impl FnMut(f32, f32)) {
        let total = self.sums.last().copied().unwrap_or(0.0);
        let (mut step, mut start) = (0, 0.0);
        for i in 1..=parts {
            let wanted = total * i as f32 / parts as f32;
            while step + 1 < self.sums.len() && self.sums[step] < wanted {
                step += 1;
            }
            let before = step.checked_sub(1).map_or(0.0, |s| self.sums[s]);
            let within = (wanted - before) / (self.sums[step] - before).max(1e-20);
            let end = match i {
                i if i == parts => self.sums.len() as f32,
                _ => (step as f32 + within.clamp(0.0, 1.0)).max(start),
            };
            part(start, end);
            start = end;
        }
    }
}
