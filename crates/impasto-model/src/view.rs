//! Painted views.

use super::{StyleLayer, LayerError, StyleLayerSpec, Coated, ColorPreservation, Mask, Shape, Surroundings};
use crate::model::{StyleEmbedding, Look, Model, RenderedView};
use crate::palette::ColorStatistics;
use crate::rays::CameraRays;
use glam::Vec3;
use impasto_field::{Appearance, RayBatch, SeenRays, see_rays};
use impasto_scene::{Camera, Split};

/// Training views whose surfaces regions grow over, and rays along the longer side of each.
const VIEWS: usize = 16;
const VIEW_SIDE: f64 = 144.0;

/// A view's geometry, ready for any paint; one ray a pixel.
#[derive(Debug, Clone)]
pub struct ViewGBuffer {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    rays: RayBatch,
    seen: SeenRays,
}

impl ViewGBuffer {
    /// `height × width`, depth along the camera's axis in scene units, infinite where nothing is.
    pub fn depth(&self) -> &[f32] {
        &self.seen.depth
    }

    /// `height × width × 3` in `[0, 1]`, as photographed.
    pub fn photo(&self) -> &[f32] {
        &self.seen.photo
    }

    /// The point in scene space that a pixel shows; `None` where nothing is.
    pub fn point(&self, x: usize, y: usize) -> Option<[f32; 3]> {
        let ray = y * self.width + x;
        let depth = *self.seen.depth.get(ray)?;
        let (origin, direction) = (self.rays.origins[ray], self.rays.directions[ray]);
        let point = Vec3::from(origin) + Vec3::from(direction) * depth;
        (depth.is_finite() && point.is_finite()).then(|| point.to_array())
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        self.seen.bytes() + 6 * self.rays.len() * size_of::<f32>()
    }
}

impl Model {
    /// One coat: the look of paintings mixed by weight, on as the specification says. `paintings`
    /// are what the specification's resolve to, in any order.
    ///
    /// # Errors
    /// [`LayerError::Unstyled`], and [`LayerError::NoSurface`] where a region cannot grow.
    pub fn coat(
        &self,
        spec: &StyleLayerSpec,
        paintings: &[(StyleEmbedding, f32)],
    ) -> Result<StyleLayer, LayerError> {
        let mix = StyleEmbedding::mix(paintings).ok_or_else(|| LayerError::Value {
            number: 1,
            problem: "all its paintings have weight 0; give at least one more".into(),
        })?;
        let look = self.look(&mix).ok_or(LayerError::Unstyled)?;
        self.layer_of(look, spec.strength, spec.keep, spec.mask.as_ref())
    }

    /// A coat of a look that is known already.
    ///
    /// # Errors
    /// [`LayerError::NoSurface`] where a region cannot grow.
    pub fn layer_of(
        &self,
        look: Look,
        strength: f32,
        keep: ColorPreservation,
        mask: Option<&super::MaskSpec>,
    ) -> Result<StyleLayer, LayerError> {
        let look = match keep {
            ColorPreservation::Palette => self.look_in(look, &self.photo_palette()),
            ColorPreservation::None | ColorPreservation::Luminance => look,
        };
        let mask = mask.map(|spec| {
            let region = match spec.shape {
                Shape::Surface { point, tolerance } => {
                    let surroundings = self.surroundings.get_or_init(|| self.look_around());
                    let region = surroundings.region(point.into(), tolerance);
                    Some(region.ok_or(LayerError::NoSurface(point))?)
                }
                _ => None,
            };
            Ok(Mask {
                shape: spec.shape.clone(),
                region,
                inverted: spec.inverted,
            })
        });
        Ok(StyleLayer {
            look,
            strength,
            keep,
            mask: mask.transpose()?,
        })
    }

    /// The scene's own colours over the training views.
    fn photo_palette(&self) -> ColorStatistics {
        *self.photo_palette.get_or_init(|| {
            let photo = &self.file.photo_app;
            self.palette_of(photo, &self.sample(&photo.config))
        })
    }

