//! `model.safetensors`: all weights, with everything else as JSON in its metadata.

use crate::TrainError;
use crate::budget::Budget;
use crate::checkpoint::CHECKPOINT_FILE;
use crate::config::TrainConfig;
use crate::durable::write_whole;
use crate::identity::Identity;
use crate::style_stage::{StyleModel, hypernetworks};
use burn::tensor::{Device, Tensor};
use impasto_field::branch::vector;
use impasto_field::render::host;
use impasto_field::{Appearance, BranchWeights, Canvas, Field, FieldWeights, Grids};
use impasto_kernels::DensityGrid;
use impasto_scene::file::{LARGEST_FILE, plainly, read_whole};
use impasto_scene::{Camera, Normalisation, Split};
use impasto_style::{HypernetworkWeights, StyleError, StyleVae};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// File name inside a model folder.
pub const MODEL_FILE: &str = "model.safetensors";
/// Key of the JSON in the file's metadata.
const KEY: &str = "impasto";
/// Raised when a file of an earlier version can no longer be read.
const VERSION: u32 = 4;

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
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Quality {
    /// Mean PSNR of held-out views, dB.
    pub psnr: f64,
    /// Mean SSIM of held-out views.
    pub ssim: f64,
    /// Held-out views.
    pub views: usize,
}

/// The run that made a model, once it is over.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// What decided its result.
    pub(crate) identity: Identity,
    /// Length that was asked for.
    pub budget: Budget,
    /// Steps of the geometry stage.
    pub geometry_steps: u64,
    /// Steps of the style stage.
    pub style_steps: u64,
    /// Files in the style folder, less those that are known to be no pictures.
    pub paintings: usize,
    /// Files in the style folder that the style stage found to be no pictures.
    pub unreadable_paintings: usize,
}

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    config: TrainConfig,
    scene: ModelScene,
    quality: Quality,
    seed: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    finished: Option<Finished>,
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
    /// Field weights.
    pub weights: FieldWeights,
    /// Density grids.
    pub grids: Grids,
    /// The photo's own look.
    pub photo_app: Appearance,
    /// Hypernetworks, once the style stage has run.
    pub style: Option<StyleModel>,
    /// The encoder that its style codes come from, if it is not the shipped one.
    pub encoder: Option<StyleVae>,
    /// The run that it comes from, unless that is not over or was not [`crate::train`].
    pub finished: Option<Finished>,
}

/// A tensor to be stored.
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) dtype: Dtype,
    pub(crate) length: usize,
    pub(crate) bytes: Vec<u8>,
}

/// A safetensors file.
pub(crate) fn serialize(
    entries: &[Entry],
    metadata: HashMap<String, String>,
) -> Result<Vec<u8>, SafeTensorError> {
    let views = entries.iter().map(|e| {
        let view = TensorView::new(e.dtype, vec![e.length], &e.bytes)?;
        Ok((e.name.as_str(), view))
    });
    let views = views.collect::<Result<Vec<_>, SafeTensorError>>()?;
    safetensors::serialize(views, Some(metadata))
}

pub(crate) fn floats(name: impl Into<String>, tensor: &Tensor<1>) -> Entry {
    let numbers = host(tensor.clone());
    Entry {
        name: name.into(),
        dtype: Dtype::F32,
        length: numbers.len(),
        bytes: numbers.iter().flat_map(|v| v.to_le_bytes()).collect(),
    }
}

pub(crate) fn levels(name: &str, grid: &DensityGrid) -> Entry {
    Entry {
        name: name.into(),
        dtype: Dtype::U8,
        length: grid.cells(),
        bytes: grid.levels().to_vec(),
    }
}

/// Tensor that holds an encoder's own safetensors file, byte by byte.
const ENCODER: &str = "style_vae";
const VOLUMES: [&str; 2] = ["inner", "outer"];
/// What names of a cascade's first field begin with.
const COARSE: &str = "coarse.";

