//! Texture by example: a picture's own detail laid over surfaces. Random windows of the picture on a
//! triangle lattice, blended so that contrast stays (Heitz & Neyret 2018, "High-Performance By-Example Noise
//! using a Histogram-Preserving Blending Operator"), never repeat and show no whole motif. They are projected
//! along the nearest of six axes, and of two octaves that lie next to each other one fades into the other
//! as a place comes nearer (Bénard et al. 2009, "Dynamic Solid Textures").

use pulp::Arch;
use rayon::prelude::*;

/// Texels along a side.
pub const SIDE: usize = 256;
/// Numbers per texel.
pub const FEATURES: usize = 12;
/// Length of a table, laid out `[y][x][feature]`.
pub const PARAMS: usize = SIDE * SIDE * FEATURES;
/// Numbers of a place: three coordinates and its footprint.
pub const PLACE: usize = 4;
/// Coordinates of a normal.
pub const NORMAL: usize = 3;
/// Texels between the middles of two windows that lie next to each other.
pub const SPACING: f32 = 48.0;
/// Texels between which a window's middle may lie.
pub(crate) const FREE: f32 = SIDE as f32 - 2.0 * SPACING;
/// The higher, the less of two windows is seen where they meet.
pub const SHARPNESS: i32 = 6;
/// The higher, the less of two projections is seen where they meet.
pub const FACING: i32 = 8;
/// What less is seen of is left out.
pub const LEAST_SHARE: f32 = 5e-3;
/// Least and greatest footprint that octaves follow.
pub(crate) const FOOTPRINTS: [f32; 2] = [1e-5, 1.0];
/// Places handled by one task.
const CHUNK: usize = 1024;
/// Most pieces that a gradient is summed up in.
const PIECES: usize = 4;
/// Most windows that a place sees something of.
const MOST_TAPS: usize = AXES * 2 * 3;

/// Axes that the picture is projected along: every second corner of an icosahedron, so that none is
/// farther than 37.4° from a normal.
pub const AXES: usize = 6;
/// Sine of 60°, by which the lattice's second axis leans.
pub const LEAN: f32 = 0.866_025_4;

/// See [`frames`].
pub type Frames = [[[f32; 3]; 3]; AXES];

/// Of each axis two directions at right angles to it and to each other, then the axis.
pub fn frames() -> Frames {
    const LONG: f32 = 0.850_650_8;
    const SHORT: f32 = 0.525_731_1;
    let corners: [[f32; 3]; AXES] = [
        [0.0, SHORT, LONG],
        [0.0, SHORT, -LONG],
        [SHORT, LONG, 0.0],
        [SHORT, -LONG, 0.0],
        [LONG, 0.0, SHORT],
        [-LONG, 0.0, SHORT],
    ];
    corners.map(|axis| {
        let [x, y, z] = axis;
        // At right angles to the axis: two coordinates change places, one with the other sign.
        let first = match x == 0.0 {
            true => [1.0, 0.0, 0.0],
            false if z == 0.0 => [0.0, 0.0, 1.0],
            false => [0.0, 1.0, 0.0],
        };
        let second = [
            y * first[2] - z * first[1],
            z * first[0] - x * first[2],
            x * first[1] - y * first[0],
        ];
        [first, second, axis]
    })
}

/// Added to numbers of windows and of octaves before they are hashed, so that none is negative.
pub(crate) const OFFSETS: [i32; 2] = [1 << 20, 32];
/// Odd numbers that a window's coordinates, its octave and its axis are multiplied with.
pub(crate) const FACTORS: [u32; 4] = [0x8da6_b343, 0xd816_3841, 0xcb1a_b31f, 0x9e37_79b9];
/// Shifts and factors of the rounds that mix them.
pub(crate) const ROUNDS: [(u32, u32); 2] = [(16, 0x7feb_352d), (15, 0x846c_a68b)];

/// Where a window's middle lies in the picture, in texels: as good as random by its place in the lattice, its
/// octave and its axis, and so that all of the window lies within.
pub fn middle([x, y]: [i32; 2], octave: i32, axis: usize) -> [f32; 2] {
    let numbers = [
        x + OFFSETS[0],
        y + OFFSETS[0],
        octave + OFFSETS[1],
        axis as i32,
    ];
    let factors = numbers.into_iter().zip(FACTORS);
    let mut hash = factors.fold(0, |hash, (x, factor)| {
        hash ^ (x as u32).wrapping_mul(factor)
    });
    for (shift, factor) in ROUNDS {
        hash = (hash ^ (hash >> shift)).wrapping_mul(factor);
    }
    let hash = hash ^ (hash >> 16);
    [hash & 0xffff, hash >> 16].map(|half| SPACING + FREE * half as f32 * (1.0 / 65536.0))
}

