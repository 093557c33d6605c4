//! Solid texture (Perlin 1985, Peachey 1985): a periodic volume of learned entries, read at octaves that follow
//! the size of what is painted, after Bénard et al. 2009, "Dynamic Solid Textures": of several octaves
//! that lie next to each other, every one fades in and out as a place comes nearer, so that elements
//! keep about their size on the screen.

use crate::settings::OutOfRange;
use pulp::Arch;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Numbers per entry.
pub const FEATURES: usize = 8;
/// Cells from one bend to the next of the same kind.
pub(crate) const BENDS: f32 = 9.5;
/// Cells that were bent more would lie on top of each other.
const MOST_BEND: f32 = 1.5;
/// Numbers of a place: three coordinates and its footprint.
pub const PLACE: usize = 4;
/// Places handled by one task.
const CHUNK: usize = 1024;
/// Most pieces that a gradient is summed up in.
const PIECES: usize = 4;
/// Least and greatest footprint that octaves follow.
pub(crate) const FOOTPRINTS: [f32; 2] = [1e-5, 1.0];

/// Sizes of a solid texture. The table is laid out `[x][y][z][feature]` and repeats in space.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolidTextureSpec {
    /// Octaves that a place sees.
    pub octaves: usize,
    /// Entries along an axis, after which the texture repeats.
    pub side: usize,
    /// Cell of the finest octave, in footprints.
    pub finest: f32,
    /// Cells of an octave over those of the next finer one.
    pub ratio: f32,
    /// How many times as long as wide a cell is: what strokes have and blots have not.
    pub stretch: f32,
    /// How far cells are bent to and fro, in widths.
    pub bend: f32,
}

impl SolidTextureSpec {
    /// Checks the sizes.
    ///
    /// # Errors
    /// The first that is out of range, with its name behind `path`.
    pub fn check(&self, path: &str) -> Result<(), OutOfRange> {
        let fault = |key, allowed| Err(OutOfRange::new(path, key, allowed));
        if !(1..=16).contains(&self.octaves) {
            return fault("octaves", "1 to 16");
        }
        if !(2..=64).contains(&self.side) {
            return fault("side", "2 to 64");
        }
        if !(0.25..=64.0).contains(&self.finest) {
            return fault("finest", "0.25 to 64");
        }
        if !(1.1..=4.0).contains(&self.ratio) {
            return fault("ratio", "1.1 to 4");
        }
        if !(1.0..=8.0).contains(&self.stretch) {
            return fault("stretch", "1 to 8");
        }
        if !(0.0..=MOST_BEND).contains(&self.bend) {
            return fault("bend", "0 to 1.5");
        }
        Ok(())
    }

    /// Width of what a place sees.
    pub fn outputs(&self) -> usize {
        self.octaves * FEATURES
    }

    /// Length of the table.
    pub fn params(&self) -> usize {
        self.side.pow(3) * FEATURES
    }
}

/// One octave of space: how places become cells.
#[derive(Debug, Clone, Copy)]
struct Octave {
    rows: [[f32; 3]; 3],
    shift: [f32; 3],
}

impl Octave {
    /// Octave `number`, whose cells are `ratio^number` wide; each is turned and shifted in its own way,
    /// so that no axis shows.
    fn new(number: i32, ratio: f32) -> Self {
        let cells = ratio.powi(-number);
        // A quaternion and a shift from multiples of irrational numbers.
        let at = |step: f64| ((f64::from(number) + 0.5) * step).rem_euclid(1.0) as f32;
        let q = [0.754_877, 0.569_84, 0.618_034, 0.445_042].map(|step| at(step) - 0.5);
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
        let [w, x, y, z] = q.map(|x| x / length);
        let rows = [
            [
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y - w * z),
                2.0 * (x * z + w * y),
            ],
            [
                2.0 * (x * y + w * z),
                1.0 - 2.0 * (x * x + z * z),
                2.0 * (y * z - w * x),
            ],
            [
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                1.0 - 2.0 * (x * x + y * y),
            ],
        ];
        Self {
            rows: rows.map(|row| row.map(|x| x * cells)),
            shift: [0.732_05, 0.414_21, 0.236_07].map(|step| 32.0 * at(step)),
        }
    }
}

/// How octave `number` turns and scales positions, rows of a matrix, and by how much it shifts them.
pub fn octave(spec: &SolidTextureSpec, number: i32) -> ([[f32; 3]; 3], [f32; 3]) {
    let Octave { rows, shift } = Octave::new(number, spec.ratio);
    (rows, shift)
}