/// Both volumes of one field.
fn level_entries(level: &str, weights: &FieldWeights) -> Vec<Entry> {
    let latent = weights.inner.latent.iter();
    let mut entries: Vec<Entry> = latent
        .map(|z| floats(format!("{level}latent"), z))
        .collect();
    for (volume, w) in VOLUMES.iter().zip([&weights.inner, &weights.outer]) {
        entries.push(floats(format!("{level}{volume}.encoding"), &w.encoding));
        entries.push(floats(format!("{level}{volume}.base"), &w.base));
        entries.push(floats(format!("{level}{volume}.geo"), &w.geo));
    }
    entries
}

impl ModelFile {
    /// The encoder that its style codes come from.
    ///
    /// # Errors
    /// If the shipped asset is damaged, or the encoder is for another perceptual network.
    pub fn encoder(&self) -> Result<StyleVae, StyleError> {
        self.config.encoder(self.encoder.clone())
    }

    fn entries(&self) -> Result<Vec<Entry>, StyleError> {
        let mut entries = vec![
            levels("inner.grid", self.grids.inner()),
            levels("outer.grid", self.grids.outer()),
        ];
        entries.extend(level_entries("", &self.weights));
        if let Some(coarse) = &self.weights.coarse {
            entries.extend(level_entries(COARSE, coarse));
        }
        entries.push(floats("inner.photo_app", &self.photo_app.inner));
        entries.push(floats("outer.photo_app", &self.photo_app.outer));
        if let Some(style) = &self.style {
            // The field's level is the last, a cascade's first field comes before it.
            for (level, volumes) in ["", COARSE].iter().zip(style.levels.iter().rev()) {
                for (volume, weights) in VOLUMES.iter().zip(volumes) {
                    let name = |i: usize| format!("{level}{volume}.hypernetwork.{i}");
                    let layers = weights.0.iter().enumerate();
                    entries.extend(layers.map(|(i, w)| floats(name(i), w)));
                }
            }
            if let Some(canvas) = &style.canvas {
                entries.push(floats("inner.canvas", &canvas.inner));
                entries.push(floats("outer.canvas", &canvas.outer));
            }
        }
        if let Some(encoder) = &self.encoder {
            let bytes = encoder.to_bytes()?;
            entries.push(Entry {
                name: ENCODER.into(),
                dtype: Dtype::U8,
                length: bytes.len(),
                bytes,
            });
        }
        Ok(entries)
    }

    /// Writes `dir/model.safetensors` under a temporary name, then renames it.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn save(&self, dir: &Path) -> Result<PathBuf, TrainError> {
        let path = dir.join(MODEL_FILE);
        let failed = |reason: String| TrainError::Write {
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
        write_whole(&path, &bytes)?;
        Ok(path)
    }

    /// Reads a model folder, or the file inside it.
    ///
    /// # Errors
    /// If there is none, or it is damaged or of another version.
    pub fn load(path: &Path, device: &Device) -> Result<Self, TrainError> {
        let path = if path.is_dir() {
            path.join(MODEL_FILE)
        } else {
            path.to_owned()
        };
        let failed = |reason: String| TrainError::Model {
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
        let reader = Reader {
            tensors: &tensors,
            device,
        };
        reader
            .model(header)
            .map_err(|problem| failed(format!("{problem}; copy it again or train it again")))
    }
}

/// Tensors of a file, checked as they are read.
pub(crate) struct Reader<'a> {
    pub(crate) tensors: &'a SafeTensors<'a>,
    pub(crate) device: &'a Device,
}

