//! A trained model as a painter.

use std::sync::Arc;

use impasto_model::{
    Model, StyleEmbedding, StyleLayer, StyleLayers, StyledAppearance, ViewGBuffer,
};
use impasto_scene::Camera;

use crate::painter::{Painter, Pictures, SceneFacts, ViewGeometry};
use crate::recent::Recent;

/// Paintings whose codes are kept, and looks.
const INSPIRATIONS: usize = 512;
const LOOKS: usize = 24;

/// Shows a model. Each painting is encoded once, and each mix of them is made a look once, as long
/// as there is room to remember it.
pub struct ModelPainter {
    model: Arc<Model>,
    inspirations: Recent<String, StyleEmbedding>,
    looks: Recent<Vec<(String, u32)>, StyledAppearance>,
}

impl ModelPainter {
    /// A painter that shows a model.
    pub fn new(model: Arc<Model>) -> Self {
        Self {
            model,
            inspirations: Recent::new(INSPIRATIONS),
            looks: Recent::new(LOOKS),
        }
    }

    fn inspiration(
        &mut self,
        painting: &str,
        pictures: Pictures<'_>,
    ) -> Result<StyleEmbedding, String> {
        if let Some(known) = self.inspirations.get(painting) {
            return Ok(known);
        }
        let made = self.model.embedding(&pictures(painting)?);
        let made = made.map_err(|e| e.to_string())?;
        self.inspirations.keep(painting.to_owned(), made.clone());
        Ok(made)
    }

    /// The look of paintings mixed by weight.
    fn look(
        &mut self,
        mix: Vec<(String, u32)>,
        pictures: Pictures<'_>,
    ) -> Result<StyledAppearance, String> {
        if let Some(known) = self.looks.get(&mix) {
            return Ok(known);
        }
        let all = mix.iter().map(|(painting, weight)| {
            let inspiration = self.inspiration(painting, pictures)?;
            Ok((inspiration, f32::from_bits(*weight)))
        });
        let all = all.collect::<Result<Vec<_>, String>>()?;
        let mixed = StyleEmbedding::mix(&all).ok_or("all paintings of a coat have weight 0")?;
        let look = self.model.appearance(&mixed).ok_or_else(unstyled)?;
        self.looks.keep(mix, look.clone());
        Ok(look)
    }
}

fn unstyled() -> String {
    impasto_model::LayerError::Unstyled.to_string()
}

impl Painter for ModelPainter {
    type Geometry = ViewGBuffer;
    type Paint = Vec<StyleLayer>;

    fn facts(&self) -> SceneFacts {
        let scene = &self.model.file.scene;
        SceneFacts {
            name: scene.name.clone(),
            synthetic: scene.synthetic,
            styled: self.model.has_style(),
            normalisation: scene.normalisation,
            photos: scene.photos.clone(),
        }
    }

    fn view(&self, camera: &Camera) -> ViewGBuffer {
        self.model.gbuffer(camera)
    }

    fn paint(&self, view: &ViewGBuffer, paint: Option<&Vec<StyleLayer>>) -> Vec<f32> {
        self.model.shade(view, paint.map_or(&[], Vec::as_slice))
    }

    fn mix(
        &mut self,
        coats: &StyleLayers,
        pictures: Pictures<'_>,
    ) -> Result<Vec<StyleLayer>, String> {
        if !self.model.has_style() && !coats.coats.is_empty() {
            return Err(unstyled());
        }
        let coats = coats.coats.iter().map(|spec| {
            let weighed = spec.paintings.iter().filter(|p| p.weight > 0.0);
            let mix = weighed.map(|p| (p.painting.clone(), p.weight.to_bits()));
            let look = self.look(mix.collect(), pictures)?;
            self.model
                .layer_of(look, &spec.settings())
                .map_err(|e| e.to_string())
        });
        coats.collect()
    }
}

impl ViewGeometry for ViewGBuffer {
    fn depth(&self) -> &[f32] {
        &self.depth
    }

    fn bytes(&self) -> usize {
        Self::bytes(self)
    }
}
