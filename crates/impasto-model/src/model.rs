//! A trained model as its users see it: looks and rendered views.

use crate::TrainError;
use crate::coats::Surroundings;
use crate::model_file::ModelFile;
use crate::palette::{ColorStatistics, ColorTransfer};
use crate::rays::CameraRays;
use crate::styles::whole;
use burn::tensor::Device;
use image::RgbImage;
use impasto_field::render::host;
use impasto_field::{
    Appearance, AppearanceConfig, Field, FieldWeights, Grids, Paintable, RayBatch, RenderedRays,
    prepare_rays, render_rays,
};
use impasto_kernels::CompositeLayout;
use impasto_scene::{Camera, Split};
use impasto_style::{Perceptual, StyleCode, StyleError, StyleVae};
use std::path::Path;

/// A model ready to render.
pub struct Model {
    /// What was read.
    pub file: ModelFile,
    field: Field,
    device: Device,
    encoder: std::sync::OnceLock<Encoder>,
    /// Rays through the training views, on which looks are measured.
    sample: std::sync::OnceLock<Vec<Paintable>>,
    pub(crate) photo_palette: std::sync::OnceLock<ColorStatistics>,
    pub(crate) surroundings: std::sync::OnceLock<Surroundings>,
}

struct Encoder {
    vgg: Perceptual,
    vae: StyleVae,
}

/// What a look is made from.
#[derive(Debug, Clone)]
pub struct StyleEmbedding {
    /// The painting's style code.
    pub code: StyleCode,
    /// The painting's colours.
    pub palette: ColorStatistics,
}

impl StyleEmbedding {
    /// Between several paintings: the weighted mean; weights need not sum to one. `None` if their
    /// sum is not positive.
    pub fn mix(all: &[(Self, f32)]) -> Option<Self> {
        let codes: Vec<_> = all.iter().map(|(i, w)| (i.code.clone(), *w)).collect();
        let code = StyleCode::mix(&codes)?;
        let mut weighed = all.iter().filter(|(_, weight)| *weight > 0.0);
        let (first, weight) = weighed.next()?;
        let (palette, _) = weighed.fold((first.palette, *weight), |(palette, sum), (i, weight)| {
            let sum = sum + weight;
            (palette.mixed(&i.palette, weight / sum), sum)
        });
        Some(Self { code, palette })
    }
}

/// One way to colour the scene.
#[derive(Debug, Clone)]
pub struct Look {
    pub(crate) appearance: Appearance,
    /// Applied to every rendered colour.
    recolouring: Option<ColorTransfer>,
}

impl Look {
    /// Colours as `app` gives them, `rays × 3`, after what is applied to all of them.
    pub(crate) fn recoloured(&self, colours: Vec<f32>) -> Vec<f32> {
        match &self.recolouring {
            Some(recolouring) => recolouring.apply(&colours),
            None => colours,
        }
    }
}

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

/// Training views that a look is measured on, and rays along each side of one.
const SAMPLED_VIEWS: usize = 16;
const SAMPLED_SIDE: u32 = 16;

