//! Times of the hot kernels, as shares of what the machine can do at all; on the CPU with the plain
//! tensor library beside them in the same run.

mod cases;
mod cpu;
mod device;
mod machine;
mod peak;
mod plain;
mod report;

pub use cpu::run;
pub use device::run_on;
pub use machine::Machine;
pub use report::{BenchReport, Timing};
