//! `--device`.

use clap::Args;
use impasto::{Device, DeviceChoice};

use super::{CliError, console};

/// Where to compute.
#[derive(Debug, Clone, Copy, Args)]
pub struct DeviceArgs {
    /// Where to compute: auto (a GPU where there is one), cpu, gpu or gpu:N
    #[arg(long, value_name = "DEVICE", env = "IMPASTO_DEVICE", default_value_t)]
    device: DeviceChoice,
}

impl DeviceArgs {
    /// The device, ready; what it is and why goes to stderr, unless it is the CPU by choice.
    pub fn open(self) -> Result<Device, CliError> {
        let opened = self.device.open()?;
        if !impasto::is_cpu(&opened.device) {
            console::note(format!("computing on {}", opened.name));
        }
        if let Some(note) = opened.note {
            console::note(note);
        }
        Ok(opened.device)
    }
}
