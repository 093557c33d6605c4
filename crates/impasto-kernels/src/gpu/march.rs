//! Marching rays through density grids, one unit a ray, in two walks: the first adds up what light
//! each volume's grid expects along the ray, the second cuts it into equal parts, a sample for each.
//! Between the two, one cube counts where every ray's samples begin.

use super::launch::{UNITS, Uploaded, argument, cube, cubes_for, empty, empty_u32, is_finite};
use crate::cpu::density_grid::DensityGrid;
use crate::sampling::{LEAST_TRANSMITTANCE, OccupancySpec};
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

/// Numbers of a ray in its buffer: origin, direction, where samples lie in their parts, and the
/// contracted distance of a known surface, below zero if there is none.
pub(crate) const RAY: usize = 8;
/// Most looks at the inner density grid along a ray.
const MOST_STEPS: f32 = 2e4;
/// The step of the last outer sample, which everything infinitely far belongs to.
const LAST_STEP: f32 = 1e10;

/// A specification that kernels can be compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Shape {
    near: u32,
    inner_step: u32,
    uniform_fraction: u32,
    least_weight: u32,
    outer_steps: usize,
    samples: usize,
    sides: [usize; 2],
}

impl Shape {
    fn of(spec: &OccupancySpec, sides: [usize; 2], least_weight: f32) -> Self {
        Self {
            near: spec.near.to_bits(),
            inner_step: spec.inner_step.to_bits(),
            uniform_fraction: spec.uniform_fraction.to_bits(),
            least_weight: least_weight.to_bits(),
            outer_steps: spec.outer_steps,
            samples: spec.samples.max(1),
            sides,
        }
    }

    fn near(&self) -> f32 {
        f32::from_bits(self.near)
    }

    fn inner_step(&self) -> f32 {
        f32::from_bits(self.inner_step)
    }

    fn least_weight(&self) -> f32 {
        f32::from_bits(self.least_weight)
    }

    /// What is spread evenly over a volume.
    fn even(&self) -> f32 {
        0.5 * f32::from_bits(self.uniform_fraction)
    }
}

/// Share of light that a step of each level lets pass, of both volumes' steps.
fn table(spec: &OccupancySpec) -> Vec<f32> {
    let steps = [spec.inner_step, 1.0 / spec.outer_steps as f32];
    let passed =
        |step: f32| (0..=255u8).map(move |level| (-DensityGrid::density_of(level) * step).exp());
    steps.into_iter().flat_map(passed).collect()
}

#[derive(CubeType)]
struct Point {
    x: f32,
    y: f32,
    z: f32,
}

#[cube]
fn dot(a: &Point, b: &Point) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[cube]
fn point_at(numbers: &[f32], at: usize) -> Point {
    Point {
        x: numbers[at],
        y: numbers[at + 1],
        z: numbers[at + 2],
    }
}

#[cube]
fn set_point(numbers: &mut [f32], at: usize, point: &Point) {
    numbers[at] = point.x;
    numbers[at + 1] = point.y;
    numbers[at + 2] = point.z;
}

/// A ray in the units that steps are measured in.
#[derive(CubeType)]
struct Ray {
    origin: Point,
    direction: Point,
    view: Point,
    length: f32,
    steps: u32,
    step: f32,
}

#[cube]
fn ray_at(rays: &[f32], ray: usize, #[comptime] shape: Shape) -> Ray {
    let origin = point_at(rays, ray * RAY);
    let direction = point_at(rays, ray * RAY + 3);
    let a = dot(&direction, &direction);
    let b = dot(&origin, &direction);
    let length = f32::sqrt(a);
    let discriminant = b * b - a * (dot(&origin, &origin) - 1.0);
    let exit = (f32::sqrt(discriminant.max(0.0)) - b) / a;
    let far = select(
        discriminant >= 0.0 && is_finite(exit) && exit > 0.0,
        exit,
        0.0f32,
    );
    let range = ((far - comptime!(shape.near())) * length).max(0.0);
    let steps = (range / comptime!(shape.inner_step()))
        .ceil()
        .min(MOST_STEPS);
    let view = Point {
        x: direction.x / length,
        y: direction.y / length,
        z: direction.z / length,
    };
    Ray {
        origin,
        direction,
        view,
        length,
        steps: u32::cast_from(steps),
        step: range / steps.max(1.0) / length,
    }
}