/// The three windows of a lattice that reach a place, `x` and `y` in spacings: which, and how much is seen
/// of each before sharpening.
fn windows(x: f32, y: f32) -> [([i32; 2], f32); 3] {
    // Lattice coordinates: the second axis leans by 60°.
    let v = y / LEAN;
    let u = x - 0.5 * v;
    let (i, j) = (u.floor(), v.floor());
    let (a, b) = (u - i, v - j);
    let (i, j) = (i as i32, j as i32);
    let rest = 1.0 - a - b;
    if rest > 0.0 {
        [([i, j], rest), ([i + 1, j], a), ([i, j + 1], b)]
    } else {
        [
            ([i + 1, j + 1], -rest),
            ([i + 1, j], 1.0 - b),
            ([i, j + 1], 1.0 - a),
        ]
    }
}

/// Shares that sum to one of numbers that are not negative, the larger ones favoured.
#[inline(always)]
fn sharpened<const N: usize>(numbers: [f32; N], power: i32) -> [f32; N] {
    let powers = numbers.map(|x| x.powi(power));
    let sum = powers.iter().sum::<f32>().max(1e-20);
    powers.map(|x| x / sum)
}

/// Four texels, by the first, between which a place lies in a window.
#[derive(Debug, Clone, Copy, Default)]
struct Tap {
    first: usize,
    shares: [f32; 4],
}

impl Tap {
    /// `x` and `y` in texels of the picture.
    #[inline(always)]
    fn of([x, y]: [f32; 2], weight: f32) -> Self {
        let most = SIDE as f32 - 1.001;
        let (x, y) = (x.clamp(0.0, most), y.clamp(0.0, most));
        let (column, row) = (x.floor(), y.floor());
        let (a, b) = (x - column, y - row);
        let shares = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
        Self {
            first: row as usize * SIDE + column as usize,
            shares: shares.map(|share| share * weight),
        }
    }

    #[inline(always)]
    fn texels(&self) -> [(usize, f32); 4] {
        let [a, b, c, d] = self.shares;
        let at = self.first;
        [(at, a), (at + 1, b), (at + SIDE, c), (at + SIDE + 1, d)]
    }
}

/// Where a place looks in a picture.
struct Taps {
    taps: [Tap; MOST_TAPS],
    count: usize,
    /// What makes the squares of all weights sum to one, so that contrast stays.
    gain: f32,
}

impl Taps {
    #[inline(always)]
    fn of(frames: &Frames, place: &[f32; PLACE], normal: &[f32; NORMAL]) -> Self {
        let mut found = Self {
            taps: [Tap::default(); MOST_TAPS],
            count: 0,
            gain: 0.0,
        };
        if !place.iter().chain(normal).all(|x| x.is_finite()) {
            return found;
        }
        let along = |v: &[f32; 3], w: &[f32]| v[0] * w[0] + v[1] * w[1] + v[2] * w[2];
        let facing = sharpened(frames.map(|[.., axis]| along(&axis, normal).abs()), FACING);
        let level = place[3].clamp(FOOTPRINTS[0], FOOTPRINTS[1]).log2();
        let finest = level.floor();
        let next = level - finest;
        let mut squares = 0.0;
        for (axis, ([first, second, _], facing)) in frames.iter().zip(facing).enumerate() {
            if facing < LEAST_SHARE {
                continue;
            }
            let (x, y) = (along(first, place), along(second, place));
            for (turn, fade) in [1.0 - next, next].into_iter().enumerate() {
                if fade < LEAST_SHARE {
                    continue;
                }
                let octave = finest as i32 + turn as i32;
                let texels_a_unit = (-(octave as f32)).exp2();
                let (x, y) = (x * texels_a_unit, y * texels_a_unit);
                let all = windows(x / SPACING, y / SPACING);
                let shares = sharpened(all.map(|(_, share)| share), SHARPNESS);
                for (([i, j], _), share) in all.into_iter().zip(shares) {
                    if share < LEAST_SHARE {
                        continue;
                    }
                    let [u, v] = middle([i, j], octave, axis);
                    // From the window's middle.
                    let x = x - SPACING * (i as f32 + 0.5 * j as f32);
                    let y = y - SPACING * LEAN * j as f32;
                    let weight = facing * fade * share;
                    squares += weight * weight;
                    found.taps[found.count] = Tap::of([u + x, v + y], weight);
                    found.count += 1;
                }
            }
        }
        found.gain = squares.max(1e-20).sqrt().recip();
        found
    }

