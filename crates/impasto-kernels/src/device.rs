//! Which device computes: chosen once, by name, before any tensor is made.

use burn::tensor::Device;
use std::fmt;
use std::str::FromStr;

/// What the user asks for: `auto`, `cpu`, `gpu` or `gpu:N`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// The first real GPU, the CPU where there is none. Never a software rasteriser.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The first GPU; a software rasteriser where there is nothing else.
    Gpu,
    /// A GPU by its number, real ones first.
    GpuAt(usize),
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let number = name.strip_prefix("gpu:").map(str::parse);
        match (name, number) {
            ("auto", _) => Ok(Self::Auto),
            ("cpu", _) => Ok(Self::Cpu),
            ("gpu", _) => Ok(Self::Gpu),
            (_, Some(Ok(number))) => Ok(Self::GpuAt(number)),
            _ => Err(format!(
                "no device is called {name}; there are auto, cpu, gpu and gpu:N"
            )),
        }
    }
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu => f.write_str("gpu"),
            Self::GpuAt(number) => write!(f, "gpu:{number}"),
        }
    }
}

/// A device ready for tensors.
#[derive(Debug, Clone)]
pub struct Opened {
    /// What tensors are made on.
    pub device: Device,
    /// As the device names itself; `CPU` for the CPU.
    pub name: String,
    /// What the user should know of the choice, if anything.
    pub note: Option<String>,
}

/// Why there is no such device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NoDevice(String);

fn cpu(note: Option<String>) -> Opened {
    Opened {
        device: Device::flex(),
        name: "CPU".into(),
        note,
    }
}

/// Whether a device is the CPU, where tensors are slices and small pieces of work are best.
pub fn is_cpu(device: &Device) -> bool {
    let flex = Device::flex();
    *device == flex || *device == flex.autodiff()
}

impl DeviceChoice {
    /// Makes the device ready.
    ///
    /// # Errors
    /// If a GPU was asked for and there is none, or it cannot be used.
    pub fn open(self) -> Result<Opened, NoDevice> {
        match self {
            Self::Cpu => Ok(cpu(None)),
            _ => gpu::open(self),
        }
    }
}

#[cfg(not(feature = "gpu"))]
mod gpu {
    use super::{DeviceChoice, NoDevice, Opened, cpu};

    pub(super) fn open(choice: DeviceChoice) -> Result<Opened, NoDevice> {
        match choice {
            DeviceChoice::Auto => Ok(cpu(None)),
            _ => Err(NoDevice(
                "this impasto was built without GPUs: build it with `--features gpu`, or use \
                 `--device cpu`"
                    .into(),
            )),
        }
    }
}

#[cfg(feature = "gpu")]
mod gpu {
    use super::{DeviceChoice, NoDevice, Opened, cpu};
    use burn::tensor::{Device, DeviceKind};
    use burn_cubecl::cubecl::{self, wgpu::WgpuDeviceKind};
    use std::collections::HashMap;
    use std::sync::{LazyLock, Mutex};

    /// Every adapter, real GPUs first, and whether it is a software rasteriser. Asking drivers
    /// takes tens of milliseconds: once.
    static ADAPTERS: LazyLock<Vec<(DeviceKind, bool)>> = LazyLock::new(adapters);

    fn adapters() -> Vec<(DeviceKind, bool)> {
        let kinds = cubecl::Device::enumerate_all()
            .into_iter()
            .filter_map(|device| {
                let cubecl::Device::Wgpu(device) = device else {
                    return None;
                };
                match device.kind {
                    WgpuDeviceKind::DiscreteGpu(n) => Some((0, DeviceKind::DiscreteGpu(n))),
                    WgpuDeviceKind::IntegratedGpu(n) => Some((1, DeviceKind::IntegratedGpu(n))),
                    WgpuDeviceKind::VirtualGpu(n) => Some((2, DeviceKind::VirtualGpu(n))),
                    WgpuDeviceKind::Cpu => Some((3, DeviceKind::Cpu)),
                    // What an adapter of no stated kind is, nobody knows; the rest are no adapters.
                    _ => None,
                }
            });
        let mut kinds: Vec<(u32, DeviceKind)> = kinds.collect();
        kinds.sort_by_key(|(rank, _)| *rank);
        kinds
            .into_iter()
            .map(|(rank, kind)| (kind, rank == 3))
            .collect()
    }

    pub(super) fn open(choice: DeviceChoice) -> Result<Opened, NoDevice> {
        let adapters = &*ADAPTERS;
        let real = adapters.iter().filter(|(_, software)| !software).count();
        let found = match choice {
            DeviceChoice::GpuAt(number) => adapters.get(number),
            DeviceChoice::Auto if real == 0 => None,
            _ => adapters.first(),
        };
        match (found, choice) {
            (Some((kind, software)), DeviceChoice::Auto) => {
                // A driver that fails is no reason not to work at all.
                Ok(
                    opened(kind.clone(), *software).unwrap_or_else(|NoDevice(why)| {
                        cpu(Some(format!("{why}; computing on the CPU")))
                    }),
                )
            }
            (Some((kind, software)), _) => opened(kind.clone(), *software),
            (None, DeviceChoice::Auto) => {
                Ok(cpu(Some("no GPU found: computing on the CPU".into())))
            }
            (None, DeviceChoice::GpuAt(number)) => Err(NoDevice(format!(
                "there is no GPU {number}: this machine has {}; `--device auto` takes what there is",
                adapters.len()
            ))),
            (None, _) => Err(NoDevice(
                "no GPU found: install its Vulkan driver, or use `--device cpu`".into(),
            )),
        }
    }

    fn opened(kind: DeviceKind, software: bool) -> Result<Opened, NoDevice> {
        /// What has been opened: a runtime cannot be initialised twice.
        static OPEN: Mutex<Option<HashMap<DeviceKind, Device>>> = Mutex::new(None);
        let mut open = OPEN
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let open = open.get_or_insert_default();
        let device = match open.get(&kind) {
            Some(device) => device.clone(),
            None => {
                let made = Device::wgpu_options().device_kind(kind.clone()).init();
                let made =
                    made.map_err(|error| NoDevice(format!("the GPU cannot be used: {error}")))?;
                open.insert(kind, made.clone());
                made
            }
        };
        let name = device
            .identity()
            .map_or_else(|| "GPU".into(), |identity| identity.name);
        let note = software.then(|| {
            format!(
                "{name} is no GPU but a program that stands in for one: `--device cpu` is faster"
            )
        });
        Ok(Opened { device, name, note })
    }
}

/// The device that tests run on: the CPU, or what the environment variable `IMPASTO_DEVICE` names.
///
/// # Panics
/// If there is no such device.
#[doc(hidden)]
pub fn tested() -> Device {
    let name = std::env::var("IMPASTO_DEVICE").unwrap_or_else(|_| "cpu".into());
    let opened = name
        .parse::<DeviceChoice>()
        .map_err(NoDevice)
        .and_then(DeviceChoice::open);
    opened
        .unwrap_or_else(|error| panic!("IMPASTO_DEVICE: {error}"))
        .device
}
