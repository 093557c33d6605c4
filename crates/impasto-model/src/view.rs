//! Painted views.

use crate::appearance::StyledAppearance;
use crate::camera_rays::CameraRays;
use crate::embedding::StyleEmbedding;
use crate::layers::{
    BlendTarget, ColorPreservation, LayerError, LayerMask, LayerSettings, MaskShape, StyleLayer,
    StyleLayerSpec, SurfaceCells,
};
use crate::model::Model;
use crate::rendered::RenderedView;
use glam::Vec3;
use impasto_field::renderer::{SHADE_LEAST, pixels};
use impasto_field::{
    Appearance, GBuffer, GBufferOptions, RayBatch, RayBuffers, StrokeSettings, host,
};
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
    /// `height × width × 3` in `[0, 1]`, as photographed.
    pub photo: Vec<f32>,
    /// `height × width`, depth along the camera's axis in scene units, infinite where nothing is.
    pub depth: Vec<f32>,
    rays: RayBatch,
    buffers: RayBuffers,
}

impl ViewGBuffer {
    /// The point in scene space that a pixel shows; `None` where nothing is.
    pub fn point(&self, x: usize, y: usize) -> Option<[f32; 3]> {
        let ray = y * self.width + x;
        let depth = *self.depth.get(ray)?;
        let (origin, direction) = (self.rays.origins[ray], self.rays.directions[ray]);
        let point = Vec3::from(origin) + Vec3::from(direction) * depth;
        (depth.is_finite() && point.is_finite()).then(|| point.to_array())
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        let buffers: usize = self.buffers.fine().iter().map(GBuffer::bytes).sum();
        // Rays, then colours and depth, here and on the device.
        let numbers = (6 + 2 * 4) * self.rays.len();
        buffers + numbers * size_of::<f32>()
    }
}

impl Model {
    /// One layer: the appearance of paintings mixed by weight, blended as the specification says.
    /// `paintings` are what the specification's resolve to, in any order.
    ///
    /// # Errors
    /// [`LayerError::Unstyled`], and [`LayerError::NoSurface`] where a region cannot grow.
    pub fn layer(
        &self,
        spec: &StyleLayerSpec,
        paintings: &[(StyleEmbedding, f32)],
    ) -> Result<StyleLayer, LayerError> {
        let mix = StyleEmbedding::mix(paintings).ok_or_else(|| LayerError::Value {
            number: 1,
            problem: "all its paintings have weight 0; give at least one more".into(),
        })?;
        let appearance = self.appearance(&mix).ok_or(LayerError::Unstyled)?;
        self.layer_of(appearance, &spec.settings())
    }

    /// A layer of an appearance that is known already.
    ///
    /// # Errors
    /// [`LayerError::NoSurface`] where a region cannot grow, [`LayerError::NoStrokes`] where strokes cannot
    /// change.
    pub fn layer_of(
        &self,
        mut appearance: StyledAppearance,
        settings: &LayerSettings,
    ) -> Result<StyleLayer, LayerError> {
        match &mut appearance.appearance.paint {
            Some(paint) => paint.strokes = settings.strokes,
            None if settings.strokes == StrokeSettings::default() => {}
            None => return Err(LayerError::NoStrokes),
        }
        let appearance = match settings.keep {
            ColorPreservation::Palette => self.colored(appearance, &self.photo_colors(), 1.0),
            ColorPreservation::None | ColorPreservation::Luminance => appearance,
        };
        let mask = settings.mask.as_ref().map(|spec| {
            let region = match spec.shape {
                MaskShape::Surface { point, tolerance } => {
                    let surfaces = self.surfaces.get_or_init(|| self.find_surfaces());
                    let region = surfaces.region(point.into(), tolerance);
                    Some(region.ok_or(LayerError::NoSurface(point))?)
                }
                _ => None,
            };
            Ok(LayerMask {
                shape: spec.shape.clone(),
                region,
                inverted: spec.inverted,
            })
        });
        Ok(StyleLayer {
            appearance,
            strength: settings.strength,
            keep: settings.keep,
            mask: mask.transpose()?,
        })
    }

