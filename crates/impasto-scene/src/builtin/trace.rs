//! From a ray to a linear colour and a distance.

use std::sync::OnceLock;

use glam::{Vec2, Vec3};

use super::bvh::Bvh;
use super::ground;
use super::materials::surface;
use super::noise::{fbm3, smoothstep};
use super::place::{PLINTH_TURN, STEPS, solids};
use super::sky::{SUN, SUN_LIGHT, ambient, backdrop, gradient, rgb};
use super::solids::{Contact, Solid};
use super::statue::Statue;
use super::surface::Surface;

/// The whole scene, ready for rays.
#[derive(Debug)]
pub struct World {
    solids: Bvh,
    statue: Statue,
}

/// What a ray meets first.
pub enum Thing<'a> {
    /// Sky and hills, infinitely far.
    Backdrop,
    /// The plane z = 0.
    Ground,
    /// The rider and horse.
    Statue,
    /// An analytic solid.
    Solid(&'a Solid, Contact),
}

/// The scene; built once, on first use.
pub fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| World {
        solids: Bvh::new(solids()),
        statue: Statue::new(),
    })
}

impl World {
    /// What the unit ray meets and how far away; infinite for the backdrop.
    pub fn meet(&self, origin: Vec3, direction: Vec3) -> (Thing<'_>, f32) {
        let mut nearest = (Thing::Backdrop, f32::INFINITY);
        let fall = -origin.z / direction.z;
        if fall > 0.0 && (origin + direction * fall).truncate().length() < ground::EDGE {
            nearest = (Thing::Ground, fall);
        }
        if let Some((solid, contact)) = self.solids.first_hit(origin, direction, nearest.1) {
            nearest = (Thing::Solid(solid, contact), contact.t);
        }
        if let Some(t) = self.statue.hit(origin, direction, nearest.1) {
            nearest = (Thing::Statue, t);
        }
        nearest
    }

    /// Linear colour along the unit ray and the distance to what was met. `pixel` is the angle
    /// (radians) that a pixel spans.
    pub fn radiance(&self, origin: Vec3, direction: Vec3, pixel: f32) -> (Vec3, f32) {
        let (thing, t) = self.meet(origin, direction);
        let point = origin + direction * t;
        // The geometric mean of a pixel's extent along and across the slope.
        let footprint = |normal: Vec3| t * pixel / normal.dot(direction).abs().max(0.06).sqrt();
        let (surface, flat) = match thing {
            Thing::Backdrop => return (backdrop(direction, pixel), t),
            Thing::Ground => (ground_surface(point, footprint(Vec3::Z)), Vec3::Z),
            Thing::Statue => {
                let normal = self.statue.normal(point);
                (self.bronze(point, normal, footprint(normal)), normal)
            }
            Thing::Solid(solid, contact) => {
                let flat = solid.world(contact.normal);
                (surface(solid, &contact, footprint(flat)), flat)
            }
        };
        let colour = self.lit(&surface, flat, point, direction);
        let haze = 1.0 - (-(t - 12.0).max(0.0) / 260.0).exp();
        (colour.lerp(rgb(0xC6DAE4), haze), t)
    }

    /// Sun, sky and highlights on a surface whose geometric normal is `flat`.
    fn lit(&self, surface: &Surface, flat: Vec3, point: Vec3, direction: Vec3) -> Vec3 {
        let n = surface.normal;
        let facing = ((n.dot(SUN) + surface.wrap) / (1.0 + surface.wrap)).max(0.0);
        let sun = if facing > 0.0 {
            let side = if flat.dot(SUN) >= 0.0 { flat } else { SUN };
            self.sunlight(point + side * (0.004 + 0.12 * surface.wrap))
        } else {
            0.0
        };
        let half = (SUN - direction).normalize_or_zero();
        let highlight =
            n.dot(half).max(0.0).powf(surface.sharpness) * f32::from(u8::from(flat.dot(SUN) > 0.0));
        let mut colour =
            surface.albedo * (SUN_LIGHT * (facing * sun) + ambient(n) * surface.openness);
        colour += surface.shine * SUN_LIGHT * (highlight * sun);
        if surface.mirror > 0.0 {
            let bounced = direction - 2.0 * direction.dot(n) * n;
            let seen = rgb(0x9C8E78).lerp(gradient(bounced), smoothstep(-0.15, 0.1, bounced.z));
            colour += seen * (surface.mirror * surface.openness);
        }
        colour
    }

    fn sunlight(&self, point: Vec3) -> f32 {
        if self.solids.is_blocked(point, SUN) {
            return 0.0;
        }
        self.statue.sunlight(point, SUN)
    }

    /// Weathered bronze: dark metal that shines, verdigris where rain stands and runs.
    fn bronze(&self, point: Vec3, normal: Vec3, footprint: f32) -> Surface {
        let openness = self.statue.openness(point, normal);
        let cloudy = fbm3(point, 2.2, 5, footprint);
        let streaks = fbm3(point * Vec3::new(3.0, 3.0, 0.5), 2.4, 3, footprint);
        let wet = 0.75 * cloudy + 0.55 * streaks + 0.3 * normal.z - 0.05;
        let patina = smoothstep(-0.15, 0.5, wet);
        let worn = smoothstep(-0.3, 0.5, fbm3(point, 6.0, 3, footprint));
        let metal = rgb(0x6E4628).lerp(rgb(0xA8743C), worn);
        let verdigris = rgb(0x4F8F7C).lerp(rgb(0x86B8A0), 0.5 + 0.5 * streaks);
        let grain = [3.0, 13.0, 23.0].map(|shift| fbm3(point + shift, 14.0, 2, footprint));
        let gilt = self.statue.gilding(point);
        let dull = patina * (1.0 - gilt);
        Surface {
            openness: 0.3 + 0.7 * openness,
            shine: Vec3::new(1.0, 0.82, 0.55) * (0.75 - 0.6 * dull),
            sharpness: 26.0,
            mirror: 0.16 - 0.11 * dull,
            ..Surface::matte(
                metal.lerp(verdigris, patina).lerp(rgb(0xDDA83E), gilt),
                (normal + 0.22 * Vec3::from(grain)).normalize_or_zero(),
            )
        }
    }
}

fn ground_surface(point: Vec3, footprint: f32) -> Surface {
    let p = point.truncate();
    let near_plinth = Vec2::from_angle(-PLINTH_TURN).rotate(p);
    Surface {
        openness: ground::openness(near_plinth, STEPS),
        ..Surface::matte(ground::albedo(p, footprint), Vec3::Z)
    }
}
