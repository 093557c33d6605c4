//! What stands around the plaza: trees, a café, houses and a church.

use std::f32::consts::{FRAC_PI_2, TAU};

use super::builder::{Builder, Paint};
use super::ground::{FIRST_PATH, LAWN};
use super::noise::draw;
use super::solids::{Material, Wall};

/// Dark and light green of foliage, or what stands for it in blossom and autumn.
const FOLIAGE: [[u32; 2]; 6] = [
    [0x2F6A2E, 0x8DB63F],
    [0x3F7A2C, 0xB2C24A],
    [0x2A5F42, 0x6FA659],
    [0x8A4A1E, 0xE0A03A],
    [0xB7557A, 0xF3BFCB],
    [0x3C6E2A, 0x9CC04A],
];
const PLASTER: [u32; 8] = [
    0xE9C46A, 0xE58F73, 0xF0DDB8, 0x9FC1B4, 0xD98C8C, 0xF2E9D8, 0xC9CF9A, 0xE7B08A,
];
const DOORS: [u32; 5] = [0x2F6B5E, 0x2B5C8A, 0x8A3A2E, 0x4C7A3A, 0x6A4A8A];
const TILES: [u32; 5] = [0xB5533A, 0xA8452F, 0x8C4A3A, 0x6E5A5E, 0xC0673F];
/// Places for a house around the street; one of them is the church's.
const PLOTS: i32 = 17;
const CHURCH_PLOT: i32 = 5;

fn choose<T: Copy>(list: &[T], x: f32) -> T {
    list[(x * list.len() as f32) as usize % list.len()]
}

/// A ring of trees on the lawn that leaves the paths free.
pub fn trees(b: &mut Builder) {
    for index in 0..17i32 {
        let pick = |k: i32| draw(77, index * 9 + k);
        let angle = (index as f32 + 0.5 + 0.5 * (pick(0) - 0.5)) * TAU / 17.0;
        let to_path = (angle - FIRST_PATH).rem_euclid(FRAC_PI_2);
        if to_path.min(FRAC_PI_2 - to_path) < 0.15 {
            continue;
        }
        b.frame(14.4 + (LAWN - 15.8) * pick(1), angle, pick(2) * TAU);
        if index % 5 == 2 {
            poplar(b, 6.5 + 2.0 * pick(4));
        } else {
            let [dark, light] = choose(&FOLIAGE, pick(3));
            let leaves = Paint::two(Material::Leaves, dark, light);
            round_tree(b, 0.85 + 0.4 * pick(4), leaves, index);
        }
    }
}

fn poplar(b: &mut Builder, height: f32) {
    let bark = Paint::one(Material::Bark, 0x7A6248);
    let leaves = Paint::two(Material::Leaves, 0x1F5238, 0x5C8F45);
    b.stump([0.16, 0.1], height * 0.4, [0.0; 3], bark);
    for (z, r) in [(0.24, 0.62), (0.45, 0.72), (0.66, 0.58), (0.85, 0.36)] {
        b.ball([r, r, height * 0.19], [0.0, 0.0, height * z], leaves);
    }
}

fn round_tree(b: &mut Builder, size: f32, leaves: Paint, index: i32) {
    let trunk = 1.9 * size + 0.6;
    let bark = Paint::one(Material::Bark, 0x6B5038);
    b.stump([0.24 * size, 0.13 * size], trunk + 0.8, [0.0; 3], bark);
    let crown = trunk + 1.2 * size;
    let blob = |r: f32, flat: f32| [r * size, r * size, flat * size];
    b.ball(blob(1.35, 1.15), [0.0, 0.0, crown + 0.3], leaves);
    for k in 0..6 {
        let pick = |n: i32| draw(91, index * 40 + k * 4 + n);
        let angle = (k as f32 + 0.6 * pick(0)) * TAU / 6.0;
        let out = (0.85 + 0.35 * pick(1)) * size;
        let up = (1.1 * pick(2) - 0.35) * size;
        let r = 0.7 + 0.3 * pick(3);
        let at = [out * angle.cos(), out * angle.sin(), crown + up];
        b.ball(blob(r, r * 0.82), at, leaves);
    }
    b.ball(blob(0.9, 0.75), [0.1, 0.0, crown + 1.25 * size], leaves);
}

