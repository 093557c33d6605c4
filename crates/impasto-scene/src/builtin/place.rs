//! What stands on the plaza: plinth, flower pots, benches, lamps and the low wall around it.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::Vec2;

use super::builder::{Builder, Paint};
use super::ground::{FIRST_PATH, PLAZA};
use super::solids::{Material, Solid};
use super::statue::FOOT;
use super::surroundings::{cafe, church, houses, trees};

/// Half extents of the lowest step under the plinth.
pub const STEPS: Vec2 = Vec2::new(1.9, 1.38);
/// The plinth is turned with the statue on it.
pub const PLINTH_TURN: f32 = 0.4;

/// All solids of the place.
pub fn solids() -> Vec<Solid> {
    let mut builder = Builder::default();
    plinth(&mut builder);
    flower_pots(&mut builder);
    furniture(&mut builder);
    walls(&mut builder);
    trees(&mut builder);
    cafe(&mut builder);
    houses(&mut builder);
    church(&mut builder);
    builder.into_solids()
}

fn plinth(b: &mut Builder) {
    let step = Paint::two(Material::Ashlar, 0xB7B0A4, 0x9E968C);
    let die = Paint::two(Material::Ashlar, 0xCDB48C, 0xB98F62);
    let sand = Paint::one(Material::Stone, 0xCDB48C);
    let pale = Paint::one(Material::Stone, 0xDDCBAA);
    let bronze = Paint::one(Material::Stone, 0x4F6A5C);
    let tablet = Paint::two(Material::Tablet, 0x5E4630, 0xD0A24C);
    b.frame(0.0, 0.0, PLINTH_TURN);
    b.block([STEPS.x, STEPS.y, 0.09], [0.0, 0.0, 0.09], step);
    b.block([1.55, 1.04, 0.09], [0.0, 0.0, 0.27], step);
    b.block([1.26, 0.76, 0.13], [0.0, 0.0, 0.49], pale);
    b.block([1.16, 0.66, 0.05], [0.0, 0.0, 0.66], sand);
    b.block([1.06, 0.56, 0.38], [0.0, 0.0, 1.05], die);
    b.block([1.14, 0.64, 0.04], [0.0, 0.0, 1.43], sand);
    b.block([1.22, 0.72, 0.05], [0.0, 0.0, 1.52], pale);
    b.block([1.0, 0.46, 0.025], [0.0, 0.0, FOOT - 0.03], bronze);
    for side in [-1.0, 1.0] {
        b.block([0.62, 0.012, 0.24], [0.0, side * 0.565, 1.05], tablet);
        b.block([0.012, 0.3, 0.24], [side * 1.065, 0.0, 1.05], tablet);
    }
}

fn flower_pots(b: &mut Builder) {
    let pot = Paint::one(Material::Stone, 0xB5654A);
    let pots = [
        (2.15, 1.7, 0xE2403A, 0xF4B93E),
        (-2.15, 1.7, 0xD9529A, 0xF3EDE0),
        (2.15, -1.7, 0x8450B8, 0xE9C53F),
        (-2.15, -1.7, 0xF08A2C, 0xE8E0D0),
    ];
    for (x, y, first, second) in pots {
        let blossoms = Paint::two(Material::Flowers, first, second);
        b.stump([0.25, 0.34], 0.4, [x, y, 0.0], pot);
        b.ball([0.38, 0.38, 0.3], [x, y, 0.5], blossoms);
    }
}

fn furniture(b: &mut Builder) {
    for k in 0..8 {
        let angle = FIRST_PATH + (k as f32 + 0.5) * TAU / 8.0;
        b.frame(10.9, angle, angle - FRAC_PI_2);
        bench(b, [0x2F7A54, 0xB5462F][k % 2]);
        let angle = FIRST_PATH + 0.22 + k as f32 * TAU / 8.0;
        b.frame(11.5, angle, angle);
        lamp(b);
    }
}

/// A bench facing −y.
fn bench(b: &mut Builder, colour: u32) {
    let iron = Paint::one(Material::Iron, 0x2E3436);
    let wood = Paint::one(Material::Wood, colour);
    for slat in 0..3 {
        let step = 0.14 * slat as f32;
        b.block([0.9, 0.055, 0.022], [0.0, step - 0.2, 0.46], wood);
        b.block([0.9, 0.022, 0.05], [0.0, 0.2, step + 0.58], wood);
    }
    for side in [-0.7, 0.7] {
        b.block([0.035, 0.24, 0.22], [side, 0.0, 0.22], iron);
        b.block([0.035, 0.03, 0.24], [side, 0.23, 0.68], iron);
    }
}

fn lamp(b: &mut Builder) {
    let iron = Paint::one(Material::Iron, 0x27403C);
    let glass = Paint::one(Material::Lamp, 0xFBF3DC);
    b.stump([0.17, 0.1], 0.5, [0.0; 3], iron);
    b.stump([0.06, 0.045], 2.6, [0.0, 0.0, 0.5], iron);
    b.block([0.05, 0.5, 0.03], [0.0, 0.0, 3.0], iron);
    for side in [-0.45, 0.45] {
        b.ball([0.19, 0.19, 0.21], [0.0, side, 3.27], glass);
        b.stump([0.14, 0.02], 0.12, [0.0, side, 3.44], iron);
    }
}

/// Four arcs of low wall between the paths, with hedges and flowers behind them.
fn walls(b: &mut Builder) {
    const PIECES: usize = 6;
    const HALF_GAP: f32 = 0.17;
    let masonry = Paint::two(Material::Ashlar, 0xC2AE90, 0xA9927A);
    let coping = Paint::one(Material::Stone, 0xDCD0B8);
    let pillar = Paint::two(Material::Ashlar, 0xCDB48C, 0xB0946E);
    let flowers = Paint::two(Material::Flowers, 0xD8413C, 0xF2C23C);
    let hedge = Paint::two(Material::Hedge, 0x2C5A2A, 0x6D9A3E);
    let arc = TAU / 4.0 - 2.0 * HALF_GAP;
    let step = arc / PIECES as f32;
    let length = PLAZA * (step * 0.5).tan() + 0.03;
    for quarter in 0..4 {
        let start = FIRST_PATH + quarter as f32 * TAU / 4.0 + HALF_GAP;
        for piece in 0..PIECES {
            let angle = start + (piece as f32 + 0.5) * step;
            b.frame(PLAZA, angle, angle - FRAC_PI_2);
            b.block([length, 0.2, 0.25], [0.0, 0.0, 0.25], masonry);
            b.block([length + 0.02, 0.26, 0.04], [0.0, 0.0, 0.54], coping);
            if piece % 3 == 1 {
                b.ball([1.0, 0.42, 0.45], [0.0, 0.75, 0.42], flowers);
            } else {
                b.block([length, 0.35, 0.42], [0.0, 0.85, 0.42], hedge);
            }
        }
        for end in [start, start + arc] {
            b.frame(PLAZA, end, end);
            b.block([0.32, 0.32, 0.5], [0.0, 0.0, 0.5], pillar);
            b.roof([0.38, 0.38, 0.3, 0.0], [0.0, 0.0, 1.0], 0.0, coping);
        }
    }
}
