//! `--device`.

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, resume_unwind};
use std::sync::{Mutex, OnceLock, PoisonError};

use clap::Args;
use impasto::{Device, DeviceChoice, Opened};

use super::{CliError, console};

/// The GPU that this process computes on.
static GPU: OnceLock<String> = OnceLock::new();
/// The first thing that failed since then; what follows from it says less.
static FAILURE: Mutex<Option<String>> = Mutex::new(None);

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
        Ok(self.open_named()?.device)
    }

    /// The same with the device's name.
    pub fn open_named(self) -> Result<Opened, CliError> {
        let opened = self.device.open()?;
        if !impasto::is_cpu(&opened.device) {
            console::note(format!("computing on {}", opened.name));
            watch(&opened.name);
        }
        if let Some(note) = &opened.note {
            console::note(note);
        }
        Ok(opened)
    }
}

/// From now on failures are the GPU's, and are told by [`guarded`].
fn watch(name: &str) {
    if GPU.set(name.to_owned()).is_err() {
        return;
    }
    let told = std::env::var_os("RUST_BACKTRACE").is_some();
    let default = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |failure| {
        remember(failure);
        if told {
            default(failure);
        }
    }));
}

fn remember(failure: &PanicHookInfo<'_>) {
    let text = failure.payload_as_str().unwrap_or("for an unknown reason");
    let mut first = FAILURE.lock().unwrap_or_else(PoisonError::into_inner);
    first.get_or_insert_with(|| text.to_owned());
}

/// Runs a command. A GPU that has no memory left or is gone ends the tensor library's work in a
/// panic, deep inside and maybe on another thread: that becomes an error, too.
pub fn guarded<T>(run: impl FnOnce() -> Result<T, CliError>) -> Result<T, CliError> {
    // What the command was about to change is not looked at again.
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|failure| {
        let Some(name) = GPU.get() else {
            resume_unwind(failure);
        };
        let mut first = FAILURE.lock().unwrap_or_else(PoisonError::into_inner);
        Err(CliError::Gpu {
            name: name.clone(),
            reason: innermost(&first.take().unwrap_or_default()).to_owned(),
        })
    })
}

/// The last cause of several that were told one below the other.
fn innermost(failure: &str) -> &str {
    let rest = ["", "Caused by:", "No backtrace available", "Asked at:"];
    let mut told = failure.lines().map(str::trim);
    told.rfind(|line| !rest.contains(line)).unwrap_or(failure)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_innermost_cause_is_told() {
        let failure = "numbers cannot be read back: An error happened\n\nCaused by:\n  \
                       can't allocate buffer of size: 240000000\nNo backtrace available\n\
                       Asked at:\nNo backtrace available";
        assert_eq!(
            innermost(failure),
            "can't allocate buffer of size: 240000000"
        );
        assert_eq!(innermost("device lost"), "device lost");
    }

    #[test]
    fn failures_without_a_gpu_stay_what_they_are() {
        let fails = || guarded(|| -> Result<(), CliError> { panic!("a mistake") });
        assert!(catch_unwind(fails).is_err());
        let refused = guarded(|| -> Result<(), CliError> { Err(CliError::Unstyled) });
        assert!(matches!(refused, Err(CliError::Unstyled)));
    }
}