/// Parasols and tables on the lawn's edge in one quarter of the place.
pub fn cafe(b: &mut Builder) {
    let pole = Paint::one(Material::Wood, 0xB58A5A);
    let table = Paint::one(Material::Wood, 0xE8DFCC);
    let chair = Paint::one(Material::Wood, 0x9A6238);
    let colours = [0xD23B34, 0x2E6FB7, 0xEAB13A, 0xD23B34];
    for (index, colour) in colours.into_iter().enumerate() {
        let cloth = Paint::two(Material::Canvas, colour, 0xF5EFE2);
        let angle = FIRST_PATH + 0.4 + 0.25 * index as f32;
        b.frame([14.2, 15.6][index % 2], angle, angle);
        b.stump([0.035, 0.035], 2.7, [0.0; 3], pole);
        b.stump([1.5, 0.04], 0.7, [0.0, 0.0, 2.1], cloth);
        b.stump([0.5, 0.5], 0.05, [0.0, 0.0, 0.74], table);
        for side in [-0.85, 0.85] {
            b.block([0.2, 0.2, 0.23], [side, 0.1, 0.23], chair);
        }
    }
}

/// A ring of houses along the street.
pub fn houses(b: &mut Builder) {
    for plot in (0..PLOTS).filter(|&plot| plot != CHURCH_PLOT) {
        house(b, plot);
    }
}

fn house(b: &mut Builder, plot: i32) {
    let pick = |k: i32| draw(41, plot * 16 + k);
    let angle = (plot as f32 + 0.25 * (pick(0) - 0.5)) * TAU / PLOTS as f32;
    let (half_x, half_y) = (3.4 + 1.4 * pick(1), 3.0 + pick(2));
    let floors = choose(&[1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0], pick(3));
    let eaves = 2.95 * floors + 0.3;
    let turn = angle - FRAC_PI_2 + 0.2 * (pick(5) - 0.5);
    b.frame(25.0 + 2.5 * pick(4) + half_y, angle, turn);
    let (wall, tint) = match plot % 4 {
        1 => (Wall::Brick, 0xB0604A),
        3 => (Wall::Timber, 0xF1E6CC),
        _ => (Wall::Plaster, PLASTER[(plot * 3) as usize % PLASTER.len()]),
    };
    let front = Paint::two(Material::Facade(wall), tint, choose(&DOORS, pick(6)));
    let middle = eaves * 0.5;
    b.block([half_x, half_y, middle], [0.0, 0.0, middle], front);

    let gable_to_street = pick(7) < 0.4;
    let (along, across, quarter) = if gable_to_street {
        (half_y, half_x, FRAC_PI_2)
    } else {
        (half_x, half_y, 0.0)
    };
    let height = across * (0.75 + 0.3 * pick(8));
    let gabled = pick(9) < 0.65;
    let ridge = if gabled { along + 0.2 } else { along * 0.5 };
    let tiles = Paint::two(Material::Roof, choose(&TILES, pick(10)), tint);
    let size = [along + 0.2, across + 0.4, height, ridge];
    b.roof(size, [0.0, 0.0, eaves - 0.1], quarter, tiles);

    let chimney = Paint::two(Material::Ashlar, 0xA65A44, 0x8A4636);
    let top = [half_x * (pick(11) - 0.5), -0.6, eaves + height * 0.75];
    b.block([0.3, 0.3, 0.9], top, chimney);
    if pick(12) < 0.6 {
        let bush = Paint::two(Material::Flowers, 0xE6679A, 0xF6EFE4);
        let side = if pick(13) < 0.5 { -1.0 } else { 1.0 };
        let at = [side * (half_x - 0.5), -half_y - 0.7, 0.55];
        b.ball([0.8, 0.7, 0.75], at, bush);
    }
}

/// The landmark that breaks the ring's symmetry.
pub fn church(b: &mut Builder) {
    let angle = CHURCH_PLOT as f32 * TAU / PLOTS as f32;
    b.frame(29.0, angle, angle - FRAC_PI_2);
    let tower = Paint::one(Material::Tower, 0xCBA98A);
    let slate = Paint::two(Material::Roof, 0x4F6B78, 0xEFE3C8);
    let front = Paint::two(Material::Facade(Wall::Plaster), 0xEFE3C8, 0x7A3A2C);
    b.block([2.1, 2.1, 5.6], [-2.4, 0.0, 5.6], tower);
    b.roof([2.4, 2.4, 6.2, 0.0], [-2.4, 0.0, 11.2], 0.0, slate);
    b.block([3.4, 3.2, 2.7], [3.0, 2.0, 2.7], front);
    b.roof([3.6, 3.5, 3.6, 3.6], [3.0, 2.0, 5.3], 0.0, slate);
}
