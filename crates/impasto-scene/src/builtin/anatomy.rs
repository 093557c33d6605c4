//! The bones of the rider and the horse: tapered capsules, in metres before the statue's scale.
//! x points forward, y to the left, z up from the feet.

use glam::Vec3;

/// A tapered capsule and how softly it joins the bones before it.
#[derive(Debug, Clone, Copy)]
struct Bone {
    from: Vec3,
    axis: Vec3,
    inverse_length: f32,
    radius: f32,
    taper: f32,
    blend: f32,
}

/// Bones near each other, with a box around them.
#[derive(Debug)]
pub struct Limb {
    bones: Vec<Bone>,
    /// Lowest corner of the box around them, joints included.
    pub low: Vec3,
    /// Its highest corner.
    pub high: Vec3,
}

impl Limb {
    /// Signed distance to the smooth union of the bones.
    pub fn distance(&self, p: Vec3) -> f32 {
        let join = |d, bone: &Bone| smooth_min(d, bone.distance(p), bone.blend);
        self.bones.iter().fold(f32::INFINITY, join)
    }
}

impl Bone {
    fn distance(&self, p: Vec3) -> f32 {
        let v = p - self.from;
        let h = (v.dot(self.axis) * self.inverse_length).clamp(0.0, 1.0);
        (v - self.axis * h).length() - self.radius - self.taper * h
    }
}

/// The smaller of two distances, rounded off where they differ by less than `blend`.
pub fn smooth_min(a: f32, b: f32, blend: f32) -> f32 {
    let h = (1.0 - (a - b).abs() / blend).max(0.0);
    a.min(b) - h * h * blend * 0.25
}

/// A row of a table: where a bone begins and ends, its radius there, and its blend.
type Row = ([f32; 3], [f32; 3], [f32; 2], f32);

fn bone(&(from, to, [radius, end], blend): &Row) -> Bone {
    let axis = Vec3::from(to) - Vec3::from(from);
    Bone {
        from: from.into(),
        axis,
        inverse_length: 1.0 / axis.length_squared().max(1e-9),
        radius,
        taper: end - radius,
        blend,
    }
}

fn limb(rows: &[Row]) -> Limb {
    let bones: Vec<Bone> = rows.iter().map(bone).collect();
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for b in &bones {
        let radius = b.radius.max(b.radius + b.taper) + b.blend * 0.25;
        low = low.min(b.from - radius).min(b.from + b.axis - radius);
        high = high.max(b.from + radius).max(b.from + b.axis + radius);
    }
    Limb { bones, low, high }
}

/// A leg from its joints: shoulder or hip, knee or hock, fetlock, hoof.
fn leg([top, knee, fetlock, hoof]: [[f32; 3]; 4], thick: f32) -> Limb {
    let toe = [hoof[0] + 0.05, hoof[1], hoof[2] - 0.03];
    limb(&[
        (top, knee, [thick, 0.078], 0.1),
        (knee, fetlock, [0.076, 0.047], 0.05),
        (fetlock, hoof, [0.055, 0.058], 0.03),
        (hoof, toe, [0.066, 0.082], 0.01),
    ])
}

/// A bundle of bones beside each other.
struct Bundle {
    from: [f32; 3],
    to: [f32; 3],
    /// Half-widths along y at both ends.
    spread: [f32; 2],
    radii: [f32; 2],
    count: usize,
}

impl Bundle {
    fn strands(&self) -> Vec<Row> {
        let strand = |index: usize| {
            let side = 2.0 * index as f32 / (self.count - 1) as f32 - 1.0;
            let sag = 0.05 * (1.0 - side * side);
            let ([x, y, z], [to_x, to_y, to_z]) = (self.from, self.to);
            let [spread, to_spread] = self.spread.map(|spread| side * spread);
            let to = [to_x - sag, to_y + to_spread, to_z];
            ([x, y + spread, z], to, self.radii, 0.035)
        };
        (0..self.count).map(strand).collect()
    }
}

