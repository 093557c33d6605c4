//! What a capture is like: lenses, how cameras stand, and photo by photo what may be wrong.

mod compare;
mod coverage;
mod distance;
mod facts;
mod layout;
mod neighbours;
mod problems;
mod quality;

use serde::Serialize;

use crate::camera::Camera;
use crate::paths::camera_geometry::CameraGeometry;
use crate::scene::Scene;
pub use coverage::Coverage;
pub use distance::surface_distance;
pub use facts::PhotoFacts;
pub use layout::{CameraLayout, CapturePattern, LensUse};
use problems::Measurements;
pub use problems::{Problem, ProblemKind};

/// What was found about a capture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Lenses, those with most photos first.
    pub lenses: Vec<LensUse>,
    /// Where cameras stand.
    pub cameras: CameraLayout,
    /// How many photos see what one shows.
    pub coverage: Coverage,
    /// Photo by photo, in the scene's order.
    pub per_photo: Vec<PhotoFacts>,
    /// What is wrong with single photos, the worst first.
    pub problems: Vec<Problem>,
}

/// Examines every photo and camera of a capture. Runs on all of rayon's threads; takes about a
/// second for a hundred photos of ten megapixels.
pub fn inspect(scene: &Scene) -> Inspection {
    let cameras: Vec<Camera> = scene.photos.iter().map(|photo| photo.camera).collect();
    let geometry = CameraGeometry::of(&cameras);
    let seen = neighbours::seen(scene);
    let has_points = seen.iter().any(|points| !points.is_empty());
    let near = if has_points {
        neighbours::by_points(scene, &seen)
    } else {
        neighbours::by_views(&cameras, &geometry)
    };
    let qualities = compare::qualities(&scene.photos, &seen);
    let compared = compare::compare(&qualities, &near);
    let facts = |i: usize| {
        let seen = has_points.then(|| &seen[i]);
        PhotoFacts::of(scene, i, &near[i], seen, &qualities[i], compared[i])
    };
    let facts: Vec<PhotoFacts> = (0..cameras.len()).map(facts).collect();
    let coverage = coverage::coverage(scene, &geometry, &seen);
    let layout = layout::layout(scene, &cameras, &geometry);
    let problems = problems::find(&Measurements {
        scene,
        cameras: &cameras,
        geometry: &geometry,
        layout: &layout,
        facts: &facts,
        compared: &compared,
        qualities: &qualities,
    });
    Inspection {
        lenses: layout::lenses(scene),
        cameras: layout,
        coverage,
        per_photo: facts,
        problems,
    }
}
