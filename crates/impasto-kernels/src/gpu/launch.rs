//! Buffers and launches that all kernels need.

use burn::backend::ops::FloatTensorOps;
use burn::tensor::{DType, Shape, TensorData};
use burn_cubecl::cubecl::server::Handle;
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric::{empty_device_contiguous_dtype, zeros_client};
use burn_cubecl::tensor::CubeTensor;
use burn_cubecl::{CubeBackend, CubeDevice};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Units of a cube where they do not work together.
pub(crate) const UNITS: u32 = 128;

/// Most cubes along one axis that every device takes (WebGPU's limit).
pub(crate) const MOST_CUBES: usize = 65_535;

/// A tensor's numbers in row-major order, none between them.
pub(crate) fn whole(tensor: CubeTensor) -> CubeTensor {
    into_contiguous(tensor)
}

/// An uninitialised tensor on the device of another.
pub(crate) fn empty(like: &CubeTensor, shape: impl Into<Shape>) -> CubeTensor {
    let (client, device) = (like.client.clone(), like.device.clone());
    empty_device_contiguous_dtype(client, device, shape.into(), DType::F32)
}

/// Zeros on the device of another tensor.
pub(crate) fn zeros(like: &CubeTensor, shape: impl Into<Shape>) -> CubeTensor {
    let (client, device) = (like.client.clone(), like.device.clone());
    zeros_client(client, device, shape.into(), DType::F32)
}

/// Uninitialised integers on the device of another tensor.
pub(crate) fn empty_u32(like: &CubeTensor, length: usize) -> CubeTensor {
    let (client, device) = (like.client.clone(), like.device.clone());
    empty_device_contiguous_dtype(client, device, [length].into(), DType::U32)
}

/// Zero as integers.
pub(crate) fn zeros_u32(like: &CubeTensor, length: usize) -> CubeTensor {
    let (client, device) = (like.client.clone(), like.device.clone());
    zeros_client(client, device, [length].into(), DType::U32)
}

/// Numbers on the device of another tensor.
pub(crate) fn from_slice(
    like: &CubeTensor,
    numbers: Vec<f32>,
    shape: impl Into<Shape>,
) -> CubeTensor {
    CubeBackend::float_from_data(TensorData::new(numbers, shape.into()), &like.device)
}

/// Integers on the device of another tensor.
pub(crate) fn from_u32(like: &CubeTensor, numbers: &[u32]) -> CubeTensor {
    let handle = like.client.create_from_slice(u32::as_bytes(numbers));
    let (client, device) = (like.client.clone(), like.device.clone());
    CubeTensor::new_contiguous(client, device, [numbers.len()].into(), handle, DType::U32)
}

/// A tensor's numbers in a buffer of their own.
pub(crate) fn copied(tensor: &CubeTensor) -> CubeTensor {
    CubeBackend::float_add_scalar(tensor.clone(), 0.0f32.into())
}

/// A tensor as a kernel's argument.
pub(crate) fn argument(tensor: &CubeTensor) -> BufferArg {
    tensor.clone().into_buffer_arg()
}

/// Constants of a launch, on the device.
#[derive(Clone)]
pub(crate) struct Uploaded {
    handle: Handle,
    length: usize,
}

impl Uploaded {
    /// Integers.
    pub(crate) fn u32(like: &CubeTensor, numbers: &[u32]) -> Self {
        Self {
            handle: like.client.create_from_slice(u32::as_bytes(numbers)),
            length: numbers.len(),
        }
    }

    /// Numbers.
    pub(crate) fn f32(like: &CubeTensor, numbers: &[f32]) -> Self {
        Self {
            handle: like.client.create_from_slice(f32::as_bytes(numbers)),
            length: numbers.len(),
        }
    }

    /// What a kernel has found.
    pub(crate) fn of(tensor: &CubeTensor) -> Self {
        Self {
            handle: tensor.handle.clone(),
            length: tensor.meta.num_elements(),
        }
    }

    /// As a kernel's argument.
    pub(crate) fn argument(&self) -> BufferArg {
        // SAFETY: the buffer was made with this length.
        unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.length) }
    }
}

/// What was uploaded of things that still exist, with the device that it is on.
pub(crate) struct Uploads<K, V>(Mutex<Vec<(Weak<K>, CubeDevice, V)>>);

impl<K, V: Clone> Uploads<K, V> {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// What was uploaded of `key` to the device of `like`, or else what `make` uploads there.
    pub(crate) fn of(&self, key: &Arc<K>, like: &CubeTensor, make: impl FnOnce() -> V) -> V {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let own = Arc::downgrade(key);
        let found = known
            .iter()
            .find(|(other, device, _)| other.ptr_eq(&own) && *device == like.device);
        if let Some((_, _, found)) = found {
            return found.clone();
        }
        known.retain(|(other, ..)| other.strong_count() > 0);
        let made = make();
        known.push((own, like.device.clone(), made.clone()));
        made
    }
}

/// Which rows of its buffers a launch is about.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    most: usize,
    bounds: Option<(&'a CubeTensor, u32)>,
}

impl<'a> Rows<'a> {
    /// All of so many.
    pub(crate) fn all(rows: usize) -> Self {
        Self {
            most: rows,
            bounds: None,
        }
    }

    /// Those from number `first` of `bounds` to the next, integers that only the device knows, out
    /// of `most` for which there is room.
    pub(crate) fn between(bounds: &'a CubeTensor, first: u32, most: usize) -> Self {
        Self {
            most,
            bounds: Some((bounds, first)),
        }
    }

    /// Rows that there is room for.
    pub(crate) fn most(&self) -> usize {
        self.most
    }

    /// What [`extent`] asks for: the buffer, the place in it and the room.
    pub(crate) fn arguments(&self, like: &CubeTensor) -> (BufferArg, u32, u32) {
        match self.bounds {
            Some((bounds, first)) => (argument(bounds), first, self.most as u32),
            None => (argument(&empty(like, [1])), 0, self.most as u32),
        }
    }

    /// Whether the device has to look them up.
    pub(crate) fn bounded(&self) -> bool {
        self.bounds.is_some()
    }
}

/// First row of a launch, and the one behind its last.
#[cube]
pub(crate) fn extent(
    bounds: &[u32],
    first: u32,
    rows: u32,
    #[comptime] bounded: bool,
) -> (usize, usize) {
    let mut start = 0usize;
    let mut end = rows as usize;
    if bounded {
        end = bounds[first as usize + 1].min(rows) as usize;
        start = (bounds[first as usize] as usize).min(end);
    }
    (start, end)
}

/// Cubes of [`UNITS`] for so many units in a row, folded into two axes where one does not hold
/// them; kernels look at `ABSOLUTE_POS`, which runs through both.
pub(crate) fn cubes_for(units: usize) -> CubeCount {
    let cubes = units.div_ceil(UNITS as usize);
    let across = cubes.clamp(1, MOST_CUBES);
    CubeCount::Static(across as u32, cubes.div_ceil(across).max(1) as u32, 1)
}

/// Cubes in one row.
pub(crate) fn cube() -> CubeDim {
    CubeDim::new_1d(UNITS)
}

/// Whether a number is neither infinite nor NaN. By its bits: shader compilers assume that
/// comparisons never see either.
#[cube]
pub(crate) fn is_finite(x: f32) -> bool {
    (x.to_bits() & 0x7f80_0000u32) != 0x7f80_0000u32
}