impl Model {
    /// Reads a model folder or file, to render it on the CPU.
    ///
    /// # Errors
    /// See [`ModelFile::load`].
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        Self::load_on(path, Device::flex())
    }

    /// Reads a model folder or file, to render it on a device, whatever it was trained on.
    ///
    /// # Errors
    /// See [`ModelFile::load`].
    pub fn load_on(path: &Path, device: Device) -> Result<Self, TrainError> {
        Ok(Self::from_file(ModelFile::load(path, &device)?, device))
    }

    /// A model from its contents.
    pub fn from_file(file: ModelFile, device: Device) -> Self {
        Self {
            field: Field::new(file.config.field.clone()),
            file,
            device,
            encoder: std::sync::OnceLock::new(),
            sample: std::sync::OnceLock::new(),
            photo_palette: std::sync::OnceLock::new(),
            surroundings: std::sync::OnceLock::new(),
        }
    }

    pub(crate) fn device(&self) -> &Device {
        &self.device
    }

    /// Whether it can be painted: the style stage has run.
    pub fn has_style(&self) -> bool {
        self.file.style.is_some()
    }

    /// What to make a look of a painting from: its middle square, always the same.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn inspiration(&self, painting: &RgbImage) -> Result<StyleEmbedding, StyleError> {
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
        let side = self.file.config.style.pictures.side;
        Ok(StyleEmbedding {
            code: encoder.vae.encode(&whole(&encoder.vgg, painting, side)?),
            palette: ColorStatistics::of_picture(painting),
        })
    }

    /// [`Self::inspiration`] of several paintings, each with its weight in a mix.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn inspirations<'a>(
        &self,
        paintings: impl IntoIterator<Item = (&'a RgbImage, f32)>,
    ) -> Result<Vec<(StyleEmbedding, f32)>, StyleError> {
        let paintings = paintings.into_iter();
        let inspired =
            paintings.map(|(painting, weight)| Ok((self.inspiration(painting)?, weight)));
        inspired.collect()
    }

    /// The look that a painting gives, emphasised as the configuration says, or `None` if the style
    /// stage has not run. The hypernetwork runs once, here. What its colours lack of the painting's
    /// mean and contrast over the training views is then made up for, to the share that the
    /// configuration trusts it, by one linear map of all colours, the same everywhere, so that
    /// views keep agreeing.
    pub fn look(&self, inspiration: &StyleEmbedding) -> Option<Look> {
        let appearance = self.predicted(&inspiration.code)?;
        Some(self.look_of(appearance, &inspiration.palette))
    }

    /// W^app that the hypernetworks give for an emphasised code.
    pub(crate) fn predicted(&self, code: &StyleCode) -> Option<Appearance> {
        let config = &self.file.config;
        let code = code.scaled(config.style.emphasis);
        let style = self.file.style.as_ref()?;
        let levels = style.appearances(config, &code, &self.device);
        levels.into_iter().next_back()
    }

    /// The look of an appearance, moved towards a palette.
    pub(crate) fn look_of(&self, appearance: Appearance, palette: &ColorStatistics) -> Look {
        let recolouring = match self.file.config.style.palette_trust {
            0.0 => None,
            trust => self.recolouring(&appearance, palette, trust),
        };
        Look {
            appearance,
            recolouring,
        }
    }

    /// A look with the mean and covariance of a palette over the training views.
    pub(crate) fn look_in(&self, look: Look, palette: &ColorStatistics) -> Look {
        let recolouring = self.recolouring(&look.appearance, palette, 1.0);
        Look {
            recolouring,
            ..look
        }
    }

    /// From the colours that an appearance has over the training views towards a palette.
    fn recolouring(
        &self,
        appearance: &Appearance,
        palette: &ColorStatistics,
        trust: f32,
    ) -> Option<ColorTransfer> {
        let sample = self.sample.get_or_init(|| self.sample(&appearance.config));
        if sample.is_empty() {
            return None;
        }
        let found = self.palette_of(appearance, sample);
        Some(found.recolouring(palette).softened(trust))
    }

    /// Colours that an appearance has over rays that were prepared for it.
    pub(crate) fn palette_of(&self, appearance: &Appearance, rays: &[Paintable]) -> ColorStatistics {
        let colours = rays.iter().map(|part| host(part.composite(appearance)));
        let colours = colours.collect::<Vec<_>>().concat();
        let (pixels, _) = colours.as_chunks::<{ CompositeLayout::outputs(3) }>();
        ColorStatistics::of(pixels.iter().map(|pixel| &pixel[..3]))
    }

    /// What rays are rendered with.
    pub(crate) fn parts(&self) -> (&Field, &FieldWeights, &Grids) {
        (&self.field, &self.file.weights, &self.file.grids)
    }

    pub(crate) fn rendered(&self, appearances: &[&Appearance], rays: &RayBatch) -> RenderedRays {
        let (field, weights, grids) = self.parts();
        render_rays(field, weights, grids, appearances, rays)
    }

    /// A grid of rays through the training views, in parts; none if there are no views.
    pub(crate) fn sample(&self, config: &AppearanceConfig) -> Vec<Paintable> {
        let photos = &self.file.scene.photos;
        let cameras: Vec<_> = photos.iter().filter(|p| p.split == Split::Train).collect();
        let mut rays = RayBatch::default();
        let step = cameras.len().div_ceil(SAMPLED_VIEWS).max(1);
        for photo in cameras.into_iter().step_by(step) {
            let small = photo.camera.resized(SAMPLED_SIDE, SAMPLED_SIDE);
            let all = CameraRays::new(&small, None).all();
            rays.origins.extend(all.origins);
            rays.directions.extend(all.directions);
        }
        if rays.is_empty() {
            return Vec::new();
        }
        let mut prepared = prepare_rays(self.parts(), None, (config, 0.0, rays.len()), &rays, 0);
        prepared.levels.pop().unwrap_or_default()
    }

    /// The photo's own look.
    pub fn photo_appearance(&self) -> Look {
        Look {
            appearance: self.file.photo_app.clone(),
            recolouring: None,
        }
    }

    /// [`Self::render`] with `side × side` rays a pixel, whose colours are averaged: paint that is
    /// finer than a pixel flickers otherwise. Costs `side²` times as much.
    pub fn render_smooth(&self, camera: &Camera, looks: &[&Look], side: u32) -> RenderedView {
        let side = side.max(1);
        let k = &camera.intrinsics;
        let large = camera.resized(k.width * side, k.height * side);
        self.render(&large, looks).reduced(side as usize)
    }

    /// Renders a view with every look; geometry is computed once.
    pub fn render(&self, camera: &Camera, looks: &[&Look]) -> RenderedView {
        let rays = CameraRays::new(camera, None);
        let (width, height) = rays.size();
        let appearances: Vec<&Appearance> = looks.iter().map(|look| &look.appearance).collect();
        let rendered = self.rendered(&appearances, &rays.all());
        let looked = looks.iter().zip(rendered.colours);
        let pixels = looked.map(|(look, colours)| look.recoloured(colours));
        RenderedView {
            width,
            height,
            pixels: pixels.collect(),
            depth: rendered.depth,
        }
    }
}

