//! House fronts: windows, shutters, doors, timber, bricks; and the clock tower.

use glam::{Vec2, Vec3};

use super::noise::{draw, fade, fbm3, hash, line, smoothstep, unit};
use super::sky::rgb;
use super::solids::{Contact, Solid, Wall};
use super::surface::{Surface, on_face};

const TRIM: Vec3 = rgb(0xF0E8D6);
const STONE: Vec3 = rgb(0xC9BDA6);
const BEAM: Vec3 = rgb(0x5A3A26);
const GLASS: Vec3 = rgb(0x35506B);

/// A point of a house front relative to the window bay that it lies in; metres.
struct Bay {
    /// Across, from the middle of the bay.
    x: f32,
    /// Up, from the storey's floor.
    y: f32,
    width: f32,
    storey: f32,
    height: f32,
    column: i32,
    floor: i32,
    columns: i32,
    top: f32,
    /// Distance to the front's nearer upright edge.
    edge: f32,
}

impl Bay {
    fn new(at: Vec2, half_width: f32, top: f32) -> Self {
        let columns = (half_width * 2.0 / 2.3).round().max(1.0);
        let floors = (top / 2.95).round().max(1.0);
        let (width, storey) = (half_width * 2.0 / columns, top / floors);
        let column = (at.x + half_width) / width;
        let column = column.floor().clamp(0.0, columns - 1.0);
        let floor = (at.y / storey).floor().clamp(0.0, floors - 1.0);
        Self {
            x: at.x + half_width - (column + 0.5) * width,
            y: at.y - floor * storey,
            width,
            storey,
            height: at.y,
            column: column as i32,
            floor: floor as i32,
            columns: columns as i32,
            top,
            edge: half_width - at.x.abs(),
        }
    }

    fn inside(&self, half: f32, low: f32, high: f32) -> bool {
        self.x.abs() < half && (low..high).contains(&self.y)
    }

    fn is_door(&self) -> bool {
        self.floor == 0 && self.column == self.columns / 2
    }
}

/// The surface of a house front.
pub fn facade(solid: &Solid, wall: Wall, half: Vec3, contact: &Contact, footprint: f32) -> Surface {
    let normal = solid.world(contact.normal);
    let (at, half_width) = on_face(contact, half);
    let bay = Bay::new(at, half_width, half.z * 2.0);
    let seed = solid.seed ^ (contact.normal.x * 3.0 + contact.normal.y * 7.0) as i32 as u32;
    if let Some(opening) = opening(solid, &bay, seed, normal) {
        return opening;
    }
    let p = contact.point + Vec3::splat((solid.seed % 977) as f32);
    let weather = 1.0 + 0.12 * fbm3(p, 0.7, 4, footprint) - 0.12 * smoothstep(1.2, 0.0, bay.height);
    let albedo = trim(&bay, wall).unwrap_or_else(|| match wall {
        Wall::Plaster => solid.tint,
        Wall::Brick => bricks(solid.tint, at, footprint),
        Wall::Timber => timber(solid.tint, &bay, seed),
    });
    let mut surface = Surface::matte(albedo * weather, normal);
    // The eaves keep the sky off the top of the wall.
    surface.openness = 1.0 - 0.3 * smoothstep(bay.top - 0.9, bay.top, bay.height);
    surface
}

/// Windows with their frames and shutters, and the door.
fn opening(solid: &Solid, bay: &Bay, seed: u32, normal: Vec3) -> Option<Surface> {
    let matte = |albedo: Vec3| Some(Surface::matte(albedo, normal));
    if bay.is_door() {
        if bay.inside(0.58, 0.0, 2.25) {
            let panel = bay.inside(0.42, 0.3, 1.05) || bay.inside(0.42, 1.25, 2.05);
            return matte(solid.accent * if panel { 0.7 } else { 1.0 });
        }
        return bay
            .inside(0.78, 0.0, 2.45)
            .then(|| Surface::matte(TRIM, normal));
    }
    let high = (bay.storey - 0.45).min(2.35);
    if bay.inside(0.5, 0.9, high) {
        let bar = bay.x.abs() < 0.05 || (bay.y - 0.9 - (high - 0.9) * 0.62).abs() < 0.05;
        if bar || !bay.inside(0.43, 0.97, high - 0.07) {
            return matte(TRIM);
        }
        let curtain = draw(seed, bay.column * 8 + bay.floor) > 0.45 && bay.x.abs() > 0.22;
        let pane = if curtain { rgb(0xB9BFC4) } else { GLASS };
        return Some(Surface {
            mirror: 0.28,
            shine: Vec3::splat(0.3),
            sharpness: 60.0,
            ..Surface::matte(pane * (0.75 + 0.4 * (bay.y - 0.9) / (high - 0.9)), normal)
        });
    }
    if bay.inside(0.68, 0.72, 0.9) {
        return matte(STONE);
    }
    if bay.inside(0.62, high, high + 0.2) {
        return matte(TRIM);
    }
    let shutters = solid.seed % 3 < 2;
    if shutters && bay.inside((bay.width * 0.5).min(0.98), 0.9, high) && bay.x.abs() > 0.52 {
        let slat = (bay.y / 0.16).fract() < 0.5;
        return matte(solid.accent * if slat { 0.82 } else { 1.05 });
    }
    None
}

