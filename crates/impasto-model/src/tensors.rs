//! Tensors of model files and checkpoints: named entries of a safetensors file, checked as they are
//! read.

use burn::tensor::{Device, Tensor};
use impasto_field::encoding::vector;
use impasto_field::{Parameters, host};
use impasto_kernels::DensityGrid;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors};
use std::collections::HashMap;

/// A tensor to be stored.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its name in the file.
    pub name: String,
    /// What its bytes are.
    pub dtype: Dtype,
    /// How many numbers.
    pub length: usize,
    /// Little-endian.
    pub bytes: Vec<u8>,
}

impl Entry {
    /// Numbers in single precision.
    pub fn floats(name: impl Into<String>, numbers: &[f32]) -> Self {
        Self {
            name: name.into(),
            dtype: Dtype::F32,
            length: numbers.len(),
            bytes: numbers.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }

    /// A tensor's numbers.
    pub fn tensor(name: impl Into<String>, tensor: &Tensor<1>) -> Self {
        Self::floats(name, &host(tensor.clone()))
    }

    /// Bytes as they are.
    pub fn bytes(name: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self {
            name: name.into(),
            dtype: Dtype::U8,
            length: bytes.len(),
            bytes,
        }
    }

    /// A density grid's levels.
    pub fn levels(name: impl Into<String>, grid: &DensityGrid) -> Self {
        Self::bytes(name, grid.levels().to_vec())
    }

    /// All vectors of a set of parameters.
    pub fn parameters(set: &impl Parameters) -> Vec<Self> {
        let named = set.named().into_iter();
        named
            .map(|(name, tensor)| Self::tensor(name, &tensor))
            .collect()
    }
}

/// A safetensors file.
///
/// # Errors
/// If names are not unique.
pub fn serialize(
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

/// Reads the tensors of a file onto a device. Errors are the end of a sentence about the file.
#[derive(Clone, Copy)]
pub struct TensorReader<'a> {
    /// The file.
    pub tensors: &'a SafeTensors<'a>,
    /// Where tensors go.
    pub device: &'a Device,
}

impl TensorReader<'_> {
    /// Whether there is a tensor of this name.
    pub fn has(&self, name: &str) -> bool {
        self.tensors.tensor(name).is_ok()
    }

    /// A vector of so many numbers.
    ///
    /// # Errors
    /// If there is none of this name and length.
    pub fn floats(&self, name: &str, length: usize) -> Result<Tensor<1>, String> {
        Ok(vector(self.numbers(name, length)?, self.device))
    }

    /// So many numbers.
    ///
    /// # Errors
    /// If there are none of this name and length.
    pub fn numbers(&self, name: &str, length: usize) -> Result<Vec<f32>, String> {
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

    /// A set of parameters like another one.
    ///
    /// # Errors
    /// The first vector that is missing or of another length.
    pub fn parameters<P: Parameters>(&self, like: &P) -> Result<P, String> {
        like.try_map(&mut |name, tensor| self.floats(name, tensor.dims()[0]))
    }

    /// A density grid.
    ///
    /// # Errors
    /// If there is none of this name, or it is no cube.
    pub fn grid(&self, name: &str) -> Result<DensityGrid, String> {
        let tensor = self
            .tensors
            .tensor(name)
            .map_err(|_| format!("lacks the tensor \"{name}\""))?;
        DensityGrid::from_levels(tensor.data().to_vec())
            .ok_or_else(|| format!("holds \"{name}\", which is no cube"))
    }
}