/// All limbs of the statue.
pub fn limbs() -> Vec<Limb> {
    let mut all = vec![limb(&BODY), limb(&NECK), limb(&mane()), limb(&tail())];
    all.extend(LEGS.map(|(joints, thick)| leg(joints, thick)));
    all.extend([
        limb(&TORSO),
        limb(&RAISED_ARM),
        limb(&SABRE),
        limb(&REIN_ARM),
    ]);
    all.extend([-1.0, 1.0].map(|side| limb(&rider_leg(side))));
    all.extend(CAPE.map(|bundle| limb(&bundle.strands())));
    all
}

fn mane() -> Vec<Row> {
    let lock = |index: i32| {
        let h = index as f32 / 6.0;
        let (x, z) = (0.84 - 0.5 * h, 2.1 - 0.58 * h);
        let lean = if index % 2 == 0 { 0.09 } else { 0.05 };
        ([x, 0.02, z], [x - 0.17, lean, z - 0.16], [0.06, 0.04], 0.03)
    };
    (0..7).map(lock).collect()
}

fn tail() -> Vec<Row> {
    let mut tail = vec![DOCK];
    tail.extend(TAIL.iter().flat_map(Bundle::strands));
    tail
}

fn rider_leg(side: f32) -> [Row; 3] {
    RIDER_LEG.map(|([x, y, z], [to_x, to_y, to_z], radii, blend)| {
        ([x, side * y, z], [to_x, side * to_y, to_z], radii, blend)
    })
}

#[rustfmt::skip]
const BODY: [Row; 6] = [
    ([0.36, 0.0, 1.14], [-0.12, 0.0, 1.12], [0.335, 0.335], 0.1),
    ([-0.12, 0.0, 1.12], [-0.56, 0.0, 1.17], [0.335, 0.335], 0.1),
    ([0.42, 0.13, 1.1], [0.34, 0.15, 1.02], [0.24, 0.2], 0.12),
    ([0.42, -0.13, 1.1], [0.34, -0.15, 1.02], [0.24, 0.2], 0.12),
    ([-0.6, 0.14, 1.14], [-0.55, 0.17, 0.98], [0.25, 0.21], 0.12),
    ([-0.6, -0.14, 1.14], [-0.55, -0.17, 0.98], [0.25, 0.21], 0.12),
];

/// Neck, head and ears.
#[rustfmt::skip]
const NECK: [Row; 8] = [
    ([0.44, 0.0, 1.24], [0.72, 0.0, 1.66], [0.29, 0.18], 0.12),
    ([0.72, 0.0, 1.66], [0.86, 0.0, 1.95], [0.18, 0.135], 0.1),
    ([0.9, 0.0, 1.97], [1.02, 0.0, 1.83], [0.14, 0.12], 0.06),
    ([1.02, 0.0, 1.83], [1.23, 0.0, 1.53], [0.115, 0.076], 0.08),
    ([0.92, 0.0, 1.86], [1.03, 0.0, 1.72], [0.12, 0.085], 0.06),
    ([1.23, 0.0, 1.53], [1.25, 0.0, 1.48], [0.086, 0.08], 0.03),
    ([0.85, 0.075, 2.06], [0.87, 0.1, 2.2], [0.045, 0.012], 0.03),
    ([0.85, -0.075, 2.06], [0.87, -0.1, 2.2], [0.045, 0.012], 0.03),
];

/// The tail's root.
const DOCK: Row = ([-0.84, 0.0, 1.32], [-1.02, 0.0, 1.32], [0.085, 0.085], 0.06);

#[rustfmt::skip]
const TAIL: [Bundle; 2] = [
    Bundle { from: [-1.02, 0.0, 1.32], to: [-1.14, 0.0, 1.02], spread: [0.02, 0.07], radii: [0.075, 0.075], count: 4 },
    Bundle { from: [-1.14, 0.0, 1.02], to: [-1.1, 0.0, 0.6], spread: [0.07, 0.05], radii: [0.075, 0.02], count: 4 },
];