/// The point of a ray at an inverse radius, in the outer volume's cube, and its depth.
#[cube]
fn outer_place(ray: &Ray, s: f32) -> (Point, f32) {
    let sb = s * dot(&ray.origin, &ray.view);
    let inside = sb * sb + 1.0 - s * s * dot(&ray.origin, &ray.origin);
    let st = f32::sqrt(inside.max(0.0)) - sb;
    let radius = 0.5f32 * (1.0 - 0.5f32 * s);
    let point = Point {
        x: 0.5 + radius * (s * ray.origin.x + st * ray.view.x),
        y: 0.5 + radius * (s * ray.origin.y + st * ray.view.y),
        z: 0.5 + radius * (s * ray.origin.z + st * ray.view.z),
    };
    (point, st / s.max(1e-9) / ray.length)
}

/// The point of a ray at a ray parameter, in the inner volume's cube.
#[cube]
fn inner_place(ray: &Ray, t: f32) -> Point {
    Point {
        x: 0.5 + 0.5 * (ray.origin.x + t * ray.direction.x),
        y: 0.5 + 0.5 * (ray.origin.y + t * ray.direction.y),
        z: 0.5 + 0.5 * (ray.origin.z + t * ray.direction.z),
    }
}

/// Where step `i` looks at its volume's grid.
#[cube]
fn look_at(ray: &Ray, i: usize, #[comptime] outer: bool, #[comptime] shape: Shape) -> Point {
    if comptime!(outer) {
        let step = comptime!(1.0 / shape.outer_steps as f32);
        let (place, _) = outer_place(ray, 1.0 - (f32::cast_from(i) + 0.5) * step);
        place
    } else {
        let t = comptime!(shape.near()) + (f32::cast_from(i) + 0.5) * ray.step;
        inner_place(ray, t)
    }
}

/// A coordinate's cell.
#[cube]
fn cell(x: f32, #[comptime] side: usize) -> usize {
    let last = comptime!(side as f32 - 1.0);
    let found = u32::cast_from((x * comptime!(side as f32)).clamp(0.0, last));
    found.min(comptime!(side as u32 - 1)) as usize
}

/// Looks along a ray's part in one volume.
#[cube]
fn steps_of(ray: &Ray, #[comptime] outer: bool, #[comptime] shape: Shape) -> usize {
    let mut count = ray.steps as usize;
    if outer {
        count = comptime!(shape.outer_steps).runtime();
    }
    count
}

/// Weight of step `i`: what it takes of the transmittance `reaching` it, by the grid. The last outer step takes all.
#[cube]
fn weight(
    ray: &Ray,
    levels: &[u32],
    table: &[f32],
    i: usize,
    reaching: f32,
    #[comptime] outer: bool,
    #[comptime] shape: Shape,
) -> f32 {
    let side = comptime!(shape.sides[usize::from(outer)]);
    let from_table = comptime!(256 * usize::from(outer));
    let place = look_at(ray, i, outer, shape);
    let (x, y, z) = (
        cell(place.x, side),
        cell(place.y, side),
        cell(place.z, side),
    );
    let level = levels[x + side * (y + side * z)] as usize;
    let mut taken = reaching * (1.0 - table[from_table + level]);
    taken = select(reaching < LEAST_TRANSMITTANCE, 0.0f32, taken);
    if outer {
        taken = select(i + 1 == comptime!(shape.outer_steps), reaching, taken);
    }
    taken
}

/// What all steps of one volume come to, widened to their neighbours and with what is spread
/// evenly, and the light that is left behind them.
#[cube]
fn mass(
    ray: &Ray,
    levels: &[u32],
    table: &[f32],
    reaching: f32,
    #[comptime] outer: bool,
    #[comptime] shape: Shape,
) -> (f32, f32) {
    let count = steps_of(ray, outer, shape);
    let even = comptime!(shape.even()) / f32::cast_from(count.max(1));
    let mut sum = 0.0f32;
    let mut left = reaching;
    if count > 0 {
        let mut before = 0.0f32;
        let mut own = weight(ray, levels, table, 0usize, left, outer, shape);
        for i in 0..count {
            left -= own;
            let mut next = own;
            if i + 1 < count {
                next = weight(ray, levels, table, i + 1, left, outer, shape);
            }
            sum += 0.5 * (own.max(before) + own.max(next)) + even;
            before = own;
            own = next;
        }
    }
    (sum, left)
}

/// First walk: how many of a ray's samples lie in the inner volume, and both volumes' light.
#[cube(launch_unchecked)]
fn count_kernel(
    rays: &[f32],
    inner: &[u32],
    outer: &[u32],
    table: &[f32],
    counts: &mut [u32],
    masses: &mut [f32],
    count: u32,
    #[comptime] shape: Shape,
) {
    let index = ABSOLUTE_POS;
    if index < count as usize {
        let ray = ray_at(rays, index, shape);
        let (near, left) = mass(&ray, inner, table, 1.0f32, false, shape);
        let (far, _) = mass(&ray, outer, table, left, true, shape);
        let share = near / (near + far).max(1e-20);
        let samples = comptime!(shape.samples as f32);
        let most = select(ray.steps == 0, 0.0f32, samples - 1.0);
        counts[index] = u32::cast_from((samples * share).round().clamp(0.0, most));
        masses[2 * index] = near;
        masses[2 * index + 1] = far;
    }
}

