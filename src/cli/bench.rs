//! `impasto bench`.

use clap::Args;
use impasto_bench::{Report, run as measure};
use std::fmt::Write;

use super::{Answer, CliError, to_json};

/// Time the kernels on this machine, beside its peak and the plain tensor library
#[derive(Debug, Args)]
pub struct BenchArgs {}

/// Runs the command.
pub fn run(_: &BenchArgs) -> Result<Answer, CliError> {
    let report = measure();
    Ok(Answer {
        text: table(&report),
        json: to_json(&report),
    })
}

fn table(report: &Report) -> String {
    let mut text = format!(
        "{}, peak {:.0} GFLOP/s\n{:56}{:>9}{:>10}{:>9}{:>6}{:>10}{:>8}",
        report.machine,
        report.peak_gflops,
        "",
        "ms",
        "ns each",
        "GFLOP/s",
        "peak",
        "plain ms",
        "faster"
    );
    for kernel in &report.kernels {
        let optional = |value: Option<f64>, digits: usize, unit: &str| {
            value.map_or(String::new(), |v| format!("{v:.digits$}{unit}"))
        };
        let share = kernel.share_of_peak.map(|s| 100.0 * s);
        let faster = kernel.plain_milliseconds.map(|p| p / kernel.milliseconds);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n{:56}{:9.2}{:10.1}{:>9}{:>6}{:>10}{:>8}",
            kernel.name,
            kernel.milliseconds,
            kernel.nanoseconds_each,
            optional(kernel.gflops, 0, ""),
            optional(share, 0, "%"),
            optional(kernel.plain_milliseconds, 1, ""),
            optional(faster, 1, "×"),
        );
    }
    text
}