    #[inline(always)]
    fn texels(&self) -> impl Iterator<Item = (usize, f32)> {
        let taps = self.taps[..self.count].iter();
        taps.flat_map(Tap::texels)
            .map(|(at, share)| (at, share * self.gain))
    }
}

/// What places see of a picture.
///
/// # Shapes
/// `places`: `n × 4`, coordinates and footprint, in one unit; a texel is between half as wide as the footprint
/// and twice. `normals`: `n × 3`, of any length and either sign; where there is none, zeros, which see
/// nothing. `table`: [`PARAMS`]. Result: `n × 12`. A place that is not finite sees zeros.
///
/// # Panics
/// If a slice does not have its stated length.
pub fn forward(places: &[f32], normals: &[f32], table: &[f32]) -> Vec<f32> {
    assert_eq!(table.len(), PARAMS, "table of an exemplar");
    let (texels, _) = table.as_chunks::<FEATURES>();
    let mut out = vec![0.0; places.len() / PLACE * FEATURES];
    out.par_chunks_mut(CHUNK * FEATURES)
        .zip(paired(places, normals, CHUNK))
        .for_each(|(out, (places, normals))| {
            Arch::new().dispatch(|| {
                let (out, _) = out.as_chunks_mut::<FEATURES>();
                visit(places, normals, |row, at, share| {
                    for f in 0..FEATURES {
                        out[row][f] += share * texels[at][f];
                    }
                });
            });
        });
    out
}

/// Gradient of [`forward`] for the table. Places and normals are not differentiated.
///
/// # Shapes
/// `grad`: `n × 12`; result: [`PARAMS`].
///
/// # Panics
/// If the gradient does not have its stated length.
pub fn backward(places: &[f32], normals: &[f32], grad: &[f32]) -> Vec<f32> {
    let count = places.len() / PLACE;
    assert_eq!(grad.len(), count * FEATURES, "gradient of an exemplar");
    let piece = count.div_ceil(PIECES).max(CHUNK);
    let parts: Vec<Vec<f32>> = grad
        .par_chunks(piece * FEATURES)
        .zip(paired(places, normals, piece))
        .map(|(grad, (places, normals))| {
            let mut sum = vec![0.0; PARAMS];
            let (texels, _) = sum.as_chunks_mut::<FEATURES>();
            let (grad, _) = grad.as_chunks::<FEATURES>();
            Arch::new().dispatch(|| {
                visit(places, normals, |row, at, share| {
                    for f in 0..FEATURES {
                        texels[at][f] += share * grad[row][f];
                    }
                });
            });
            sum
        })
        .collect();
    let mut parts = parts.into_iter();
    let Some(mut sum) = parts.next() else {
        return vec![0.0; PARAMS];
    };
    for part in parts {
        sum.iter_mut().zip(&part).for_each(|(s, x)| *s += x);
    }
    sum
}

/// Places with their normals, in pieces.
fn paired<'a>(
    places: &'a [f32],
    normals: &'a [f32],
    piece: usize,
) -> impl IndexedParallelIterator<Item = (&'a [f32], &'a [f32])> {
    assert_eq!(
        places.len() / PLACE,
        normals.len() / NORMAL,
        "a normal a place"
    );
    let normals = normals.par_chunks(piece * NORMAL);
    places.par_chunks(piece * PLACE).zip(normals)
}

/// Does something with every place's number, each texel that it sees and how much.
#[inline(always)]
fn visit(places: &[f32], normals: &[f32], mut work: impl FnMut(usize, usize, f32)) {
    let frames = frames();
    let (places, _) = places.as_chunks::<PLACE>();
    let (normals, _) = normals.as_chunks::<NORMAL>();
    for (row, (place, normal)) in places.iter().zip(normals).enumerate() {
        let taps = Taps::of(&frames, place, normal);
        for (at, share) in taps.texels() {
            work(row, at, share);
        }
    }
}
