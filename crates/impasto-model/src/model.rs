//! A trained model as its users see it: appearances and rendered views.

use crate::appearance::StyledAppearance;
use crate::camera_rays::CameraRays;
use crate::color::ColorStatistics;
use crate::embedding::{StyleEmbedding, painting_statistics};
use crate::error::ModelError;
use crate::exemplar::exemplar;
use crate::file::ModelFile;
use crate::hypernetworks::PaintingInputs;
use crate::layers::SurfaceCells;
use crate::rendered::RenderedView;
use burn::tensor::Device;
use image::RgbImage;
use impasto_field::{
    Appearance, AppearanceConfig, Field, GBuffer, GBufferOptions, RayBatch, Renderer, host,
};
use impasto_kernels::CompositeLayout;
use impasto_scene::{Camera, Split};
use impasto_style::{Perceptual, StyleError, StyleVae};
use std::path::Path;
use std::sync::OnceLock;

/// A model ready to render.
pub struct Model {
    /// What was read.
    pub file: ModelFile,
    renderer: Renderer,
    encoder: OnceLock<Encoder>,
    /// Rays through the training views, on which styled appearances are measured.
    sample: OnceLock<Vec<GBuffer>>,
    photo_colors: OnceLock<ColorStatistics>,
    pub(crate) surfaces: OnceLock<SurfaceCells>,
}

struct Encoder {
    vgg: Perceptual,
    vae: StyleVae,
}

/// Training views that an appearance is measured on, and rays along each side of one.
const SAMPLED_VIEWS: usize = 16;
const SAMPLED_SIDE: u32 = 16;