    /// Surfaces as the training views see them.
    fn find_surfaces(&self) -> SurfaceCells {
        let cameras = self.file.scene.cameras(Split::Train);
        let step = cameras.len().div_ceil(VIEWS).max(1);
        let views = cameras.into_iter().step_by(step).map(|camera| {
            let k = &camera.intrinsics;
            let (w, h) = (f64::from(k.width), f64::from(k.height));
            let scale = (VIEW_SIDE / w.max(h)).min(1.0);
            let side = |length: f64| (length * scale).round().max(1.0) as u32;
            self.gbuffer(&camera.resized(side(w), side(h)))
        });
        SurfaceCells::new(views.flat_map(|view| {
            let pixels = 0..view.width * view.height;
            pixels
                .filter_map(|i| {
                    let point = view.point(i % view.width, i / view.width)?;
                    Some((point.into(), Vec3::from_slice(&view.photo[3 * i..])))
                })
                .collect::<Vec<_>>()
        }))
    }

    /// Finds the geometry of a view, which takes nearly all of a rendering's time.
    pub fn gbuffer(&self, camera: &Camera) -> ViewGBuffer {
        let rays = CameraRays::new(camera, None);
        let (width, height) = rays.size();
        let rays = rays.all();
        let options = GBufferOptions {
            config: &self.file.config.style_appearance(),
            photo: Some(self.file.photo_app()),
            seed: None,
            least_weight: SHADE_LEAST,
            rays_at_once: None,
        };
        let buffers = self.renderer().gbuffer(&rays, &options);
        ViewGBuffer {
            width,
            height,
            photo: buffers.photo.clone().map(pixels).unwrap_or_default(),
            depth: host(buffers.depth.clone()),
            rays,
            buffers,
        }
    }

    /// Paints a view: `height × width × 3` in `[0, 1]`. Without layers it is as photographed.
    pub fn shade(&self, view: &ViewGBuffer, layers: &[StyleLayer]) -> Vec<f32> {
        let target = BlendTarget {
            rays: &view.rays,
            depth: &view.depth,
            photo: &view.photo,
        };
        let mut pixels = view.photo.clone();
        for layer in layers {
            let painted = view.buffers.shade(&layer.appearance.appearance);
            target.blend(&mut pixels, layer, &layer.appearance.transferred(painted));
        }
        pixels
    }

    /// Renders a view with every list of layers, with `side × side` rays a pixel; see
    /// [`Self::render_smooth`]. Geometry is computed once.
    pub fn render_layers(
        &self,
        camera: &Camera,
        lists: &[&[StyleLayer]],
        side: u32,
    ) -> RenderedView {
        let side = side.max(1);
        let k = &camera.intrinsics;
        let large = camera.resized(k.width * side, k.height * side);
        let rays = CameraRays::new(&large, None);
        let (width, height) = rays.size();
        let rays = rays.all();
        let layers = || lists.iter().copied().flatten();
        let bare = |list: &&[StyleLayer]| list.first().is_none_or(StyleLayer::is_translucent);
        let photo = lists.iter().any(bare) || layers().any(StyleLayer::is_translucent);
        let photo = photo.then(|| self.file.photo_app());
        let painted = layers().map(|layer| &layer.appearance.appearance);
        let all: Vec<&Appearance> = painted.chain(photo).collect();
        let mut rendered = self.renderer().render(&rays, &all);
        let photo = photo.and_then(|_| rendered.colours.pop());
        let photo = photo.unwrap_or_default();
        let target = BlendTarget {
            rays: &rays,
            depth: &rendered.depth,
            photo: &photo,
        };
        let mut colours = rendered.colours.into_iter();
        let pixels = lists.iter().map(|list| {
            let mut pixels = photo.clone();
            for (layer, painted) in list.iter().zip(colours.by_ref()) {
                let painted = layer.appearance.transferred(painted);
                if layer.is_translucent() {
                    target.blend(&mut pixels, layer, &painted);
                } else {
                    pixels = painted;
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