impl RenderedView {
    /// The view on a grid `side` times as coarse: colours are means; a depth is the lower median,
    /// so that it is one that was there and not between a thing and what is behind it.
    pub(crate) fn reduced(self, side: usize) -> Self {
        if side == 1 {
            return self;
        }
        let (width, height) = (self.width / side, self.height / side);
        // The index of every pixel's rays in turn.
        let rays = |pixel: usize| {
            let (top, left) = (pixel / width * side, pixel % width * side);
            (0..side * side).map(move |i| (top + i / side) * self.width + left + i % side)
        };
        let pixels = self.pixels.iter().map(|large| {
            let mean = |pixel: usize| {
                [0, 1, 2].map(|c| {
                    let sum: f32 = rays(pixel).map(|ray| large[3 * ray + c]).sum();
                    sum / (side * side) as f32
                })
            };
            (0..width * height).flat_map(mean).collect()
        });
        let depth = |pixel: usize| {
            let mut depths: Vec<f32> = rays(pixel).map(|ray| self.depth[ray]).collect();
            depths.sort_by(f32::total_cmp);
            depths[(depths.len() - 1) / 2]
        };
        Self {
            pixels: pixels.collect(),
            depth: (0..width * height).map(depth).collect(),
            width,
            height,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_view_has_mean_colours_and_depths_that_were_there() {
        let view = RenderedView {
            width: 4,
            height: 2,
            pixels: vec![(0..24).map(|i| i as f32).collect()],
            depth: vec![1.0, 9.0, 5.0, 6.0, 2.0, 8.0, 7.0, 5.5],
        };
        let found = view.clone().reduced(2);
        assert_eq!((found.width, found.height), (2, 1));
        // Rays 0, 1, 4 and 5: their first channels are 0, 3, 12 and 15.
        assert_eq!(found.pixels[0], [7.5, 8.5, 9.5, 13.5, 14.5, 15.5]);
        assert_eq!(found.depth, [2.0, 5.5]);
        assert_eq!(view.clone().reduced(1).pixels, view.pixels);
    }

    #[test]
    fn mixed_inspirations_lie_between_by_weight() {
        let one = |number: f32| StyleEmbedding {
            code: StyleCode(vec![number; StyleCode::LEN]),
            palette: ColorStatistics::of([number; 6].chunks_exact(3)),
        };
        let weighed = [(one(0.0), 1.0), (one(0.4), 2.0), (one(0.8), 1.0)];
        let mix = StyleEmbedding::mix(&weighed).map(|mix| (mix.code.0[3], mix.palette));
        let wanted = ColorStatistics::of([0.4f32; 6].chunks_exact(3));
        assert!(mix.is_some_and(|(code, palette)| {
            let pixels = palette.recolouring(&wanted).apply(&[0.4, 0.4, 0.4]);
            (code - 0.4).abs() < 1e-6 && pixels.iter().all(|p| (p - 0.4).abs() < 1e-5)
        }));
        assert!(StyleEmbedding::mix(&[(one(0.1), 0.0)]).is_none());
        assert!(StyleEmbedding::mix(&[]).is_none());
    }
}
