//! How weight files hold numbers.

use half::f16;

/// How a number is stored, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    F16,
    F32,
    F64,
}

/// Where a tensor's numbers are.
#[derive(Debug)]
pub(crate) struct Stored {
    pub number: Number,
    pub shape: Vec<u64>,
    /// First byte in the file.
    pub start: u64,
}

impl Number {
    /// In bytes.
    pub(crate) fn size(self) -> u64 {
        match self {
            Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(crate) fn decode(self, bytes: &[u8]) -> Vec<f32> {
        match self {
            Self::F16 => numbers(bytes, |b| f16::from_le_bytes(b).to_f32()),
            Self::F32 => numbers(bytes, f32::from_le_bytes),
            Self::F64 => numbers(bytes, |b| f64::from_le_bytes(b) as f32),
        }
    }
}

fn numbers<const N: usize>(bytes: &[u8], decode: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|b| decode(*b)).collect()
}