/// All octaves that any footprint asks for.
#[derive(Debug)]
pub(crate) struct Octaves {
    pub(crate) first: i32,
    all: Vec<Octave>,
}

impl Octaves {
    pub(crate) fn new(spec: &SolidTextureSpec) -> Self {
        let [first, last] = FOOTPRINTS.map(|footprint| level(spec, footprint).floor() as i32);
        let all = first..=last + spec.octaves as i32;
        Self {
            first,
            all: all.map(|number| Octave::new(number, spec.ratio)).collect(),
        }
    }
}

#[cfg(feature = "gpu")]
impl Octaves {
    /// Octave by octave, rows of its matrix and its shift.
    pub(crate) fn numbers(&self) -> Vec<f32> {
        let all = self.all.iter();
        all.flat_map(|octave| octave.rows.into_iter().chain([octave.shift]).flatten())
            .collect()
    }
}

/// Number of the octave whose cells are the finest of a footprint, with fraction.
fn level(spec: &SolidTextureSpec, footprint: f32) -> f32 {
    let footprint = footprint.clamp(FOOTPRINTS[0], FOOTPRINTS[1]);
    (spec.finest * footprint).ln() / spec.ratio.ln()
}

/// How much of two octaves that lie next to each other a slot sees: weights whose squares sum to one, so
/// that contrast stays while one fades into the other.
fn fade(fraction: f32) -> [f32; 2] {
    let length = (fraction * fraction + (1.0 - fraction) * (1.0 - fraction)).sqrt();
    [(1.0 - fraction) / length, fraction / length]
}

/// About the sine of `t` turns.
#[inline(always)]
fn wave(t: f32) -> f32 {
    let y = t - t.floor() - 0.5;
    y * (y.abs() * 2.0 - 1.0) * 8.0
}

/// Entries and interpolation weights of a place in an octave.
struct Cell {
    entries: [usize; 8],
    weights: [f32; 8],
}

impl Cell {
    #[inline(always)]
    fn of(octave: &Octave, place: &[f32], spec: &SolidTextureSpec) -> Self {
        let side = spec.side;
        let straight: [f32; 3] = std::array::from_fn(|axis| {
            let row = octave.rows[axis];
            row[0] * place[0] + row[1] * place[1] + row[2] * place[2] + octave.shift[axis]
        });
        let mut low = [0usize; 3];
        let mut high = [0usize; 3];
        let mut part = [0f32; 3];
        let inverse = 1.0 / side as f32;
        for axis in 0..3 {
            let x = straight[axis] + spec.bend * wave(straight[(axis + 1) % 3] * (1.0 / BENDS));
            let x = if axis == 0 { x / spec.stretch } else { x };
            let below = x.floor();
            part[axis] = x - below;
            let wrapped = below - side as f32 * (below * inverse).floor();
            low[axis] = (wrapped as usize).min(side - 1);
            high[axis] = if low[axis] + 1 == side {
                0
            } else {
                low[axis] + 1
            };
        }
        let mut cell = Self {
            entries: [0; 8],
            weights: [0.0; 8],
        };
        for corner in 0..8 {
            let pick = |axis: usize| match corner >> axis & 1 {
                0 => (low[axis], 1.0 - part[axis]),
                _ => (high[axis], part[axis]),
            };
            let (x, y, z) = (pick(0), pick(1), pick(2));
            cell.entries[corner] = (x.0 * side + y.0) * side + z.0;
            cell.weights[corner] = x.1 * y.1 * z.1;
        }
        cell
    }
}

/// Does something with every octave of a place: its cell, its number counted from the finest, and weights
/// in the slots `number` and `number - 1`.
#[inline(always)]
fn visit(
    spec: &SolidTextureSpec,
    octaves: &Octaves,
    place: &[f32],
    mut work: impl FnMut(usize, [f32; 2], &Cell),
) {
    if !place.iter().all(|x| x.is_finite()) {
        return;
    }
    let level = level(spec, place[3]);
    let finest = level.floor();
    let weights = fade(level - finest);
    let start = (finest as i32 - octaves.first).max(0) as usize;
    for number in 0..=spec.octaves {
        let cell = Cell::of(&octaves.all[start + number], place, spec);
        work(number, weights, &cell);
    }
}

