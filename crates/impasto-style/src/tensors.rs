//! Reading and writing named tensors as safetensors.

use crate::StyleError;
use half::f16;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};

/// An opened safetensors buffer, with errors that name the file.
pub struct TensorFile<'a> {
    name: &'a str,
    tensors: SafeTensors<'a>,
}

impl<'a> TensorFile<'a> {
    /// Opens a buffer; `name` is for messages.
    ///
    /// # Errors
    /// If the buffer is no safetensors file.
    pub fn open(name: &'a str, bytes: &'a [u8]) -> Result<Self, StyleError> {
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| StyleError::Weights {
            file: name.to_owned(),
            reason: format!("is not a whole safetensors file ({e}); copy it again"),
        })?;
        Ok(Self { name, tensors })
    }

    fn fault(&self, reason: String) -> StyleError {
        StyleError::Weights {
            file: self.name.to_owned(),
            reason,
        }
    }

    /// Whether there is a tensor of that name.
    pub fn has(&self, key: &str) -> bool {
        self.tensors.tensor(key).is_ok()
    }

    /// One tensor's numbers as f32 (stored as f32 or f16).
    ///
    /// # Errors
    /// If it is absent or of another type.
    pub fn floats(&self, key: &str) -> Result<Vec<f32>, StyleError> {
        let tensor = self
            .tensors
            .tensor(key)
            .map_err(|_| self.fault(format!("has no tensor \"{key}\"")))?;
        match tensor.dtype() {
            Dtype::F32 => Ok(tensor
                .data()
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| f32::from_le_bytes(*b))
                .collect()),
            Dtype::F16 => Ok(tensor
                .data()
                .as_chunks::<2>()
                .0
                .iter()
                .map(|b| f16::from_le_bytes(*b).to_f32())
                .collect()),
            other => Err(self.fault(format!(
                "stores \"{key}\" as {other:?}, f32 or f16 was expected"
            ))),
        }
    }

    /// Like [`TensorFile::floats`], of a known length.
    ///
    /// # Errors
    /// Also if the length differs.
    pub fn floats_of(&self, key: &str, length: usize) -> Result<Vec<f32>, StyleError> {
        let floats = self.floats(key)?;
        if floats.len() == length {
            Ok(floats)
        } else {
            Err(self.fault(format!(
                "has {} numbers in \"{key}\", {length} were expected",
                floats.len()
            )))
        }
    }
}

/// Serialises flat vectors in half precision.
///
/// # Errors
/// If safetensors refuses them.
pub fn write_f16(tensors: &[(&str, &[f32])]) -> Result<Vec<u8>, StyleError> {
    let fault = |e: safetensors::SafeTensorError| StyleError::Weights {
        file: "output".into(),
        reason: e.to_string(),
    };
    let bytes: Vec<(&str, Vec<u8>, usize)> = tensors
        .iter()
        .map(|(name, data)| {
            (
                *name,
                data.iter()
                    .flat_map(|v| f16::from_f32(*v).to_le_bytes())
                    .collect(),
                data.len(),
            )
        })
        .collect();
    let views = bytes
        .iter()
        .map(|(name, bytes, length)| {
            Ok((
                *name,
                TensorView::new(Dtype::F16, vec![*length], bytes).map_err(fault)?,
            ))
        })
        .collect::<Result<Vec<_>, StyleError>>()?;
    serialize(views, None).map_err(fault)
}