impl Model {
    /// Reads a model folder or file, to render it on the CPU.
    ///
    /// # Errors
    /// See [`ModelFile::load`].
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        Self::load_on(path, &Device::flex())
    }

    /// Reads a model folder or file, to render it on a device, whatever it was trained on.
    ///
    /// # Errors
    /// See [`ModelFile::load`].
    pub fn load_on(path: &Path, device: &Device) -> Result<Self, ModelError> {
        Ok(Self::from_file(ModelFile::load(path, device)?))
    }

    /// A model from its contents, on the device that they are on.
    pub fn from_file(file: ModelFile) -> Self {
        let config = &file.config;
        let field = Field::new(config.field.clone());
        let weights = file.radiance.weights.clone();
        Self {
            renderer: Renderer::open(
                field,
                weights,
                file.grids.clone(),
                file.ground(),
                &config.style_appearance(),
            ),
            file,
            encoder: OnceLock::new(),
            sample: OnceLock::new(),
            photo_colors: OnceLock::new(),
            surfaces: OnceLock::new(),
        }
    }

    /// What it is rendered with.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// Whether it can be painted: the style stage has run.
    pub fn has_style(&self) -> bool {
        self.file.style.is_some()
    }

    /// What to make an appearance from: of a painting, always the same middle square.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn embedding(&self, painting: &RgbImage) -> Result<StyleEmbedding, StyleError> {
        let encoder = match self.encoder.get() {
            Some(encoder) => encoder,
            None => {
                let made = Encoder {
                    vgg: self.file.config.style.perceptual.load()?,
                    vae: self.file.encoder()?,
                };
                self.encoder.get_or_init(|| made)
            }
        };
        let pictures = &self.file.config.style.pictures;
        let statistics = painting_statistics(&encoder.vgg, painting, pictures)?;
        Ok(StyleEmbedding {
            code: encoder.vae.encode(&statistics),
            colors: ColorStatistics::of_picture(painting),
            exemplar: exemplar(painting).into(),
        })
    }

    /// [`Self::embedding`] of several paintings, each with its weight in a mix.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn embeddings<'a>(
        &self,
        paintings: impl IntoIterator<Item = (&'a RgbImage, f32)>,
    ) -> Result<Vec<(StyleEmbedding, f32)>, StyleError> {
        let paintings = paintings.into_iter();
        let embedded = paintings.map(|(painting, weight)| Ok((self.embedding(painting)?, weight)));
        embedded.collect()
    }

    /// The appearance that a painting gives, or `None` if
    /// nothing predicts one. The hypernetwork runs once, here.
    pub fn appearance(&self, embedding: &StyleEmbedding) -> Option<StyledAppearance> {
        let appearance = self.predicted(embedding)?;
        Some(StyledAppearance::new(appearance))
    }

    /// What [`Self::appearance`] shades with.
    pub fn predicted(&self, embedding: &StyleEmbedding) -> Option<Appearance> {
        let config = &self.file.config;
        let palette = self.photo_colors().palette_of(&embedding.colors);
        let style = self.file.style.as_ref()?;
        let inputs = PaintingInputs {
            code: &embedding.code,
            exemplar: &embedding.exemplar,
            palette,
        };
        let levels = style.appearances(config, &inputs, &self.renderer.device());
        levels.into_iter().next_back()
    }

    /// An appearance whose colours over the training views are moved towards the mean and covariance
    /// of others, instead of what was applied to them before.
    pub(crate) fn colored(
        &self,
        styled: StyledAppearance,
        colors: &ColorStatistics,
        strength: f32,
    ) -> StyledAppearance {
        let appearance = styled.appearance;
        let sample = self.sample.get_or_init(|| self.sample(&appearance.config));
        let transfer = (!sample.is_empty()).then(|| {
            let found = color_statistics(&appearance, sample);
            found.transfer_to(colors).scaled(strength)
        });
        StyledAppearance {
            appearance,
            transfer,
        }
    }

    /// The scene's own colours over the training views.
    pub fn photo_colors(&self) -> ColorStatistics {
        *self.photo_colors.get_or_init(|| {
            let photo = self.file.photo_app();
            color_statistics(photo, &self.sample(&photo.config))
        })
    }

    /// A grid of rays through the training views, in parts; none if there are no views.
    fn sample(&self, config: &AppearanceConfig) -> Vec<GBuffer> {
        let photos = &self.file.scene.photos;
        let cameras: Vec<_> = photos.iter().filter(|p| p.split == Split::Train).collect();
        let mut rays = RayBatch::default();
        let step = cameras.len().div_ceil(SAMPLED_VIEWS).max(1);
        for photo in cameras.into_iter().step_by(step) {
            let small = photo.camera.resized(SAMPLED_SIDE, SAMPLED_SIDE);
            let all = CameraRays::new(&small, None).all();
            rays.extend(all);
        }
        if rays.is_empty() {
            return Vec::new();
        }
        let options = GBufferOptions {
            config,
            photo: None,
            seed: Some(0),
            least_weight: 0.0,
            rays_at_once: Some(rays.len()),
        };
        let mut buffers = self.renderer.gbuffer(&rays, &options);
        buffers.levels.pop().unwrap_or_default()
    }

    /// As photographed.
    pub fn photo_appearance(&self) -> StyledAppearance {
        StyledAppearance {
            appearance: self.file.photo_app().clone(),
            transfer: None,
        }
    }

    /// [`Self::render`] with `side × side` rays a pixel, whose colours are averaged: paint that is
    /// finer than a pixel flickers otherwise. Costs `side²` times as much.
    pub fn render_smooth(
        &self,
        camera: &Camera,
        appearances: &[&StyledAppearance],
        side: u32,
    ) -> RenderedView {
        let side = side.max(1);
        let k = &camera.intrinsics;
        let large = camera.resized(k.width * side, k.height * side);
        self.render(&large, appearances).reduced(side as usize)
    }

    /// Renders a view with every appearance; geometry is computed once.
    pub fn render(&self, camera: &Camera, appearances: &[&StyledAppearance]) -> RenderedView {
        let rays = CameraRays::new(camera, None);
        let (width, height) = rays.size();
        let weights: Vec<&Appearance> = appearances.iter().map(|a| &a.appearance).collect();
        let rendered = self.renderer.render(&rays.all(), &weights);
        let colours = appearances.iter().zip(rendered.colours);
        let pixels = colours.map(|(appearance, colours)| appearance.transferred(colours));
        RenderedView {
            width,
            height,
            pixels: pixels.collect(),
            depth: rendered.depth,
        }
    }
}

/// Colours that an appearance has over rays.
fn color_statistics(appearance: &Appearance, rays: &[GBuffer]) -> ColorStatistics {
    let colours = rays.iter().map(|part| host(part.shade(appearance)));
    let colours = colours.collect::<Vec<_>>().concat();
    let (pixels, _) = colours.as_chunks::<{ CompositeLayout::outputs(3) }>();
    ColorStatistics::of(pixels.iter().map(|pixel| &pixel[..3]))
}