/// Where every ray's inner and outer samples begin and end, and where each volume's do. One cube:
/// each unit adds up its rays' counts, then all those before it.
#[cube(launch_unchecked)]
#[allow(clippy::needless_range_loop, reason = "kernels know no iterators")]
fn scan_kernel(
    counts: &[u32],
    spans: &mut [u32],
    bounds: &mut [u32],
    rays: u32,
    #[comptime] samples: usize,
) {
    let unit = UNIT_POS as usize;
    let rays = rays as usize;
    let own = rays.div_ceil(UNITS as usize);
    let first = (unit * own).min(rays);
    let last = (first + own).min(rays);
    let mut sums = Shared::<[u32]>::new_slice(UNITS as usize);
    let mut sum = 0u32;
    for ray in first..last {
        sum += counts[ray];
    }
    sums[unit] = sum;
    sync_cube();
    let mut all = 0u32;
    let mut before = 0u32;
    for other in 0..UNITS as usize {
        before += select(other < unit, sums[other], 0u32);
        all += sums[other];
    }
    for ray in first..last {
        let within = counts[ray];
        let behind = all + (ray * samples) as u32 - before;
        spans[4 * ray] = before;
        spans[4 * ray + 1] = before + within;
        spans[4 * ray + 2] = behind;
        spans[4 * ray + 3] = behind + samples as u32 - within;
        before += within;
    }
    if unit == 0 {
        bounds[0] = 0u32;
        bounds[1] = all;
        bounds[2] = (rays * samples) as u32;
    }
}

/// Where the samples of a launch go.
#[derive(CubeType)]
struct Target {
    /// All samples of the batch.
    all: usize,
    shift: f32,
    surface: f32,
    /// First of the ray's in this volume, and how many there are.
    first: usize,
    parts: usize,
}

/// Writes the sample that stands for a volume's steps from `start` to `end`, in which some light is
/// expected. Where that is too little, it stands for no length, and is as if it were not there; but
/// for the last outer one, which everything infinitely far belongs to.
#[cube]
fn put(
    ray: &Ray,
    target: &Target,
    part: usize,
    start: f32,
    end: f32,
    expected: f32,
    points: &mut [f32],
    steps: &mut [f32],
    #[comptime] outer: bool,
    #[comptime] shape: Shape,
) {
    let at = target.first + part;
    let middle = start + target.shift * (end - start);
    let mut depth = comptime!(shape.near()) + middle * ray.step;
    let length = select(
        expected < comptime!(shape.least_weight()),
        0.0f32,
        end - start,
    );
    let mut delta = length * ray.step * ray.length;
    if outer {
        let step = comptime!(1.0 / shape.outer_steps as f32);
        let (place, found) = outer_place(ray, 1.0 - middle * step);
        set_point(points, 3 * at, &place);
        depth = found;
        delta = select(part + 1 == target.parts, LAST_STEP, length * step);
    } else {
        set_point(points, 3 * at, &inner_place(ray, depth));
    }
    let distance = depth * ray.length;
    let contracted = distance / (1.0 + distance);
    steps[at] = delta;
    steps[target.all + at] = depth;
    steps[2 * target.all + at] = contracted;
    // Measured from the surface that is known on the ray; nothing where none is.
    let off = f32::abs(contracted - target.surface);
    steps[3 * target.all + at] = select(target.surface < 0.0, 0.0f32, off);
}

/// Cuts one volume's steps into parts of equal light, a sample for each.
#[cube]
fn cut(
    ray: &Ray,
    levels: &[u32],
    table: &[f32],
    reaching: f32,
    total: f32,
    target: &Target,
    points: &mut [f32],
    steps: &mut [f32],
    #[comptime] outer: bool,
    #[comptime] shape: Shape,
) -> f32 {
    let count = steps_of(ray, outer, shape);
    let even = comptime!(shape.even()) / f32::cast_from(count.max(1));
    let parts = f32::cast_from(target.parts);
    let mut left = reaching;
    if count > 0 {
        let mut before = 0.0f32;
        let mut own = weight(ray, levels, table, 0usize, left, outer, shape);
        let mut sum = 0.0f32;
        let mut part = 0usize;
        let mut start = 0.0f32;
        for i in 0..count {
            left -= own;
            let mut next = own;
            if i + 1 < count {
                next = weight(ray, levels, table, i + 1, left, outer, shape);
            }
            let after = sum + 0.5 * (own.max(before) + own.max(next)) + even;
            let last = i + 1 == count;
            while part < target.parts && (last || after >= total * f32::cast_from(part + 1) / parts)
            {
                let wanted = total * f32::cast_from(part + 1) / parts;
                let within = (wanted - sum) / (after - sum).max(1e-20);
                let inside = (f32::cast_from(i) + within.clamp(0.0, 1.0)).max(start);
                let end = select(part + 1 == target.parts, f32::cast_from(count), inside);
                let expected = total / parts - even * (end - start);
                put(
                    ray, target, part, start, end, expected, points, steps, outer, shape,
                );
                start = end;
                part += 1;
            }
            sum = after;
            before = own;
            own = next;
        }
    }
    left
}

