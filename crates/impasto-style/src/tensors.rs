//! Reading and writing named tensors as safetensors.

use crate::StyleError;
use crate::weights::number::Number;
use half::f16;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors, serialize};
use std::collections::HashMap;

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
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| {
            let reason = format!("is not a whole safetensors file ({e}); copy it again");
            StyleError::weights(name, reason)
        })?;
        Ok(Self { name, tensors })
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
        let fault = |reason| StyleError::weights(self.name, reason);
        let tensor = self.tensors.tensor(key);
        let tensor = tensor.map_err(|_| fault(format!("has no tensor \"{key}\"")))?;
        let number = match tensor.dtype() {
            Dtype::F32 => Number::F32,
            Dtype::F16 => Number::F16,
            other => {
                return Err(fault(format!(
                    "stores \"{key}\" as {other:?}, f32 or f16 was expected"
                )));
            }
        };
        Ok(number.decode(tensor.data()))
    }

    /// Like [`TensorFile::floats`], of a known length.
    ///
    /// # Errors
    /// Also if the length differs.
    pub fn floats_of(&self, key: &str, length: usize) -> Result<Vec<f32>, StyleError> {
        let floats = self.floats(key)?;
        if floats.len() == length {
            return Ok(floats);
        }
        let reason = format!(
            "has {} numbers in \"{key}\", {length} were expected",
            floats.len()
        );
        Err(StyleError::weights(self.name, reason))
    }
}

/// A tensor to be stored.
pub(crate) struct HalfTensor {
    pub name: String,
    pub shape: Vec<usize>,
    pub numbers: Vec<f16>,
}

/// The safetensors file of some tensors.
pub(crate) fn serialise(
    tensors: &[HalfTensor],
    metadata: Option<HashMap<String, String>>,
) -> Result<Vec<u8>, SafeTensorError> {
    let bytes = |tensor: &HalfTensor| -> Vec<u8> {
        let numbers = tensor.numbers.iter();
        numbers.flat_map(|v| v.to_le_bytes()).collect()
    };
    let bytes: Vec<Vec<u8>> = tensors.iter().map(bytes).collect();
    let views = tensors.iter().zip(&bytes).map(|(tensor, bytes)| {
        let view = TensorView::new(Dtype::F16, tensor.shape.clone(), bytes)?;
        Ok((&tensor.name, view))
    });
    let views = views.collect::<Result<Vec<_>, SafeTensorError>>()?;
    serialize(views, metadata)
}

/// Serialises flat vectors in half precision.
///
/// # Errors
/// If safetensors refuses them.
pub fn write_f16(tensors: &[(&str, &[f32])]) -> Result<Vec<u8>, StyleError> {
    let tensors = tensors.iter().map(|(name, data)| HalfTensor {
        name: (*name).to_owned(),
        shape: vec![data.len()],
        numbers: data.iter().map(|v| f16::from_f32(*v)).collect(),
    });
    serialise(&tensors.collect::<Vec<_>>(), None)
        .map_err(|e| StyleError::weights("output", e.to_string()))
}