    /// Surfaces as the training views see them.
    fn look_around(&self) -> Surroundings {
        let cameras = self.file.scene.cameras(Split::Train);
        let step = cameras.len().div_ceil(VIEWS).max(1);
        let views = cameras.into_iter().step_by(step).map(|camera| {
            let k = &camera.intrinsics;
            let (w, h) = (f64::from(k.width), f64::from(k.height));
            let scale = (VIEW_SIDE / w.max(h)).min(1.0);
            let side = |length: f64| (length * scale).round().max(1.0) as u32;
            self.gbuffer(&camera.resized(side(w), side(h)))
        });
        Surroundings::new(views.flat_map(|view| {
            let pixels = 0..view.width * view.height;
            pixels
                .filter_map(|i| {
                    let point = view.point(i % view.width, i / view.width)?;
                    Some((point.into(), Vec3::from_slice(&view.photo()[3 * i..])))
                })
                .collect::<Vec<_>>()
        }))
    }

    /// Finds the geometry of a view, which takes nearly all of a rendering's time.
    pub fn gbuffer(&self, camera: &Camera) -> ViewGBuffer {
        let rays = CameraRays::new(camera, None);
        let (width, height) = rays.size();
        let rays = rays.all();
        let (photo, config) = (&self.file.photo_app, self.file.config.style_appearance());
        let seen = see_rays(self.parts(), photo, &config, &rays);
        ViewGBuffer {
            width,
            height,
            rays,
            seen,
        }
    }

    /// Paints a prepared view: `height × width × 3` in `[0, 1]`. Without coats it is as
    /// photographed.
    pub fn shade(&self, view: &ViewGBuffer, coats: &[StyleLayer]) -> Vec<f32> {
        let photo = view.photo();
        let coloured = Coated {
            rays: &view.rays,
            depth: view.depth(),
            photo,
        };
        let mut pixels = photo.to_vec();
        for coat in coats {
            let painted = view.seen.colours(self.parts(), &coat.look.appearance);
            coloured.put_on(&mut pixels, coat, &coat.look.recoloured(painted));
        }
        pixels
    }

    /// Renders a view with every list of coats, with `side × side` rays a pixel; see
    /// [`Self::render_smooth`]. Geometry is computed once.
    pub fn render_layers(&self, camera: &Camera, lists: &[&[StyleLayer]], side: u32) -> RenderedView {
        let side = side.max(1);
        let k = &camera.intrinsics;
        let large = camera.resized(k.width * side, k.height * side);
        let rays = CameraRays::new(&large, None);
        let (width, height) = rays.size();
        let rays = rays.all();
        let coats = || lists.iter().copied().flatten();
        let looks: Vec<&Appearance> = coats().map(|coat| &coat.look.appearance).collect();
        let bare = |list: &&[StyleLayer]| list.first().is_none_or(StyleLayer::is_thin);
        let photo = lists.iter().any(bare) || coats().any(StyleLayer::is_thin);
        let photo = photo.then_some(&self.file.photo_app);
        let all: Vec<&Appearance> = looks.into_iter().chain(photo).collect();
        let mut rendered = self.rendered(&all, &rays);
        let photo = photo.and_then(|_| rendered.colours.pop());
        let photo = photo.unwrap_or_default();
        let coloured = Coated {
            rays: &rays,
            depth: &rendered.depth,
            photo: &photo,
        };
        let mut colours = rendered.colours.into_iter();
        let pixels = lists.iter().map(|list| {
            let mut pixels = photo.clone();
            for (coat, painted) in list.iter().zip(colours.by_ref()) {
                let painted = coat.look.recoloured(painted);
                match coat.is_thin() {
                    true => coloured.put_on(&mut pixels, coat, &painted),
                    false => pixels = painted,
                }
            }
            pixels
        });
        let view = RenderedView {
            width,
            height,
            pixels: pixels.collect(),
            depth: rendered.depth,
        };
        view.reduced(side as usize)
    }
}
