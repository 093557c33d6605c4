//! A trained model as its users see it: looks and rendered views.

use crate::TrainError;
use crate::model_file::ModelFile;
use crate::rays::CameraRays;
use crate::styles::whole;
use burn::tensor::Device;
use image::RgbImage;
use impasto_field::{Appearance, Field, render_rays};
use impasto_scene::Camera;
use impasto_style::{Perceptual, StyleCode, StyleError, StyleVae};
use std::path::Path;

/// A model ready to render.
pub struct Model {
    /// What was read.
    pub file: ModelFile,
    field: Field,
    device: Device,
    encoder: std::sync::OnceLock<Encoder>,
}

struct Encoder {
    vgg: Perceptual,
    vae: StyleVae,
}

/// One way to colour the scene.
#[derive(Debug, Clone)]
pub struct Look(Appearance);

/// One rendered view.
#[derive(Debug, Clone)]
pub struct RenderedView {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Per look, `height × width × 3` in `[0, 1]`.
    pub pixels: Vec<Vec<f32>>,
    /// `height × width`, depth along the camera's axis in scene units.
    pub depth: Vec<f32>,
}

/// How much farther from the average painting a look is made than its code says. A hypernetwork
/// that is unsure predicts something average, so looks come out tamer than their paintings. Chosen
/// on paintings of the training set: beyond 1.25 to 1.5 their style gain falls slowly while more of
/// them can be told apart, up to about 2.
pub const EMPHASIS: f32 = 1.75;

impl Model {
    /// Reads a model folder or file.
    ///
    /// # Errors
    /// See [`ModelFile::load`].
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        let device = Device::flex();
        Ok(Self::from_file(ModelFile::load(path, &device)?, device))
    }

    /// A model from its contents.
    pub fn from_file(file: ModelFile, device: Device) -> Self {
        Self {
            field: Field::new(file.config.field.clone()),
            file,
            device,
            encoder: std::sync::OnceLock::new(),
        }
    }

    /// Whether it can be painted: the style stage has run.
    pub fn has_style(&self) -> bool {
        self.file.style.is_some()
    }

    /// The code of a painting: its middle square, always the same.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn style_code(&self, painting: &RgbImage) -> Result<StyleCode, StyleError> {
        let encoder = match self.encoder.get() {
            Some(encoder) => encoder,
            None => {
                let made = Encoder {
                    vgg: Perceptual::vgg16()?,
                    vae: StyleVae::shipped()?,
                };
                self.encoder.get_or_init(|| made)
            }
        };
        Ok(encoder.vae.encode(&whole(&encoder.vgg, painting)?))
    }

    /// The look that a code gives, [emphasised](EMPHASIS), or `None` if the style stage has not
    /// run. The hypernetwork runs once, here.
    pub fn look(&self, code: &StyleCode) -> Option<Look> {
        let style = self.file.style.as_ref()?;
        Some(Look(style.appearance(
            &self.file.config,
            &code.scaled(EMPHASIS),
            &self.device,
        )))
    }

    /// The photo's own look.
    pub fn photo_look(&self) -> Look {
        Look(self.file.photo_app.clone())
    }

    /// Renders a view with every look; geometry is computed once.
    pub fn render(&self, camera: &Camera, looks: &[&Look]) -> RenderedView {
        let rays = CameraRays::new(camera, None);
        let (width, height) = rays.size();
        let appearances: Vec<&Appearance> = looks.iter().map(|look| &look.0).collect();
        let rendered = render_rays(
            &self.field,
            &self.file.weights,
            &self.file.grids,
            &appearances,
            &rays.all(),
        );
        RenderedView {
            width,
            height,
            pixels: rendered.colours,
            depth: rendered.depth,
        }
    }
}