/// Base, storey bands, cornice and corner stones.
fn trim(bay: &Bay, wall: Wall) -> Option<Vec3> {
    if bay.height < 0.5 {
        return Some(STONE * 0.8);
    }
    if wall == Wall::Timber {
        return None;
    }
    if bay.top - bay.height < 0.28 || (bay.floor == 1 && bay.y < 0.2) {
        return Some(TRIM);
    }
    let course = (bay.height / 0.4).floor();
    let reach = if course.rem_euclid(2.0) < 0.5 {
        0.5
    } else {
        0.3
    };
    (bay.edge < reach).then(|| STONE * (0.92 + 0.16 * unit(hash(course as i32, 1, 8))))
}

fn bricks(tint: Vec3, at: Vec2, footprint: f32) -> Vec3 {
    const COURSE: f32 = 0.17;
    let row = (at.y / COURSE).floor();
    let x = at.x / 0.42 + 0.5 * row.rem_euclid(2.0);
    let brick = hash(x.floor() as i32, row as i32, 6);
    let edge = (at.y / COURSE - row).min(row + 1.0 - at.y / COURSE) * COURSE;
    let shade = 1.0 + 0.5 * fade(footprint / 0.3) * (unit(brick) - 0.5);
    (tint * shade).lerp(rgb(0xC6B49C), line(edge, 0.014, footprint) * 0.6)
}

fn timber(tint: Vec3, bay: &Bay, seed: u32) -> Vec3 {
    let post = bay.width * 0.5 - bay.x.abs() < 0.1 || bay.edge < 0.2;
    let rail = bay.y < 0.13 || bay.storey - bay.y < 0.13 || (bay.y - 0.66).abs() < 0.08;
    let leaning = draw(seed, bay.column + 31 * bay.floor) > 0.5;
    let lean = if leaning { 1.0 } else { -1.0 };
    let cross = bay.floor > 0 && bay.y < 0.66 && (bay.y - 0.36 - lean * bay.x * 0.42).abs() < 0.09;
    if post || rail || cross { BEAM } else { tint }
}

/// The surface of the church tower.
pub fn tower(solid: &Solid, half: Vec3, contact: &Contact, footprint: f32) -> Surface {
    let normal = solid.world(contact.normal);
    let (at, half_width) = on_face(contact, half);
    let top = half.z * 2.0;
    let clock = Vec2::new(at.x, at.y - (top - 1.75));
    let r = clock.length();
    let albedo = if r < 1.1 {
        clock_face(clock, r)
    } else if at.x.abs() < 0.5 && (top - 5.2..top - 3.4 - 2.0 * at.x * at.x).contains(&at.y) {
        let louver = (at.y / 0.3).fract() < 0.45;
        rgb(0x4A4038) * if louver { 1.0 } else { 1.9 }
    } else if top - at.y < 0.35 || (top - 5.8 - at.y).abs() < 0.16 {
        TRIM
    } else if half_width - at.x.abs() < 0.55 {
        STONE
    } else {
        let p = contact.point;
        bricks(solid.tint, at * 0.6, footprint * 0.6) * (1.0 + 0.12 * fbm3(p, 0.8, 4, footprint))
    };
    Surface::matte(albedo, normal)
}

fn clock_face(p: Vec2, r: f32) -> Vec3 {
    if r > 0.97 {
        return rgb(0xC9A24A);
    }
    let hand = |direction: Vec2, length: f32, half: f32| {
        let along = p.dot(direction);
        (-0.1..length).contains(&along) && p.perp_dot(direction).abs() < half
    };
    let hour = (p.to_angle() / std::f32::consts::TAU * 12.0).rem_euclid(1.0);
    let tick = r > 0.74 && r < 0.92 && !(0.17..=0.83).contains(&hour);
    if tick || hand(Vec2::new(-0.82, 0.57), 0.5, 0.07) || hand(Vec2::new(0.5, 0.866), 0.8, 0.05) {
        rgb(0x2A2C38)
    } else {
        rgb(0xF5F0E2)
    }
}
