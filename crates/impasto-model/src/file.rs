//! `model.safetensors`: all weights, with everything else as JSON in its metadata.

use crate::config::TrainConfig;
use crate::error::ModelError;
use crate::hypernetworks::{CodeNormalisation, StyleModel};
use crate::painter::{CODE_MEAN, CODE_SCALE};
use crate::record::TrainingRecord;
use crate::tensors::{Entry, TensorReader, serialize};
use burn::tensor::Device;
use impasto_field::{Appearance, DistilledFeatures, Field, Ground, OccupancyGrids, RadianceField};
use impasto_scene::file::{LARGEST_FILE, plainly, read_whole, write_atomic};
use impasto_scene::{Camera, Normalisation, Split};
use impasto_style::{StyleCode, StyleError, StyleVae};
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

/// Name of the file that a run in training keeps beside the model.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";
/// File name inside a model folder.
pub const MODEL_FILE: &str = "model.safetensors";
/// Key of the JSON in the file's metadata.
const KEY: &str = "impasto";
/// Raised when a file of an earlier version can no longer be read.
const VERSION: u32 = 9;

/// One photo that a model was made from; the pixels are not kept.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ModelPhoto {
    /// Name within the capture.
    pub name: String,
    /// Train or test.
    pub split: Split,
    /// Camera in scene space.
    #[serde(flatten)]
    pub camera: Camera,
}

/// What a model remembers of its capture.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ModelScene {
    /// Name of the capture.
    pub name: String,
    /// Whether the photos were made by a program.
    pub synthetic: bool,
    /// The way back to the capture's coordinates.
    pub normalisation: Normalisation,
    /// All photos, sorted by name.
    pub photos: Vec<ModelPhoto>,
}

impl ModelScene {
    /// Cameras of a split's photos, in scene space.
    pub fn cameras(&self, split: Split) -> Vec<Camera> {
        let photos = self.photos.iter().filter(|photo| photo.split == split);
        photos.map(|photo| photo.camera).collect()
    }
}

/// Quality measured at the end of training.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Mean PSNR of held-out views, dB.
    pub psnr: f64,
    /// Mean SSIM of held-out views.
    pub ssim: f64,
    /// Held-out views.
    pub views: usize,
    /// Mean PSNR of held-out views after the affine change of colours that fits each best, dB: what
    /// exposure and white balance of a photo that nobody learned from say nothing about.
    #[serde(default)]
    pub fitted_psnr: f64,
    /// Mean PSNR of held-out views after their poses were refined on them as those of training photos
    /// were, where any was, dB: poses that are a little off are off for both.
    #[serde(default)]
    pub aligned_psnr: Option<f64>,
    /// How restless renders are, where there are viewpoints between photos.
    #[serde(default)]
    pub grain: Option<Grain>,
}

impl Display for Quality {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            psnr,
            ssim,
            views,
            fitted_psnr,
            aligned_psnr,
            grain,
        } = self;
        write!(
            f,
            "PSNR {psnr:.2} dB ({fitted_psnr:.2} after an affine fit of colours) and SSIM {ssim:.3} on \
             {views} held-out views"
        )?;
        if let Some(aligned) = aligned_psnr {
            write!(
                f,
                "\nPSNR {aligned:.2} dB once their poses were refined, as those of training photos were"
            )?;
        }
        let Some(grain) = grain else { return Ok(()) };
        write!(
            f,
            "\nbetween photos {:.2} × their grain, {:.2} × in depth; single wrong pixels {:.2} × theirs",
            grain.colour, grain.depth, grain.wrong_pixels
        )
    }
}

/// How restless renders are beside the photos they were learned from; 1 is as restless.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Grain {
    /// Energy of second differences of renders between photos, over that of training photos.
    pub colour: f64,
    /// Energy of second differences of the depth of renders between photos, contracted to
    /// `d / (1 + d)`, over that at the photos nearby.
    pub depth: f64,
    /// Pixels of renders between photos and at held-out ones that differ by more than 0.2 from the
    /// median of their neighbourhood, over those of the training photos.
    pub wrong_pixels: f64,
}

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    config: TrainConfig,
    scene: ModelScene,
    quality: Quality,
    seed: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    finished: Option<TrainingRecord>,
}

/// The contents of a model file.
#[derive(Debug, Clone)]
pub struct ModelFile {
    /// What the run used.
    pub config: TrainConfig,
    /// Its capture.
    pub scene: ModelScene,
    /// Its measured quality.
    pub quality: Quality,
    /// Its seed.
    pub seed: u64,
    /// The field, with the colours that photos show. A cascade's first field keeps no colours.
    pub radiance: RadianceField,
    /// Density grids, where samples go by those.
    pub grids: Option<OccupancyGrids>,
    /// What is around places, where appearances are painted.
    pub features: Option<DistilledFeatures>,
    /// Hypernetworks, once the style stage has run.
    pub style: Option<StyleModel>,
    /// The encoder that its style codes come from, if it is not the shipped one.
    pub encoder: Option<StyleVae>,
    /// The run that it comes from, unless that is not over or did more than train.
    pub finished: Option<TrainingRecord>,
}

/// Tensor that holds an encoder's own safetensors file, byte by byte.
const ENCODER: &str = "style_vae";
/// A tensor that is there where features were distilled.
const DISTILLED: &str = "distilled.encoding";
/// Names of both density grids.
const GRIDS: [&str; 2] = ["inner.grid", "outer.grid"];

impl ModelFile {
    /// The encoder that its style codes come from.
    ///
    /// # Errors
    /// If the shipped asset is damaged, or the encoder is for another perceptual network.
    pub fn encoder(&self) -> Result<StyleVae, StyleError> {
        self.config.encoder(self.encoder.clone())
    }

