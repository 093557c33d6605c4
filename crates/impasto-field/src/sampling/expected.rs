//! What light a density grid expects along a ray.

use impasto_kernels::DensityGrid;
use impasto_kernels::sampling::LEAST_TRANSMITTANCE;

/// What a grid says of one step, by level.
pub(super) struct Table {
    /// Transmittance of a step.
    transmittance: [f32; 256],
}

impl Table {
    pub(super) fn new(step: f32) -> Self {
        let transmittance = |level| (-DensityGrid::density_of(level as u8) * step).exp();
        Self {
            transmittance: std::array::from_fn(transmittance),
        }
    }
}

/// How much light each step along one volume's part of a ray is expected to give.
#[derive(Default)]
pub(super) struct ExpectedWeights {
    /// Where the grid is queried, in the unit cube, axis by axis.
    points: [Vec<f32>; 3],
    levels: Vec<u8>,
    pub(super) weights: Vec<f32>,
    /// Light up to and including each step, widened, evenly spread samples included.
    sums: Vec<f32>,
    /// What is spread evenly, a step.
    even: f32,
    /// What the steps were cut into.
    parts: Vec<[f32; 2]>,
}

impl ExpectedWeights {
    /// Queries the grid at `count` points, given by their number, with `transmittance` before the
    /// first; returns what is left.
    #[inline(always)]
    pub(super) fn query(
        &mut self,
        count: usize,
        mut transmittance: f32,
        volume: (&DensityGrid, &Table),
        point: impl Fn(f32) -> [f32; 3],
    ) -> f32 {
        let (grid, table) = volume;
        self.points.iter_mut().for_each(|p| p.resize(count, 0.0));
        let [xs, ys, zs] = &mut self.points;
        for (i, ((x, y), z)) in xs.iter_mut().zip(ys).zip(zs).enumerate() {
            [*x, *y, *z] = point(i as i32 as f32);
        }
        grid.levels_at(&self.points, &mut self.levels);
        self.skip(count, transmittance);
        for (light, level) in self.weights.iter_mut().zip(&self.levels) {
            let after = transmittance * table.transmittance[usize::from(*level)];
            *light = transmittance - after;
            transmittance = after;
            if after < LEAST_TRANSMITTANCE {
                break;
            }
        }
        transmittance
    }

    /// Queries nothing: `count` steps that take no light; returns what is left, all of it.
    pub(super) fn skip(&mut self, count: usize, transmittance: f32) -> f32 {
        self.weights.clear();
        self.weights.resize(count, 0.0);
        transmittance
    }

    /// Widens every step's light to its neighbours', since a grid's cells are coarse, adds `even`
    /// spread evenly, and returns the sum.
    #[inline(always)]
    pub(super) fn sum(&mut self, even: f32) -> f32 {
        let count = self.weights.len();
        self.even = even / count.max(1) as f32;
        self.sums.clear();
        self.sums.resize(count, 0.0);
        let Some(last) = count.checked_sub(1) else {
            return 0.0;
        };
        let more = |a: f32, b: f32| if a > b { a } else { b };
        let light = &self.weights;
        let inside = self.sums.iter_mut().skip(1).zip(light.windows(3));
        for (sum, window) in inside {
            *sum = 0.5 * (more(window[1], window[0]) + more(window[1], window[2]));
        }
        let [first, next] = [light[0], light[last.min(1)]];
        self.sums[0] = 0.5 * (first + more(first, next));
        if last > 0 {
            self.sums[last] = 0.5 * (more(light[last], light[last - 1]) + light[last]);
        }
        let mut sum = 0.0;
        for step in &mut self.sums {
            sum += *step + self.even;
            *step = sum;
        }
        sum
    }

    /// Cuts the steps into `parts` of equal light: start and end of each, in steps, of those in which
    /// no less than `least` light is expected beside what is spread evenly, and of the last, if it
    /// is `endless`.
    #[inline(always)]
    pub(super) fn cut(&mut self, parts: usize, least: f32, endless: bool) -> &[[f32; 2]] {
        let total = self.sums.last().copied().unwrap_or(0.0);
        let (mut step, mut start) = (0, 0.0);
        self.parts.clear();
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
            let light = total / parts as f32 - self.even * (end - start);
            if light >= least || endless && i == parts {
                self.parts.push([start, end]);
            }
            start = end;
        }
        &self.parts
    }
}