impl Reader<'_> {
    pub(crate) fn floats(&self, name: &str, length: usize) -> Result<Tensor<1>, String> {
        Ok(vector(self.numbers(name, length)?, self.device))
    }

    pub(crate) fn numbers(&self, name: &str, length: usize) -> Result<Vec<f32>, String> {
        let tensor = self
            .tensors
            .tensor(name)
            .map_err(|_| format!("lacks the tensor \"{name}\""))?;
        let (numbers, rest) = tensor.data().as_chunks::<4>();
        if tensor.dtype() != Dtype::F32 || numbers.len() != length || !rest.is_empty() {
            return Err(format!(
                "holds \"{name}\" with {} numbers, {length} were expected",
                numbers.len()
            ));
        }
        Ok(numbers.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    pub(crate) fn grid(&self, name: &str) -> Result<DensityGrid, String> {
        let tensor = self
            .tensors
            .tensor(name)
            .map_err(|_| format!("lacks the tensor \"{name}\""))?;
        DensityGrid::from_levels(tensor.data().to_vec())
            .ok_or_else(|| format!("holds \"{name}\", which is no cube"))
    }

    fn level(&self, level: &str, field: &Field) -> Result<FieldWeights, String> {
        let latent = field.inner.latent();
        let latent = latent.map(|n| self.floats(&format!("{level}latent"), n));
        let latent = latent.transpose()?;
        let branch = |volume: &str, lengths: [usize; 3]| -> Result<BranchWeights, String> {
            let part = |name, length| self.floats(&format!("{level}{volume}.{name}"), length);
            Ok(BranchWeights {
                encoding: part("encoding", lengths[0])?,
                base: part("base", lengths[1])?,
                geo: part("geo", lengths[2])?,
                latent: latent.clone(),
            })
        };
        Ok(FieldWeights {
            inner: branch("inner", field.inner.lengths())?,
            outer: branch("outer", field.outer.lengths())?,
            coarse: None,
        })
    }

    fn model(&self, header: Header) -> Result<ModelFile, String> {
        let config = header.config;
        config.validate().map_err(|e| e.to_string())?;
        let field = Field::new(config.field.clone());
        let features = field.features();
        let mut weights = self.level("", &field)?;
        if config.field.cascade.is_some() {
            weights.coarse = Some(Box::new(self.level(COARSE, &field)?));
        }
        let photo_app = |i: usize| {
            self.floats(
                &format!("{}.photo_app", VOLUMES[i]),
                config.photo_app.network(features[i], 3 + i).params(),
            )
        };
        Ok(ModelFile {
            grids: Grids::new(self.grid("inner.grid")?, self.grid("outer.grid")?),
            photo_app: Appearance {
                config: config.photo_app.clone(),
                inner: photo_app(0)?,
                outer: photo_app(1)?,
                canvas: None,
                latent: config.photo_app.latent.and(weights.inner.latent.clone()),
            },
            weights,
            style: self.style(&field, &config)?,
            encoder: self.encoder()?,
            config,
            scene: header.scene,
            quality: header.quality,
            seed: header.seed,
            finished: header.finished,
        })
    }

    fn encoder(&self) -> Result<Option<StyleVae>, String> {
        let stored = self.tensors.tensor(ENCODER).ok();
        let read = stored.map(|tensor| StyleVae::from_bytes(ENCODER, tensor.data()));
        read.transpose()
            .map_err(|e| format!("holds a damaged encoder ({e})"))
    }

    fn style(&self, field: &Field, config: &TrainConfig) -> Result<Option<StyleModel>, String> {
        if self.tensors.tensor("inner.hypernetwork.0").is_err() {
            return Ok(None);
        }
        let hyper = hypernetworks(field, config);
        let weights = |level: &str, i: usize| -> Result<HypernetworkWeights, String> {
            let lengths = hyper[i].lengths().into_iter().enumerate();
            let name = |l: usize| format!("{level}{}.hypernetwork.{l}", VOLUMES[i]);
            let layers = lengths.map(|(l, length)| self.floats(&name(l), length));
            Ok(HypernetworkWeights(layers.collect::<Result<_, _>>()?))
        };
        let names = match config.field.cascade {
            Some(_) => &[COARSE, ""][..],
            None => &[""],
        };
        let levels = names
            .iter()
            .map(|level| Ok([weights(level, 0)?, weights(level, 1)?]));
        let canvas = match config
            .style_app
            .canvas
            .as_ref()
            .and_then(impasto_field::EncodingConfig::hash_grid)
        {
            Some(spec) => Some(Canvas {
                inner: self.floats("inner.canvas", spec.params())?,
                outer: self.floats("outer.canvas", spec.params())?,
            }),
            None => None,
        };
        Ok(Some(StyleModel {
            levels: levels.collect::<Result<_, String>>()?,
            hyper,
            canvas,
        }))
    }
}
