//! VGG-19 as an installed file: one safetensors file with a checksum of its numbers.

use super::file::WeightsFile;
use super::vgg19::{LAYERS, LayerWeights, Scheme, VggLayer, stack};
use super::{VGG19_FILE, folder, hexadecimal};
use crate::tensors::{HalfTensor, serialise};
use crate::{Network, Perceptual, StyleError, TensorFile};
use half::f16;
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// What an installed file says of itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Vgg19Facts {
    network: String,
    version: u32,
    /// How the checkpoint that it was made from kept the network.
    pub made_from: Scheme,
    /// SHA-256 of the numbers, hexadecimal.
    pub sha256: String,
}

const NETWORK: &str = "vgg19";
const VERSION: u32 = 1;
/// Name of the metadata entry.
const FACTS: &str = "impasto";
/// More than an installed file can have, in bytes.
const LONGEST: u64 = 64 << 20;

/// The file of these layers. `checkpoint` is for messages.
pub(super) fn write(
    checkpoint: &WeightsFile,
    layers: &[LayerWeights],
    made_from: Scheme,
) -> Result<(Vec<u8>, Vgg19Facts), StyleError> {
    let mut tensors = Vec::with_capacity(2 * layers.len());
    for (layer, place) in layers.iter().zip(&LAYERS) {
        let shape = vec![place.outputs, place.inputs, 3, 3];
        for (part, numbers, shape) in [
            ("weight", &layer.weight, shape),
            ("bias", &layer.bias, vec![place.outputs]),
        ] {
            let halves: Vec<f16> = numbers.iter().map(|v| f16::from_f32(*v)).collect();
            if !halves.iter().all(|v| v.is_finite()) {
                return Err(checkpoint.fault(format!(
                    "has {part}s in layer {} that are too large for half precision",
                    place.name
                )));
            }
            tensors.push(HalfTensor {
                name: format!("{}.{part}", place.name),
                shape,
                numbers: halves,
            });
        }
    }
    let file =
        |metadata| serialise(&tensors, metadata).map_err(|e| checkpoint.fault(e.to_string()));
    let plain = file(None)?;
    let facts = Vgg19Facts {
        network: NETWORK.into(),
        version: VERSION,
        made_from,
        sha256: sha256_of_numbers(&plain),
    };
    let json = serde_json::to_string(&facts).map_err(|e| checkpoint.fault(e.to_string()))?;
    let metadata = HashMap::from([(FACTS.to_owned(), json)]);
    Ok((file(Some(metadata))?, facts))
}

/// Of all that follows a safetensors file's header.
fn sha256_of_numbers(bytes: &[u8]) -> String {
    let header = bytes.first_chunk().map_or(0, |n| u64::from_le_bytes(*n));
    let start = usize::try_from(header).map_or(usize::MAX, |n| n.saturating_add(8));
    hexadecimal(&Sha256::digest(bytes.get(start..).unwrap_or_default()))
}

/// Reads an installed file whole, and what it says of itself.
fn read_installed(path: &Path) -> Result<(Vec<u8>, Vgg19Facts), StyleError> {
    let unreadable = |source| StyleError::Read {
        path: path.to_owned(),
        source,
    };
    let fault = |reason: &str| StyleError::weights(&path.display().to_string(), reason);
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(unreadable)?;
    let taken = file.take(LONGEST).read_to_end(&mut bytes);
    taken.map_err(unreadable)?;
    let metadata = SafeTensors::read_metadata(&bytes)
        .map(|(_, metadata)| metadata.metadata().clone().unwrap_or_default());
    let again = "remove it and run `impasto weights --fetch vgg19`, or --add FILE";
    let metadata = metadata.map_err(|e| fault(&format!("is damaged ({e}); {again}")))?;
    let facts: Option<Vgg19Facts> =
        (metadata.get(FACTS)).and_then(|json| serde_json::from_str(json).ok());
    match facts {
        Some(facts) if facts.network == NETWORK && facts.version == VERSION => {
            if facts.sha256 == sha256_of_numbers(&bytes) {
                Ok((bytes, facts))
            } else {
                Err(fault(&format!("is damaged (wrong SHA-256); {again}")))
            }
        }
        _ => Err(fault(
            "is no installed VGG-19; give a checkpoint to `impasto weights --add`, which makes one",
        )),
    }
}

/// Checks an installed file and says what it was made from.
///
/// # Errors
/// If it cannot be read, is no such file, or is damaged.
pub fn inspect_vgg19(path: &Path) -> Result<Vgg19Facts, StyleError> {
    let (bytes, facts) = read_installed(path)?;
    read_layers(path, &bytes)?;
    Ok(facts)
}

fn read_layers(path: &Path, bytes: &[u8]) -> Result<Vec<LayerWeights>, StyleError> {
    let name = path.display().to_string();
    let file = TensorFile::open(&name, bytes)?;
    let layer = |place: &VggLayer| {
        let weights = 9 * place.inputs * place.outputs;
        Ok(LayerWeights {
            weight: file.floats_of(&format!("{}.weight", place.name), weights)?,
            bias: file.floats_of(&format!("{}.bias", place.name), place.outputs)?,
        })
    };
    LAYERS.iter().map(layer).collect()
}

impl Perceptual {
    /// The normalised VGG-19 in a file that [`normalise`](fn@crate::weights::normalise) made: borders are mirrored and pools keep
    /// odd ends, as style-transfer programs have it. Statistics are of relu1_1, relu2_1, relu3_1
    /// and relu4_1, content is relu4_1; images have at least 9 pixels a side.
    ///
    /// # Errors
    /// If the file cannot be read, is no such file, or is damaged.
    pub fn vgg19(path: &Path) -> Result<Self, StyleError> {
        let (bytes, _) = read_installed(path)?;
        let layers = read_layers(path, &bytes)?;
        Ok(Self::of_stack(stack(&layers, |place| place.statistics)))
    }

    /// The VGG-19 in the user's folder of weights, see [`folder`].
    ///
    /// # Errors
    /// If there is none, which says how to get it, or [`Perceptual::vgg19`] refuses it.
    pub fn vgg19_installed() -> Result<Self, StyleError> {
        let path = folder()?.join(VGG19_FILE);
        if path.exists() {
            Self::vgg19(&path)
        } else {
            Err(StyleError::NotInstalled { path })
        }
    }
}

impl Network {
    /// Reads its weights.
    ///
    /// # Errors
    /// If an asset is damaged, or VGG-19 is not installed.
    pub fn load(self) -> Result<Perceptual, StyleError> {
        match self {
            Self::Vgg16 => Perceptual::vgg16(),
            Self::Vgg19 => Perceptual::vgg19_installed(),
        }
    }
}