/// Joints of the horse's legs, and how thick they begin.
#[rustfmt::skip]
const LEGS: [([[f32; 3]; 4], f32); 4] = [
    ([[0.44, 0.18, 1.04], [0.8, 0.19, 0.86], [0.68, 0.19, 0.54], [0.6, 0.19, 0.46]], 0.17),
    ([[0.4, -0.18, 1.02], [0.44, -0.19, 0.6], [0.42, -0.19, 0.19], [0.46, -0.19, 0.08]], 0.17),
    ([[-0.52, 0.19, 0.98], [-0.78, 0.19, 0.58], [-0.72, 0.19, 0.2], [-0.67, 0.19, 0.08]], 0.2),
    ([[-0.5, -0.19, 0.98], [-0.58, -0.19, 0.56], [-0.42, -0.19, 0.2], [-0.37, -0.19, 0.08]], 0.2),
];

/// The rider's body and head.
const TORSO: [Row; 10] = [
    ([-0.02, 0.0, 1.52], [0.0, 0.0, 1.72], [0.2, 0.165], 0.06),
    ([0.0, 0.0, 1.75], [0.01, 0.0, 2.0], [0.165, 0.2], 0.08),
    ([0.0, -0.2, 2.06], [0.0, 0.2, 2.06], [0.1, 0.1], 0.1),
    ([0.0, 0.0, 2.1], [0.03, 0.0, 2.28], [0.075, 0.07], 0.05),
    ([0.035, 0.0, 2.36], [0.045, 0.0, 2.42], [0.115, 0.12], 0.03),
    ([0.15, 0.0, 2.38], [0.17, 0.0, 2.34], [0.02, 0.03], 0.03),
    // The hat: a broad brim turned up at both sides, and its crown.
    ([0.03, -0.2, 2.5], [0.03, 0.2, 2.5], [0.04, 0.04], 0.04),
    ([0.22, 0.0, 2.47], [-0.14, 0.0, 2.49], [0.04, 0.05], 0.12),
    ([0.03, 0.0, 2.54], [0.02, 0.0, 2.6], [0.12, 0.07], 0.05),
    ([-0.02, 0.1, 2.6], [-0.3, 0.12, 2.66], [0.045, 0.02], 0.04),
];

const RAISED_ARM: [Row; 3] = [
    ([0.0, -0.25, 2.06], [0.2, -0.4, 2.3], [0.1, 0.075], 0.06),
    ([0.2, -0.4, 2.3], [0.4, -0.38, 2.64], [0.075, 0.055], 0.04),
    ([0.4, -0.38, 2.66], [0.42, -0.38, 2.7], [0.065, 0.06], 0.03),
];

#[rustfmt::skip]
const SABRE: [Row; 3] = [
    ([0.32, -0.38, 2.63], [0.52, -0.38, 2.76], [0.028, 0.028], 0.01),
    ([0.4, -0.38, 2.66], [0.52, -0.37, 3.1], [0.034, 0.03], 0.01),
    ([0.52, -0.37, 3.1], [0.72, -0.35, 3.5], [0.03, 0.012], 0.02),
];

/// The other arm, with the rein in its hand.
const REIN_ARM: [Row; 4] = [
    ([0.0, 0.25, 2.06], [0.0, 0.36, 1.78], [0.1, 0.075], 0.06),
    ([0.0, 0.36, 1.78], [0.3, 0.16, 1.7], [0.075, 0.05], 0.04),
    ([0.3, 0.16, 1.7], [0.36, 0.13, 1.72], [0.06, 0.055], 0.02),
    ([0.36, 0.13, 1.7], [1.12, 0.11, 1.62], [0.014, 0.014], 0.01),
];

/// The rider's left leg; the right one is its mirror image.
const RIDER_LEG: [Row; 3] = [
    ([0.02, 0.16, 1.48], [0.3, 0.39, 1.22], [0.145, 0.1], 0.06),
    ([0.3, 0.39, 1.22], [0.14, 0.42, 0.78], [0.1, 0.062], 0.04),
    ([0.12, 0.42, 0.74], [0.31, 0.43, 0.7], [0.055, 0.04], 0.03),
];

#[rustfmt::skip]
const CAPE: [Bundle; 2] = [
    Bundle { from: [-0.13, 0.0, 2.04], to: [-0.7, 0.0, 1.5], spread: [0.17, 0.34], radii: [0.075, 0.07], count: 6 },
    Bundle { from: [-0.66, 0.0, 1.52], to: [-0.82, 0.0, 1.36], spread: [0.32, 0.4], radii: [0.065, 0.04], count: 6 },
];
