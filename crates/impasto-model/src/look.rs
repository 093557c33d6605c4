//! Refined appearances for keeps: a file that belongs to a painting, not to a scene.

use crate::appearance::StyledAppearance;
use crate::color::ColorStatistics;
use crate::error::ModelError;
use crate::model::Model;
use crate::tensors::{Entry, TensorReader, serialize};
use burn::tensor::{Device, Tensor};
use impasto_field::{AppConfig, Appearance, AppearanceConfig, PaintSpec, Parameters, Shading};
use impasto_scene::file::{LARGEST_FILE, plainly, read_whole, write_atomic};
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// Key of the JSON in the file's metadata.
const KEY: &str = "impasto-look";
/// Raised when a file of an earlier version can no longer be read.
const VERSION: u32 = 2;

/// Weights and detail of a painted appearance, with the colours of its painting.
#[derive(Debug, Clone)]
pub struct SavedAppearance {
    appearance: Appearance,
    colors: ColorStatistics,
}

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    app: AppConfig,
    paint: PaintSpec,
    colors: ColorStatistics,
}

impl SavedAppearance {
    /// An appearance with the colours that it goes to; `None` where it is not painted: what it sees of a scene
    /// is that scene's own then.
    pub fn new(styled: &StyledAppearance, colors: ColorStatistics) -> Option<Self> {
        let appearance = styled.appearance.clone();
        let painted = appearance.paint.is_some();
        painted.then_some(Self { appearance, colors })
    }

    /// Writes a file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        let failed = |reason: String| ModelError::Write {
            path: path.to_owned(),
            reason,
        };
        let config = &self.appearance.config;
        let paint = config.shading.paint();
        let header = Header {
            version: VERSION,
            app: config.app.clone(),
            paint: *paint.ok_or_else(|| failed("it is not painted".into()))?,
            colors: self.colors,
        };
        let json = serde_json::to_string(&header).map_err(|e| failed(e.to_string()))?;
        let metadata = HashMap::from([(KEY.to_owned(), json)]);
        let entries = Entry::parameters(&self.appearance);
        let bytes = serialize(&entries, metadata).map_err(|e| failed(e.to_string()))?;
        write_atomic(path, &bytes).map_err(|e| ModelError::write(path, &e))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If it is none that [`Self::save`] wrote, or damaged.
    pub fn load(path: &Path, device: &Device) -> Result<Self, ModelError> {
        let failed = |reason: String| ModelError::Read {
            path: path.to_owned(),
            reason,
        };
        let bytes = read_whole(path, LARGEST_FILE)
            .map_err(|e| failed(format!("cannot be read ({})", plainly(&e))))?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| {
            failed(format!(
                "is not a whole safetensors file ({e}); give what --save-look wrote"
            ))
        })?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get(KEY));
        let json = json.ok_or_else(|| {
            failed("is a safetensors file, but not a look; give what --save-look wrote".into())
        })?;
        let other = |what: String| failed(format!("is of another version ({what}); refine again"));
        let header: Header = serde_json::from_str(json).map_err(|e| other(e.to_string()))?;
        if header.version != VERSION {
            return Err(other(header.version.to_string()));
        }
        let checked = header
            .app
            .check("app")
            .and_then(|()| header.paint.check("paint"));
        checked?;
        let config = AppearanceConfig {
            app: header.app,
            shading: Shading::Painted(header.paint),
            latent: None,
        };
        let tensors = SafeTensors::deserialize(&bytes)
            .map_err(|e| failed(format!("is damaged ({e}); refine again")))?;
        let reader = TensorReader {
            tensors: &tensors,
            device,
        };
        // Paint does not see the width of a scene's features.
        let like = Appearance::zeros(config, [0, 0], device);
        let appearance = reader
            .parameters(&like)
            .map_err(|problem| failed(format!("{problem}; refine again")))?;
        Ok(Self {
            appearance,
            colors: header.colors,
        })
    }
}

impl Model {
    /// A saved appearance on this scene; `None` where this model paints with other sizes.
    pub fn saved_appearance(&self, saved: &SavedAppearance) -> Option<StyledAppearance> {
        let device = self.renderer().device();
        let there = |tensor: &Tensor<1>| tensor.clone().to_device(&device);
        let mut appearance = saved.appearance.map(|_, tensor| there(tensor));
        let same = appearance.config == self.file.config.style_appearance();
        let paint = appearance.paint.as_mut().filter(|_| same)?;
        paint.palette = self.photo_colors().palette_of(&saved.colors);
        Some(StyledAppearance::new(appearance))
    }
}
