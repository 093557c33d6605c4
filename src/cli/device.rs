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

/// From now on failures of the GPU are told by [`guarded`].
fn watch(name: &str) {
    if GPU.set(name.to_owned()).is_err() {
        return;
    }
    let with_backtrace = std::env::var_os("RUST_BACKTRACE").is_some();
    let default = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |failure| {
        if !is_the_gpus(failure) {
            return default(failure);
        }
        let text = failure.payload_as_str().unwrap_or("for an unknown reason");
        let mut first = FAILURE.lock().unwrap_or_else(PoisonError::into_inner);
        first.get_or_insert_with(|| text.to_owned());
        drop(first);
        if with_backtrace {
            default(failure);
        }
    }));
}

/// Whether numbers cannot be read back, or the libraries gave up that reach the GPU. All else is a
/// mistake of this program.
fn is_the_gpus(failure: &PanicHookInfo<'_>) -> bool {
    let lost = failure
        .payload_as_str()
        .is_some_and(|text| text.starts_with(impasto::LOST));
    lost || failure.location().is_some_and(|location| {
        let libraries = ["cubecl", "wgpu"];
        libraries
            .iter()
            .any(|library| location.file().contains(library))
    })
}

/// Runs a command. A GPU that has no memory left or is gone ends the tensor library's work in a
/// panic, deep inside and maybe on another thread: that becomes an error, too.
pub fn guarded<T>(run: impl FnOnce() -> Result<T, CliError>) -> Result<T, CliError> {
    // What the command was about to change is not looked at again.
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|failure| {
        let mut first = FAILURE.lock().unwrap_or_else(PoisonError::into_inner);
        let (Some(name), Some(reason)) = (GPU.get(), first.take()) else {
            resume_unwind(failure);
        };
        Err(CliError::Gpu {
            name: name.clone(),
            reason: innermost(&reason).to_owned(),
        })
    })
}

/// The last cause of several that were told one below the other.
fn innermost(failure: &str) -> &str {
    let last = failure.rsplit_once("Caused by:");
    let cause = last.map_or(failure, |(_, cause)| cause);
    let mut lines = cause.lines().map(str::trim);
    lines.find(|line| !line.is_empty()).unwrap_or(failure)
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
        assert_eq!(
            innermost("device lost\nAsked at:\n  0: main"),
            "device lost"
        );
    }

    #[test]
    fn failures_without_a_gpu_stay_what_they_are() {
        let fails = || guarded(|| -> Result<(), CliError> { panic!("a mistake") });
        assert!(catch_unwind(fails).is_err());
        let refused = guarded(|| -> Result<(), CliError> { Err(CliError::Unstyled) });
        assert!(matches!(refused, Err(CliError::Unstyled)));
    }
}