/// What places see: octave by octave, the finest first.
///
/// # Shapes
/// `places`: `n × 4`, coordinates and footprint, in one unit; `table`: `spec.params()`; result:
/// `n × spec.outputs()`. A place that is not finite sees zeros.
///
/// # Panics
/// If a slice does not have its stated length.
pub fn forward(spec: &SolidTextureSpec, places: &[f32], table: &[f32]) -> Vec<f32> {
    assert_eq!(table.len(), spec.params(), "table of a solid texture");
    let octaves = Octaves::new(spec);
    let (entries, _) = table.as_chunks::<FEATURES>();
    let width = spec.outputs();
    let mut out = vec![0.0; places.len() / PLACE * width];
    out.par_chunks_mut(CHUNK * width)
        .zip(places.par_chunks(CHUNK * PLACE))
        .for_each(|(out, places)| {
            Arch::new().dispatch(|| read(spec, &octaves, places, entries, out));
        });
    out
}

#[inline(always)]
fn read(
    spec: &SolidTextureSpec,
    octaves: &Octaves,
    places: &[f32],
    entries: &[[f32; FEATURES]],
    out: &mut [f32],
) {
    for (place, out) in places
        .chunks_exact(PLACE)
        .zip(out.chunks_exact_mut(spec.outputs()))
    {
        let (slots, _) = out.as_chunks_mut::<FEATURES>();
        visit(spec, octaves, place, |number, [own, before], cell| {
            let mut sum = [0f32; FEATURES];
            for corner in 0..8 {
                let entry = &entries[cell.entries[corner]];
                for f in 0..FEATURES {
                    sum[f] += cell.weights[corner] * entry[f];
                }
            }
            if let Some(slot) = slots.get_mut(number) {
                slot.iter_mut().zip(&sum).for_each(|(s, x)| *s += own * x);
            }
            if let Some(slot) = number.checked_sub(1).and_then(|n| slots.get_mut(n)) {
                slot.iter_mut()
                    .zip(&sum)
                    .for_each(|(s, x)| *s += before * x);
            }
        });
    }
}

/// Gradient of [`forward`] for the table. Places are not differentiated.
///
/// # Shapes
/// `grad`: `n × spec.outputs()`; result: `spec.params()`.
///
/// # Panics
/// If the gradient does not have its stated length.
pub fn backward(spec: &SolidTextureSpec, places: &[f32], grad: &[f32]) -> Vec<f32> {
    let width = spec.outputs();
    let count = places.len() / PLACE;
    assert_eq!(grad.len(), count * width, "gradient of a solid texture");
    let octaves = Octaves::new(spec);
    let piece = count.div_ceil(PIECES).max(CHUNK);
    let parts: Vec<Vec<f32>> = grad
        .par_chunks(piece * width)
        .zip(places.par_chunks(piece * PLACE))
        .map(|(grad, places)| {
            let mut sum = vec![0.0; spec.params()];
            let (entries, _) = sum.as_chunks_mut::<FEATURES>();
            Arch::new().dispatch(|| spread(spec, &octaves, places, grad, entries));
            sum
        })
        .collect();
    let mut parts = parts.into_iter();
    let Some(mut sum) = parts.next() else {
        return vec![0.0; spec.params()];
    };
    for part in parts {
        sum.iter_mut().zip(&part).for_each(|(s, x)| *s += x);
    }
    sum
}

#[inline(always)]
fn spread(
    spec: &SolidTextureSpec,
    octaves: &Octaves,
    places: &[f32],
    grad: &[f32],
    entries: &mut [[f32; FEATURES]],
) {
    for (place, grad) in places
        .chunks_exact(PLACE)
        .zip(grad.chunks_exact(spec.outputs()))
    {
        let (slots, _) = grad.as_chunks::<FEATURES>();
        visit(spec, octaves, place, |number, [own, before], cell| {
            let mut sum = [0f32; FEATURES];
            if let Some(slot) = slots.get(number) {
                sum.iter_mut().zip(slot).for_each(|(s, x)| *s += own * x);
            }
            if let Some(slot) = number.checked_sub(1).and_then(|n| slots.get(n)) {
                sum.iter_mut().zip(slot).for_each(|(s, x)| *s += before * x);
            }
            for corner in 0..8 {
                let entry = &mut entries[cell.entries[corner]];
                for f in 0..FEATURES {
                    entry[f] += cell.weights[corner] * sum[f];
                }
            }
        });
    }
}
