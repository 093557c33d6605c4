//! Tensors by name, from a file of any form that networks are handed around in.

use super::number::{Number, Stored};
use super::source::ByteSource;
use super::torch;
use crate::StyleError;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::path::Path;

/// The format of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileFormat {
    /// PyTorch's, since 1.6.
    TorchZip,
    /// PyTorch's, before 1.6.
    TorchStream,
    /// Hugging Face's.
    Safetensors,
}

impl fmt::Display for FileFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TorchZip => "PyTorch checkpoint (zip)",
            Self::TorchStream => "PyTorch checkpoint (stream)",
            Self::Safetensors => "safetensors file",
        })
    }
}

/// An opened file of tensors. Numbers are read when asked for; nothing in the file is run, and no
/// more memory is taken than the file is long.
pub struct WeightsFile {
    name: String,
    source: ByteSource,
    format: FileFormat,
    tensors: BTreeMap<String, Stored>,
}

/// Most bytes of a safetensors header.
const LONGEST_HEADER: u64 = 16 << 20;

impl WeightsFile {
    /// Opens a PyTorch checkpoint (`.pth`, either form) or a safetensors file; the contents
    /// decide, not the name.
    ///
    /// # Errors
    /// If the file cannot be read, is of another form, is damaged, or holds more than tensors.
    pub fn open(path: &Path) -> Result<Self, StyleError> {
        let file = File::open(path).map_err(|source| StyleError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::read(&path.display().to_string(), file)
    }

    /// The same from anything readable; `name` is for messages.
    ///
    /// # Errors
    /// Like [`WeightsFile::open`].
    pub fn read(
        name: &str,
        reader: impl std::io::Read + std::io::Seek + Send + 'static,
    ) -> Result<Self, StyleError> {
        let fault = |reason: String| StyleError::weights(name, reason);
        let mut source = ByteSource::new(Box::new(reader)).map_err(fault)?;
        let (format, tensors) = tensors(&mut source).map_err(fault)?;
        Ok(Self {
            name: name.to_owned(),
            source,
            format,
            tensors,
        })
    }

    /// The file's format.
    pub fn format(&self) -> FileFormat {
        self.format
    }

    /// Number of tensors.
    pub fn len(&self) -> usize {
        self.tensors.len()
    }

    /// Whether there is no tensor.
    pub fn is_empty(&self) -> bool {
        self.tensors.is_empty()
    }

    /// Names of all tensors, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// A tensor's shape, `None` where it is absent.
    pub fn shape(&self, key: &str) -> Option<&[u64]> {
        self.tensors.get(key).map(|stored| stored.shape.as_slice())
    }

    /// A tensor's numbers in row-major order.
    ///
    /// # Errors
    /// If it is absent, of another shape, cannot be read, or holds what is no finite number.
    pub fn floats(&mut self, key: &str, shape: &[u64]) -> Result<Vec<f32>, StyleError> {
        let stored = self.tensors.get(key);
        let stored = stored.ok_or_else(|| self.fault(format!("has no tensor \"{key}\"")))?;
        if stored.shape != shape {
            return Err(self.fault(format!(
                "has \"{key}\" of shape {:?}, {shape:?} was expected",
                stored.shape
            )));
        }
        // Beside a side of 0 the others may be of any size.
        let numbers = if shape.contains(&0) {
            0
        } else {
            shape.iter().product::<u64>()
        };
        let length = numbers * stored.number.size();
        let bytes = self.source.bytes(stored.start, length);
        let floats = (stored.number).decode(&bytes.map_err(|reason| self.fault(reason))?);
        if floats.iter().all(|f| f.is_finite()) {
            Ok(floats)
        } else {
            Err(self.fault(format!("has \"{key}\" with what is no finite number")))
        }
    }

    pub(crate) fn fault(&self, reason: String) -> StyleError {
        StyleError::weights(&self.name, reason)
    }
}

fn tensors(source: &mut ByteSource) -> Result<(FileFormat, BTreeMap<String, Stored>), String> {
    let head = source.bytes(0, source.length().min(265))?;
    if head.starts_with(b"PK\x03\x04") {
        Ok((FileFormat::TorchZip, torch::read_zip(source)?))
    } else if let [0x80, _, 0x8a, ..] = head[..] {
        Ok((FileFormat::TorchStream, torch::read_stream(source)?))
    } else if head.get(8) == Some(&b'{') {
        Ok((FileFormat::Safetensors, read_safetensors(source)?))
    } else if head.get(257..262) == Some(b"ustar") {
        Err("is a PyTorch checkpoint of before 2017 (tar); load and save it with PyTorch".into())
    } else {
        Err(
            "is neither a PyTorch checkpoint (.pth) nor a safetensors file; download it again"
                .into(),
        )
    }
}

#[derive(Deserialize)]
struct Listed {
    dtype: String,
    shape: Vec<u64>,
    data_offsets: [u64; 2],
}

fn read_safetensors(source: &mut ByteSource) -> Result<BTreeMap<String, Stored>, String> {
    let damaged = |what: &str| format!("is a damaged safetensors file ({what})");
    let length = source.number(0)?;
    if length > LONGEST_HEADER {
        return Err(damaged("its header is too long"));
    }
    let header = source.bytes(8, length)?;
    let mut listed: BTreeMap<String, serde_json::Value> =
        serde_json::from_slice(&header).map_err(|e| damaged(&e.to_string()))?;
    listed.remove("__metadata__");
    let mut tensors = BTreeMap::new();
    for (name, listed) in listed {
        let tensor: Listed = serde_json::from_value(listed).map_err(|e| damaged(&e.to_string()))?;
        let number = match tensor.dtype.as_str() {
            "F16" => Number::F16,
            "F32" => Number::F32,
            "F64" => Number::F64,
            // Counters of other layers, say. Asked for, it is as if it were absent.
            _ => continue,
        };
        let [from, to] = tensor.data_offsets;
        let numbers = (tensor.shape.iter()).try_fold(number.size(), |n, s| n.checked_mul(*s));
        if numbers.is_none() || numbers != to.checked_sub(from) {
            return Err(damaged(&format!(
                "the sizes of \"{name}\" contradict each other"
            )));
        }
        let start = (8 + length).checked_add(from);
        let start = start.ok_or_else(|| damaged(&name))?;
        source.within(start, to - from)?;
        let stored = Stored {
            number,
            shape: tensor.shape,
            start,
        };
        tensors.insert(name, stored);
    }
    Ok(tensors)
}