/// Second walk: the samples.
#[cube(launch_unchecked)]
fn place_kernel(
    rays: &[f32],
    inner: &[u32],
    outer: &[u32],
    table: &[f32],
    masses: &[f32],
    spans: &[u32],
    points: &mut [f32],
    steps: &mut [f32],
    count: u32,
    #[comptime] shape: Shape,
) {
    let index = ABSOLUTE_POS;
    if index < count as usize {
        let ray = ray_at(rays, index, shape);
        let first = spans[4 * index] as usize;
        let near = Target {
            all: count as usize * comptime!(shape.samples),
            shift: rays[index * RAY + 6],
            surface: rays[index * RAY + 7],
            first,
            parts: spans[4 * index + 1] as usize - first,
        };
        let behind = spans[4 * index + 2] as usize;
        let far = Target {
            all: near.all,
            shift: near.shift,
            surface: near.surface,
            first: behind,
            parts: spans[4 * index + 3] as usize - behind,
        };
        let inner_mass = masses[2 * index];
        let outer_mass = masses[2 * index + 1];
        let left = cut(
            &ray, inner, table, 1.0f32, inner_mass, &near, points, steps, false, shape,
        );
        cut(
            &ray, outer, table, left, outer_mass, &far, points, steps, true, shape,
        );
    }
}

/// Samples of a batch of rays, all that marching finds.
#[derive(Clone)]
pub(crate) struct Marched {
    /// `[n, 3]`, in the unit cube: inner samples ray by ray, then outer ones.
    pub(crate) points: CubeTensor,
    /// Start and end of the inner, then of the outer samples of each ray.
    pub(crate) spans: CubeTensor,
    /// `[4, n]`: step lengths, depths, contracted distances, distances from the known surface.
    pub(crate) steps: CubeTensor,
    /// First inner sample, first outer sample, number of samples.
    pub(crate) bounds: CubeTensor,
}

impl Marched {
    /// Room for so many samples.
    fn empty(rays: &CubeTensor, samples: usize) -> Self {
        Self {
            points: empty(rays, [samples, 3]),
            spans: empty_u32(rays, 4 * rays.meta.shape()[0]),
            steps: empty(rays, [4, samples]),
            bounds: empty_u32(rays, 3),
        }
    }
}

/// Samples of rays, `[rays, RAY]`, by the levels of both volumes' grids; those that
/// are expected to have a smaller weight than `least_weight` count for nothing.
///
/// # Panics
/// If there are no rays.
pub(crate) fn march(
    rays: &CubeTensor,
    levels: [&CubeTensor; 2],
    sides: [usize; 2],
    spec: &OccupancySpec,
    least_weight: f32,
) -> Marched {
    let count = rays.meta.shape()[0];
    assert!(count > 0, "rays to march");
    let shape = Shape::of(spec, sides, least_weight);
    let n = count * shape.samples;
    let table = Uploaded::f32(rays, &table(spec));
    let (counts, masses) = (empty_u32(rays, count), empty(rays, [count, 2]));
    let marched = Marched::empty(rays, n);
    let client = &rays.client;
    // SAFETY: units look at their own ray; spans divide `n` among them; cells lie inside the grids.
    unsafe {
        count_kernel::launch_unchecked(
            client,
            cubes_for(count),
            cube(),
            argument(rays),
            argument(levels[0]),
            argument(levels[1]),
            table.argument(),
            argument(&counts),
            argument(&masses),
            count as u32,
            shape,
        );
        scan_kernel::launch_unchecked(
            client,
            CubeCount::new_1d(1),
            cube(),
            argument(&counts),
            argument(&marched.spans),
            argument(&marched.bounds),
            count as u32,
            shape.samples,
        );
        place_kernel::launch_unchecked(
            client,
            cubes_for(count),
            cube(),
            argument(rays),
            argument(levels[0]),
            argument(levels[1]),
            table.argument(),
            argument(&masses),
            argument(&marched.spans),
            argument(&marched.points),
            argument(&marched.steps),
            count as u32,
            shape,
        );
    }
    marched
}
