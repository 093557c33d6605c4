//! What shows a scene, behind which the model stands.

use image::RgbImage;
use impasto_model::{ModelPhoto, StyleLayers};
use impasto_scene::{Camera, Normalisation, Split, Vantage};
use serde_json::{Value, json};

/// Shows a scene from anywhere, and paints it. It works for one thread, which owns it.
pub trait Painter: Send + 'static {
    /// The geometry of a view: costly to make, cheap to paint.
    type Geometry: ViewGeometry;
    /// Layers of paint, ready.
    type Paint;

    /// What there is to see.
    fn facts(&self) -> SceneFacts;

    /// The geometry that a camera sees, one ray a pixel.
    fn view(&self, camera: &Camera) -> Self::Geometry;

    /// Colours of a view, height × width × 3 in `[0, 1]`; without paint as photographed.
    fn paint(&self, view: &Self::Geometry, paint: Option<&Self::Paint>) -> Vec<f32>;

    /// Makes coats ready. `pictures` gives the painting of an id.
    ///
    /// # Errors
    /// Why they cannot be had, as a sentence.
    fn mix(&mut self, coats: &StyleLayers, pictures: Pictures<'_>) -> Result<Self::Paint, String>;
}

/// Gives the painting of an id, or says why it is not to be had.
pub type Pictures<'a> = &'a dyn Fn(&str) -> Result<RgbImage, String>;

/// The geometry of a view.
pub trait ViewGeometry {
    /// Depth along the camera's axis in scene units, row by row; infinite where nothing is.
    fn depth(&self) -> &[f32];

    /// Memory that it takes, in bytes.
    fn bytes(&self) -> usize;
}

/// What is known of a scene.
#[derive(Debug, Clone)]
pub struct SceneFacts {
    /// Its name.
    pub name: String,
    /// Whether its photos were made by a program.
    pub synthetic: bool,
    /// Whether it can be painted.
    pub styled: bool,
    /// The way back to the capture's coordinates.
    pub normalisation: Normalisation,
    /// Its photos.
    pub photos: Vec<ModelPhoto>,
}

impl SceneFacts {
    /// The answer of `GET /api/scene`.
    pub fn json(&self) -> Value {
        let of = |split| {
            let photos = self.photos.iter().filter(|photo| photo.split == split);
            photos.map(|photo| photo.camera).collect::<Vec<_>>()
        };
        let vantage = Vantage::of(&of(Split::Train)).or_else(|| Vantage::of(&of(Split::Test)));
        let first = self.photos.first().map(|photo| &photo.camera);
        let photo = |photo: &ModelPhoto| {
            json!({
                "name": photo.name,
                "split": photo.split,
                "camera_to_world": photo.camera.camera_to_world.to_cols_array(),
                "fov": photo.camera.fov(),
            })
        };
        json!({
            "name": self.name,
            "synthetic": self.synthetic,
            "styled": self.styled,
            "up": vantage.map_or([0.0, -1.0, 0.0], |v| v.up.to_array()),
            "focus": vantage.map_or([0.0; 3], |v| v.focus.to_array()),
            "radius": vantage.map_or(1.0, |v| v.radius),
            "fov": first.map_or(50.0, Camera::fov),
            "size": first.map_or([640, 360], |c| [c.intrinsics.width, c.intrinsics.height]),
            "photos": self.photos.iter().map(photo).collect::<Vec<_>>(),
            "start": 0,
        })
    }
}
