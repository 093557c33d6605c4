//! What was measured, as it is handed on.

use crate::Machine;
use serde::Serialize;

/// One kernel's time.
#[derive(Debug, Clone, Serialize)]
pub struct Timing {
    /// What was computed.
    pub name: String,
    /// Milliseconds, the fastest of several runs.
    pub milliseconds: f64,
    /// Nanoseconds per row, point, pixel or sample.
    pub nanoseconds_each: f64,
    /// Billions of multiplications and additions a second that the result needs (recomputation
    /// does not count), where those dominate.
    pub gflops: Option<f64>,
    /// The same as a share of the machine's peak.
    pub share_of_peak: Option<f64>,
    /// Milliseconds of the tensor library, where it can do the same.
    pub plain_milliseconds: Option<f64>,
}

impl Timing {
    /// A kernel that takes so many seconds for `each` rows, points, pixels or samples.
    pub(crate) fn new(name: String, seconds: f64, each: usize, flops: Option<f64>) -> Self {
        Self {
            name,
            milliseconds: seconds * 1e3,
            nanoseconds_each: seconds * 1e9 / each as f64,
            gflops: flops.map(|f| f / seconds / 1e9),
            share_of_peak: None,
            plain_milliseconds: None,
        }
    }

    /// The same beside the tensor library, which takes so many seconds.
    pub(crate) fn beside(self, plain: f64) -> Self {
        Self {
            plain_milliseconds: Some(1e3 * plain),
            ..self
        }
    }
}

/// All timings of a machine.
#[derive(Debug, Clone, Serialize)]
pub struct BenchReport {
    /// What they were taken on.
    #[serde(flatten)]
    pub machine: Machine,
    /// The GPU, where they are not the processor's.
    pub device: Option<String>,
    /// Billions of multiplications and additions a second that all threads reach together in
    /// registers; on a GPU, that a product of large matrices reaches.
    pub peak_gflops: f64,
    /// Kernels.
    pub kernels: Vec<Timing>,
}

impl BenchReport {
    /// Of kernels that do not know the peak yet.
    pub(crate) fn new(device: Option<&str>, peak_gflops: f64, mut kernels: Vec<Timing>) -> Self {
        for kernel in &mut kernels {
            kernel.share_of_peak = kernel.gflops.map(|g| g / peak_gflops);
        }
        Self {
            machine: Machine::this(),
            device: device.map(Into::into),
            peak_gflops,
            kernels,
        }
    }
}
