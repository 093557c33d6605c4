//! What makes frames parts of one job, so that several processes can make them, at once or one after
//! the other.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use image::RgbImage;
use impasto::weights::sha256;
use impasto::{Device, Model, StyleLayerSpec};
use impasto_model::MODEL_FILE;
use serde_json::{Value, json};

use super::settings::RenderSettings;
use super::styles::{Mixture, PaintMode, Styles};
use crate::cli::CliError;
use crate::output::{FrameLayout, Viewpoint, cameras};

/// A model, with what distinguishes it from others.
pub struct KnownModel {
    /// The model.
    pub model: Model,
    digest: String,
    device: &'static str,
}

impl KnownModel {
    /// Reads a model folder or file.
    pub fn load(path: &Path, device: &Device) -> Result<Self, CliError> {
        let file = if path.is_dir() {
            path.join(MODEL_FILE)
        } else {
            path.to_owned()
        };
        let digest = || File::open(&file).and_then(sha256);
        let before = digest().ok();
        let kind = if impasto::is_cpu(device) {
            "cpu"
        } else {
            "gpu"
        };
        let model = Model::load_on(path, device)?;
        let after = digest().map_err(CliError::read(&file))?;
        if before.as_ref() != Some(&after) {
            return Err(CliError::Refused(format!(
                "{} was replaced while it was read; run this again when its training is done",
                file.display()
            )));
        }
        Ok(Self {
            model,
            digest: after,
            device: kind,
        })
    }

    /// The text of `cameras.json`, and what distinguishes a job that makes it from others. `styles`
    /// are [`distinguished`] already.
    pub fn job(
        &self,
        styles: &Value,
        views: &[Viewpoint],
        settings: &RenderSettings,
        layout: &FrameLayout,
        depth: bool,
    ) -> (String, Value) {
        let cameras = cameras(views, layout, depth, self.model.file.scene.synthetic);
        let job = json!({
            "program": concat!("impasto ", env!("CARGO_PKG_VERSION")),
            "device": self.device,
            "model": self.digest,
            "styles": styles,
            "strength": settings.strength,
            "stroke_size": settings.stroke_size,
            "stroke_strength": settings.stroke_strength,
            "supersampling": settings.supersampling,
            "keep": settings.keep,
            "mask": settings.mask,
            "side_by_side": matches!(layout, FrameLayout::SideBySide(_)),
            "depth": depth,
            "frames": views.len(),
            "cameras": hash(cameras.as_bytes()),
        });
        (cameras, job)
    }
}

/// What distinguishes styles from others: as of mixtures; how coats go on each other, too.
pub fn distinguished(styles: &Styles) -> Value {
    let coats = match &styles.paint {
        PaintMode::Mixtures(mixtures) => return distinguished_mixtures(mixtures),
        PaintMode::Layers(coats) => coats,
        PaintMode::Saved(look) => return json!({"look": look.digest}),
    };
    let entry = |(spec, images): &(StyleLayerSpec, Vec<RgbImage>)| {
        let weights: Vec<f32> = spec.paintings.iter().map(|p| p.weight).collect();
        json!({
            "paintings": hashed(images.iter().map(|image| (image, 1.0))),
            "weights": weights,
            "strength": spec.strength,
            "stroke_size": spec.stroke_size,
            "stroke_strength": spec.stroke_strength,
            "keep": spec.keep,
            "mask": spec.mask,
        })
    };
    coats.iter().map(entry).collect()
}

/// What distinguishes mixtures from others: their names, and the pixels of their paintings with their
/// weights.
pub fn distinguished_mixtures(mixtures: &[Mixture]) -> Value {
    let entry =
        |mixture: &Mixture| json!({"name": mixture.name, "paintings": hashed(mixture.weighed())});
    mixtures.iter().map(entry).collect()
}

fn hashed<'a>(paintings: impl Iterator<Item = (&'a RgbImage, f32)>) -> Vec<Value> {
    let entry = |(image, weight): (&RgbImage, f32)| {
        let size = [image.width(), image.height()]
            .map(u32::to_le_bytes)
            .concat();
        json!({"pixels": hash((&size[..]).chain(&image.as_raw()[..])), "weight": weight})
    };
    paintings.map(entry).collect()
}

/// SHA-256 of bytes in memory.
fn hash(bytes: impl Read) -> Value {
    let digest: io::Result<String> = sha256(bytes);
    // Memory can always be read; nothing is equal to `null` but another `null`.
    digest.map_or(Value::Null, Value::from)
}