    /// The appearance of the photos.
    pub fn photo_app(&self) -> &Appearance {
        &self.radiance.app
    }

    /// What is painted on.
    pub fn ground(&self) -> Ground {
        Ground {
            photo: self.photo_app().clone(),
            features: self.features.clone(),
        }
    }

    fn entries(&self) -> Result<Vec<Entry>, StyleError> {
        let grids = self
            .grids
            .iter()
            .flat_map(|grids| [grids.inner(), grids.outer()]);
        let mut entries: Vec<Entry> = GRIDS
            .into_iter()
            .zip(grids)
            .map(|(name, grid)| Entry::levels(name, grid))
            .collect();
        entries.extend(Entry::parameters(&self.radiance));
        if let Some(features) = &self.features {
            entries.extend(Entry::parameters(features));
        }
        if let Some(style) = &self.style {
            entries.extend(Entry::parameters(style));
            entries.push(Entry::floats(CODE_MEAN, &style.codes.mean));
            entries.push(Entry::floats(CODE_SCALE, &[style.codes.scale]));
        }
        if let Some(encoder) = &self.encoder {
            entries.push(Entry::bytes(ENCODER, encoder.to_bytes()?));
        }
        Ok(entries)
    }

    /// Writes `dir/model.safetensors` under a temporary name, then renames it.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn save(&self, dir: &Path) -> Result<PathBuf, ModelError> {
        let path = dir.join(MODEL_FILE);
        let failed = |reason: String| ModelError::Write {
            path: path.clone(),
            reason,
        };
        let header = Header {
            version: VERSION,
            config: self.config.clone(),
            scene: self.scene.clone(),
            quality: self.quality,
            seed: self.seed,
            finished: self.finished.clone(),
        };
        let json = serde_json::to_string(&header).map_err(|e| failed(e.to_string()))?;
        let metadata = HashMap::from([(KEY.to_owned(), json)]);
        let bytes = serialize(&self.entries()?, metadata).map_err(|e| failed(e.to_string()))?;
        write_atomic(&path, &bytes).map_err(|e| ModelError::write(&path, &e))?;
        Ok(path)
    }

    /// Reads a model folder, or the file inside it.
    ///
    /// # Errors
    /// If there is none, or it is damaged or of another version.
    pub fn load(path: &Path, device: &Device) -> Result<Self, ModelError> {
        let path = if path.is_dir() {
            path.join(MODEL_FILE)
        } else {
            path.to_owned()
        };
        let failed = |reason: String| ModelError::Read {
            path: path.clone(),
            reason,
        };
        let bytes = read_whole(&path, LARGEST_FILE).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound if path.with_file_name(CHECKPOINT_FILE).exists() => {
                failed("its training is not finished; go on with `impasto train … --resume`".into())
            }
            std::io::ErrorKind::NotFound => {
                failed("there is no model here; `impasto train` makes one".into())
            }
            _ => failed(format!("cannot be read ({})", plainly(&e))),
        })?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| {
            failed(format!(
                "is not a whole safetensors file ({e}); copy it again or train it again"
            ))
        })?;
        let json = metadata
            .metadata()
            .as_ref()
            .and_then(|m| m.get(KEY))
            .ok_or_else(|| failed("is a safetensors file, but not a model of Impasto; give what `impasto train` wrote".into()))?;
        let header: Header = serde_json::from_str(json).map_err(|e| {
            failed(format!(
                "has a header of another version ({e}); train it again"
            ))
        })?;
        if header.version != VERSION {
            return Err(failed(format!(
                "is of version {}, this program reads {VERSION}; train it again",
                header.version
            )));
        }
        let tensors = SafeTensors::deserialize(&bytes)
            .map_err(|e| failed(format!("is damaged ({e}); copy it again or train it again")))?;
        let reader = TensorReader {
            tensors: &tensors,
            device,
        };
        read(reader, header)
            .map_err(|problem| failed(format!("{problem}; copy it again or train it again")))
    }
}

fn read(reader: TensorReader<'_>, header: Header) -> Result<ModelFile, String> {
    let config = header.config;
    config.validate().map_err(|e| e.to_string())?;
    let field = Field::new(config.field.clone());
    let like = RadianceField::zeros(&field, config.photo_appearance(), reader.device);
    let grids = match config.field.occupancy() {
        Some(_) => Some(OccupancyGrids::new(
            reader.grid(GRIDS[0])?,
            reader.grid(GRIDS[1])?,
        )),
        None => None,
    };
    let style = if reader.has(CODE_MEAN) {
        let like = StyleModel::zeros(&field, &config, reader.device);
        Some(StyleModel {
            codes: CodeNormalisation {
                mean: reader.numbers(CODE_MEAN, StyleCode::LEN)?,
                scale: reader.numbers(CODE_SCALE, 1)?[0],
            },
            ..reader.parameters(&like)?
        })
    } else {
        None
    };
    let paint = config.style.shading.paint();
    let features = paint.filter(|_| reader.has(DISTILLED)).map(|paint| {
        let like = DistilledFeatures::zeros(paint.distilled, reader.device);
        reader.parameters(&like)
    });
    let stored = reader.tensors.tensor(ENCODER).ok();
    let encoder = stored.map(|tensor| StyleVae::from_bytes(ENCODER, tensor.data()));
    let encoder = encoder
        .transpose()
        .map_err(|e| format!("holds a damaged encoder ({e})"))?;
    Ok(ModelFile {
        radiance: reader.parameters(&like)?,
        grids,
        features: features.transpose()?,
        style,
        encoder,
        config,
        scene: header.scene,
        quality: header.quality,
        seed: header.seed,
        finished: header.finished,
    })
}
